"""Where a surveyor was: the waypoints of a walk as polylines in time, one per uninterrupted stay on a floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tickfix.api import Bools, Floats, Ints, Truth, frozen


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Leg:
    """One floor's part of a walk.

    Attributes:
        floor: its name.
        t_ns: (n,) int64, increasing.
        xy: (n, 2) float64, metres, floor frame.
    """

    floor: str
    t_ns: Ints
    xy: Floats

    def covers(self, t_ns: Ints) -> Bools:
        """Tell which times (k,) lie between the first and the last waypoint, both included."""
        return np.asarray((t_ns >= self.t_ns[0]) & (t_ns <= self.t_ns[-1]))

    def at(self, t_ns: Ints) -> Floats:
        """Return the places (k, 2) at times that the leg covers, linear between waypoints."""
        since, knots = t_ns - self.t_ns[0], self.t_ns - self.t_ns[0]  # nanoseconds since 1970 do not fit into a float
        return np.stack([np.interp(since, knots, self.xy[:, i]) for i in range(2)], axis=1)


def legs(truth: Sequence[Truth]) -> tuple[Leg, ...]:
    """Split waypoints in time order where the floor changes; of waypoints at the same instant the first counts."""
    runs: list[list[Truth]] = []
    for point in truth:
        if not runs or runs[-1][-1].floor != point.floor:
            runs.append([point])
        elif point.t_ns > runs[-1][-1].t_ns:
            runs[-1].append(point)
    return tuple(
        Leg(
            floor=run[0].floor,
            t_ns=frozen([point.t_ns for point in run], np.int64),
            xy=frozen([point.xy for point in run]),
        )
        for run in runs
    )
