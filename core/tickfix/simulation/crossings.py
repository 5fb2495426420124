"""How many walls stand between two places."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np

from tickfix.api import Floats, Floor, Ints

_CHUNK: Final = 2_000_000
"""Pairs of way and wall looked at in one go: bounds the memory to some 100 MB."""


def count_crossings(a: Floats, b: Floats, walls: Floats) -> Ints:
    """Count the walls that each straight way from ``a`` to ``b`` crosses.

    Args:
        a, b: (n, 2) metres.
        walls: (m, 2, 2) metres; a wall holds its first end but not its second, so that a way through the joint of two
            walls crosses one. Walls along the way are not crossed.

    Returns:
        (n,) int64.
    """
    count = np.zeros(len(a), dtype=np.int64)
    if len(walls) == 0:
        return count
    rows = max(1, _CHUNK // len(walls))
    for i in range(0, len(a), rows):
        count[i : i + rows] = _crossed(a[i : i + rows], b[i : i + rows], walls).sum(axis=1)
    return count


def _crossed(a: Floats, b: Floats, walls: Floats) -> Floats:
    rx, ry = (b - a).T[..., None]
    sx, sy = (walls[:, 1] - walls[:, 0]).T
    qx, qy = walls[:, 0, 0] - a[:, :1], walls[:, 0, 1] - a[:, 1:]
    area = rx * sy - ry * sx
    # Compared without dividing: t = way/area and u = wall/area lie in [0, 1] and [0, 1) when these signs agree.
    sign = np.sign(area)
    size = np.abs(area)
    way, wall = sign * (qx * sy - qy * sx), sign * (qx * ry - qy * rx)
    crossed: Floats = (size > 0) & (way >= 0) & (way <= size) & (wall >= 0) & (wall < size)
    return crossed


def barriers(floor: Floor) -> Floats:
    """Return what stands on a floor, walls and the edges of obstacles, as segments (m, 2, 2) in metres."""
    rings = [np.array(list(pairwise(np.vstack([ring, ring[:1]])))) for ring in floor.obstacles if len(ring) > 2]
    return np.concatenate([floor.walls, *rings])
