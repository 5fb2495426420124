"""How an algorithm declares its parameters, and the sets of values that have a name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec


def parameter(
    doc: str,
    *,
    unit: str = "",
    source: str = "",
    trains: bool = False,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    lt: float | None = None,
) -> msgspec.Meta:
    """Describe a field of ``Params`` inside ``Annotated``.

    Args:
        doc: what it is, in a few words.
        unit: ``"m"``, ``"rad"``, ``"s"`` …, empty for a pure number.
        source: the equation or section it comes from, as ``"[jiang2015] eq. (18)"``.
        trains: whether what ``train`` learns depends on it; such a model serves only the values it was trained with.
        ge, gt, le, lt: the allowed range.
    """
    bounds: dict[str, Any] = {
        name: bound for name, bound in (("ge", ge), ("gt", gt), ("le", le), ("lt", lt)) if bound is not None
    }
    return msgspec.Meta(description=doc, extra={"unit": unit, "source": source, "trains": trains}, **bounds)


@dataclass(frozen=True, slots=True)
class Preset:
    """A named set of parameters, usually a paper's: ``filter = { use = "fusion-pf", preset = "jiang2015" }``."""

    source: str
    values: Mapping[str, Any]


@dataclass(frozen=True)
class NoParams:
    """The parameters of an algorithm that has none."""
