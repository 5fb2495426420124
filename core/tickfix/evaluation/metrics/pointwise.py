"""What a pipeline said at the points where truth is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tickfix.api import Bools, Floats, Ints, frozen
from tickfix.evaluation.metrics.points import TruthPoints
from tickfix.evaluation.metrics.regions import density_level, nees
from tickfix.evaluation.scoring import belief_at
from tickfix.evaluation.track import Track

NOWHERE = -1


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pointwise:
    """One pipeline at m truth points.

    Attributes:
        error_m: (m,) float64, horizontal distance, each place in its own floor's frame; NaN without an estimate.
        floors_off: (m,) int64, by how many storeys the floor was wrong, −1 without an estimate.
        nees: (m,) float64, see :func:`~tickfix.evaluation.metrics.regions.nees`; NaN without an estimate or on another
            floor than the truth.
        density_level: (m,) float64, see :func:`~tickfix.evaluation.metrics.regions.density_level`; NaN without one.
    """

    error_m: Floats
    floors_off: Ints
    nees: Floats
    density_level: Floats

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "floors_off", frozen(self.floors_off, np.int64))
        for name in ("error_m", "nees", "density_level"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def estimated(self) -> Bools:
        """(m,) bool: where there was an estimate."""
        return np.isfinite(self.error_m)

    @property
    def floor_right(self) -> Bools:
        """(m,) bool: where the estimate named the truth's floor."""
        return np.asarray(self.floors_off == 0)


def pointwise(track: Track, points: TruthPoints, levels: Mapping[str, int]) -> Pointwise:
    """Compare what ``track`` published with the truth: at each point the newest estimate that was known by then counts.

    Args:
        track: as published.
        points: where truth is known.
        levels: number of the storey of each floor. Two floors that differ are at least one storey apart.
    """
    m = len(points)
    error_m, squared, level = np.full(m, np.nan), np.full(m, np.nan), np.full(m, np.nan)
    floors_off = np.full(m, NOWHERE, dtype=np.int64)
    for i, (t_ns, floor, xy) in enumerate(zip(points.t_ns.tolist(), points.floors, points.xy, strict=True)):
        belief = belief_at(track, t_ns)
        if belief is None:
            continue
        error_m[i] = np.hypot(*(belief.xy - xy))
        floors_off[i] = storeys_apart(belief.floor, floor, levels)
        squared[i] = nees(belief, floor, xy)
        level[i] = density_level(belief, floor, xy)
    return Pointwise(error_m=error_m, floors_off=floors_off, nees=squared, density_level=level)


def storeys_apart(a: str, b: str, levels: Mapping[str, int]) -> int:
    """Return by how many storeys two floors differ: 0 for one floor, at least 1 for two, also where none is known."""
    return 0 if a == b else max(1, abs(levels.get(a, 0) - levels.get(b, 0)))
