"""The kit on everything that is registered here: tickfix's own algorithms, and those of plugins installed beside it."""

from __future__ import annotations

from typing import Any

from tickfix.api import TrainedModel
from tickfix.kernel.determinism import RandomStreams
from tickfix.registry import discover
from tickfix.testing import AlgorithmContract, FilterContract, FingerprintContract, MapContract, PdrContract, world

CONTRACTS: dict[str, type[AlgorithmContract]] = {
    "filter": FilterContract,
    "fingerprint": FingerprintContract,
    "map": MapContract,
    "pdr": PdrContract,
}

SETTINGS: dict[str, dict[str, Any]] = {
    "kalman-map": {"follows_m": 7.0},  # it knows of turns by fixes alone
    "image": {"tolerance_m": 0.3},  # the diagonal of a pixel
}


def contract_of(kind: str, cls: type[Any]) -> type[AlgorithmContract]:
    """Return the contract that the author would have written in five lines."""
    settings = SETTINGS.get(cls.name, {})
    body = {"algorithm": cls, "trained": lesson(cls), "__module__": __name__, **settings}
    return type(f"Test{cls.__name__}", (CONTRACTS[kind],), body)


def lesson(cls: type[Any]) -> TrainedModel | None:
    """Return what the kit's survey teaches an algorithm that cannot do without, None for all others."""
    if not hasattr(cls, "train"):
        return None
    try:
        cls(cls.Params(), world.context(), None)
    except ValueError as error:
        if "survey again" in str(error):
            # With the generator that a survey hands out, which cannot do all that numpy's default one can.
            trained: TrainedModel = cls.train(
                cls.Params(), world.survey(), RandomStreams(0, "survey").at(0, 0, cls.name)
            )
            return trained
    return None


for _offer in discover().offers:
    if _offer.kind in CONTRACTS:
        globals()[f"Test_{_offer.kind}_{_offer.name}"] = contract_of(_offer.kind, _offer.cls)


def test_there_is_an_algorithm_of_every_kind() -> None:
    found = {offer.kind for offer in discover().offers}
    assert set(CONTRACTS) <= found, "tickfix is not installed here: pip install -e '.[test]'"
