"""A person who walks round and round the obstacle at 1.2 m/s, as a filter sees it: motion and fixes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from tickfix.api import TICK_NS, Fix, Floats, Motion, Observation, displacement
from tickfix.testing.world.chance import rng

T0_NS: Final = 8_500_000_000 * TICK_NS
"""When the world's walk begins; a tick."""
SPEED_MPS: Final = 1.2
_FIX_EVERY: Final = 10


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """What a filter gets at a tick, and where the person truly is."""

    number: int
    motion: Motion
    observations: tuple[Observation, ...]
    xy: Floats


def place(t_s: float) -> tuple[Floats, float]:
    """Return where the person is after ``t_s`` seconds, and the heading: round the obstacle, clockwise."""
    corners = np.array([[6.0, 2.0], [6.0, 10.0], [14.0, 10.0], [14.0, 2.0]])
    side = 8.0
    way = (SPEED_MPS * t_s) % (4 * side)
    n = int(way // side) % 4
    heading = 0.5 * math.pi * n
    return corners[n] + displacement(way % side, heading), heading


def walk(
    ticks: int, *, shift: Sequence[float] = (0.0, 0.0), fixes: bool = True, compass: bool = True
) -> Iterator[Tick]:
    """Walk for so many ticks: true motion, and every two seconds a fix that errs by about two metres.

    Args:
        ticks: how many.
        shift: added to every fix and every place: the same walk elsewhere.
        fixes: whether there are any.
        compass: whether motion has a heading.
    """
    travelled, before = 0.0, place(0.0)[1]
    for k in range(1, ticks + 1):
        xy, heading = place(0.2 * k)
        distance = SPEED_MPS * 0.2
        travelled += distance
        t_ns = T0_NS + k * TICK_NS
        motion = Motion(
            t0_ns=t_ns - TICK_NS,
            t1_ns=t_ns,
            distance_m=distance,
            heading_rad=(heading + math.pi) % (2 * math.pi) - math.pi if compass else None,
            turn_rad=(heading - before + math.pi) % (2 * math.pi) - math.pi,
            distance_sigma_m=0.05,
            distance_scale_sigma=0.05,
            heading_bias_sigma_rad=0.1,
            steps=1,
            travelled_m=travelled,
        )
        before = heading
        seen: tuple[Observation, ...] = ()
        if fixes and k % _FIX_EVERY == 0:
            error = rng(3, k).normal(0.0, 1.5, 2)
            seen = (observation(xy + error + np.asarray(shift), t_ns),)
        yield Tick(k, motion, seen, xy + np.asarray(shift))


def first_fix(shift: Sequence[float] = (0.0, 0.0)) -> Fix:
    """Return the fix at which the walk begins."""
    return Fix(t_ns=T0_NS, floor="F1", xy=place(0.0)[0] + np.asarray(shift), covariance=np.eye(2), source="world")


def observation(xy: Any, t_ns: int, floor: str = "F1", sigma_m: float = 2.0) -> Observation:
    """Return an observation with a fix."""
    covariance = sigma_m**2 * np.eye(2)
    return Observation(t_ns=t_ns, source="world", fix=Fix(t_ns=t_ns, floor=floor, xy=xy, covariance=covariance))
