"""The law of filters that take many devices at once: who is asked for with whom, in which order, changes no bits."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lab import examples

from tickfix.api import Context, Prior, pack
from tickfix.registry import discover
from tickfix.testing import filter_batches, world

FILTERS = {offer.cls.name: offer.cls for offer in discover().offers if offer.kind == "filter"}
OF_MANY = sorted(name for name, cls in FILTERS.items() if hasattr(cls, "step_many"))
WALLS = next(offer.cls for offer in discover().offers if offer.cls.name == "walls")
MAPS = {name: WALLS(WALLS.Params(), Context(floor=floor)) for name, floor in world.floors().items()}
TICKS = 8


def built(name: str, preset: str) -> Any:
    cls = FILTERS[name]
    values = dict(cls.presets[preset].values) if preset else {}
    return cls(cls.Params(**values), world.context(maps=MAPS), None)


@pytest.mark.parametrize(("name", "preset"), [(n, p) for n in OF_MANY for p in ("", *FILTERS[n].presets)])
@examples(6)
@given(
    order=st.permutations(range(3 * filter_batches.N_DEVICES)),
    cuts=st.lists(st.integers(0, 3 * filter_batches.N_DEVICES), max_size=4),
    begun=st.lists(
        st.integers(0, TICKS - 2), min_size=3 * filter_batches.N_DEVICES, max_size=3 * filter_batches.N_DEVICES
    ),
)
def test_any_grouping_of_any_devices_says_the_same_bytes(
    name: str, preset: str, order: Sequence[int], cuts: list[int], begun: list[int]
) -> None:
    algorithm = built(name, preset)
    walks = 3 * filter_batches.device_inputs(TICKS)
    every = range(len(walks))
    states = [algorithm.start(Prior(t_ns=world.T0_NS, fix=world.first_fix()), world.rng(5, d)) for d in every]
    edges = [0, *sorted(cuts), len(walks)]
    for k in range(TICKS):
        walking = [d for d in order if begun[d] <= k]  # the others have only started
        alone = {d: algorithm.step(states[d], *walks[d][k], world.rng(6, d, k)) for d in walking}
        for first, last in pairwise(edges):
            group = walking[first:last]
            stepped = algorithm.step_many(
                [states[d] for d in group],
                [walks[d][k][0] for d in group],
                [walks[d][k][1] for d in group],
                [world.rng(6, d, k) for d in group],
            )
            beliefs = algorithm.estimate_many([state for state, _ in stepped])
            assert list(map(pack, stepped)) == [pack(alone[d]) for d in group]
            assert list(map(pack, beliefs)) == [pack(algorithm.estimate(alone[d][0])) for d in group]
        states = [alone[d][0] if d in alone else states[d] for d in every]


def test_there_are_such_filters() -> None:
    assert OF_MANY
