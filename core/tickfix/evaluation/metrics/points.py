"""Where truth is known: at the waypoints, and, interpolated, between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from tickfix.api import Floats, Ints, Truth, frozen
from tickfix.site.legs import legs

EVERY_S: Final = 1.0
"""Time between two interpolated points."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TruthPoints:
    """The m places of a walk at which tracks are compared with the truth.

    Attributes:
        t_ns: (m,) int64, non-decreasing.
        floors: m names.
        xy: (m, 2) float64, metres, floor frame.
        travelled_m: (m,) float64, way since the first waypoint, straight from waypoint to waypoint.
    """

    t_ns: Ints
    floors: tuple[str, ...]
    xy: Floats
    travelled_m: Floats

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "t_ns", frozen(self.t_ns, np.int64))
        object.__setattr__(self, "xy", frozen(self.xy))
        object.__setattr__(self, "travelled_m", frozen(self.travelled_m))

    def __len__(self) -> int:
        """Return m."""
        return len(self.t_ns)


def waypoints(truth: Sequence[Truth]) -> TruthPoints:
    """Return the waypoints themselves, in time order; nobody is said to travel between floors."""
    ordered = sorted(truth, key=lambda waypoint: waypoint.t_ns)
    xy = np.array([waypoint.xy for waypoint in ordered]).reshape(-1, 2)
    floors = tuple(waypoint.floor for waypoint in ordered)
    moves = np.hypot(*np.diff(xy, axis=0).T) if len(xy) > 1 else np.zeros(0)
    same = np.array([a == b for a, b in pairwise(floors)], dtype=bool)
    travelled_m = np.concatenate([np.zeros(min(1, len(xy))), np.cumsum(np.where(same, moves, 0.0))])
    t_ns = np.array([waypoint.t_ns for waypoint in ordered], dtype=np.int64)
    return TruthPoints(t_ns=t_ns, floors=floors, xy=xy, travelled_m=travelled_m)


def between_waypoints(truth: Sequence[Truth], every_s: float = EVERY_S) -> TruthPoints:
    """Return interpolated truth: a point every ``every_s`` strictly between the first and the last waypoint of a floor.

    Interpolation is linear in time between consecutive waypoints on one floor: it takes the person to have walked
    straight and at one speed from each to the next. Instants of waypoints are left out, since truth is known there.
    """
    ordered = sorted(truth, key=lambda waypoint: waypoint.t_ns)
    known = waypoints(ordered)
    times, floors, places = [np.zeros(0, np.int64)], [], [np.zeros((0, 2))]
    step_ns = round(every_s * 1e9)
    for leg in legs(ordered):
        t_ns = np.arange(leg.t_ns[0] + step_ns, leg.t_ns[-1], step_ns, dtype=np.int64)
        t_ns = t_ns[~np.isin(t_ns, leg.t_ns)]
        times.append(t_ns)
        places.append(leg.at(t_ns))
        floors += [leg.floor] * len(t_ns)
    t_ns = np.concatenate(times)
    # Nanoseconds since 1970 do not fit into a float.
    begin_ns = known.t_ns[:1]
    travelled_m = np.interp(t_ns - begin_ns, known.t_ns - begin_ns, known.travelled_m) if len(t_ns) else np.zeros(0)
    return TruthPoints(t_ns=t_ns, floors=tuple(floors), xy=np.concatenate(places), travelled_m=travelled_m)
