"""Which way the walls of a floor run: people mostly walk along the nearest wall, or straight away from it.

[borenstein2010] Borenstein and Ojeda, "Heuristic drift elimination for personnel tracking systems", J. Navigation 63
(2010), steer a heading towards the few directions of a building. Here the direction is that of the nearest wall, so
that wings at an angle are no matter, and it is evidence rather than a correction.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tickfix.api import Floats, Floor

_RIGHT_ANGLE: Final = 0.5 * math.pi
_SHORTEST_M: Final = 1.0  # edges of pillars and rounded corners lead nowhere
_APART_M: Final = 0.25
_SIDE_M: Final = 0.5
_MARGIN_M: Final = 5.0
_MOST: Final = 1_000_000  # cells; those of a larger floor are coarser


class WallDirections:
    """The direction of the nearest wall, tabulated in square cells.

    Args:
        floor: whose walls and edges of outline and obstacles count.
    """

    def __init__(self, floor: Floor) -> None:
        """Find the wall nearest to each cell."""
        edges = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in (*floor.outline, *floor.obstacles)]
        walls = np.concatenate([floor.walls, *edges])
        way = walls[:, 1] - walls[:, 0]
        length_m = np.hypot(*way.T)
        walls, way, length_m = (each[length_m >= _SHORTEST_M] for each in (walls, way, length_m))
        self._side_m, self._origin, self._last = _SIDE_M, np.zeros(2), np.zeros(2)
        self._rad: NDArray[np.float32] = np.full((1, 1), np.nan, np.float32)
        if len(walls) == 0:
            return
        pieces = np.ceil(length_m / _APART_M).astype(np.int64)
        wall = np.repeat(np.arange(len(walls)), pieces)
        piece = np.arange(len(wall)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        on_wall = walls[wall, 0] + ((piece + 0.5) / pieces[wall])[:, None] * way[wall]
        self._origin = walls.min(axis=(0, 1)) - _MARGIN_M
        extent_m = walls.max(axis=(0, 1)) + _MARGIN_M - self._origin
        self._side_m = max(_SIDE_M, math.sqrt(float(np.prod(extent_m)) / _MOST))
        columns, rows = np.ceil(extent_m / self._side_m).astype(int).tolist()
        self._last = np.array([columns - 1.0, rows - 1.0])
        column, row = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
        middles = self._origin + self._side_m * (np.stack([column, row], axis=-1) + 0.5)
        nearest = wall[cKDTree(on_wall).query(middles)[1]]
        self._rad = np.mod(np.arctan2(way[:, 0], way[:, 1]), _RIGHT_ANGLE).astype(np.float32)[nearest]

    def rad(self, xy: Floats) -> NDArray[np.float32]:
        """Return for places (…, 2) the heading (…,) of the nearest wall, modulo a right angle; NaN without walls."""
        cell = xy - self._origin
        cell *= 1.0 / self._side_m
        np.maximum(cell, 0.0, out=cell)
        np.minimum(cell, self._last, out=cell)
        column, row = np.moveaxis(cell.astype(np.int64), -1, 0)
        nearest: NDArray[np.float32] = self._rad[column, row]
        return nearest
