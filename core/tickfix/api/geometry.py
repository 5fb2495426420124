"""Angles and directions as the whole project understands them: headings run clockwise from +y (north)."""

from __future__ import annotations

import math
from typing import overload

import numpy as np

from tickfix.api.arrays import Floats


@overload
def wrap_rad(angle: float) -> float: ...
@overload
def wrap_rad(angle: Floats) -> Floats: ...
def wrap_rad(angle: float | Floats) -> float | Floats:
    """Wrap an angle, or an array of them, into [−π, π)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def displacement(distance_m: float | Floats, heading_rad: float | Floats) -> Floats:
    """Return the way (…, 2) of ``distance_m`` along ``heading_rad``: d·sin θ, d·cos θ [jiang2015] eq. (13)."""
    return np.stack([distance_m * np.sin(heading_rad), distance_m * np.cos(heading_rad)], axis=-1)


def heading_of(way: Floats) -> float:
    """Return the heading of a displacement (2,), clockwise from +y."""
    return math.atan2(float(way[0]), float(way[1]))
