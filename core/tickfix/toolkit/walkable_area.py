"""Geometry of a floor as filters use it.

Which positions are walkable, sampling around a position, and the heading of the nearest wall. People mostly walk along
the nearest wall or perpendicular to it: [borenstein2010] Borenstein and Ojeda, "Heuristic drift elimination for
personnel tracking systems", J. Navigation 63 (2010), steer headings towards the few directions of a building; here it
is the direction of the nearest wall, and evidence rather than a correction. The effective region is that of [wang2015]
section 5.2.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tickfix.api import Bools, Floats, Floor, FloorMap, Rng, frozen

_CANDIDATES_PER_SAMPLE: Final = 8  # places drawn for each particle, to find one where it can stand


def outside_walkable(floor_map: FloorMap | None, before: Floats, xy: Floats, *, walls: bool) -> Bools:
    """Return which of N particles have left the region: (N,) bool; none where there is no map.

    Args:
        floor_map: of the floor.
        before, xy: (N, 2) metres, where they came from and where they are.
        walls: one that passed a wall has left it, too.
    """
    if floor_map is None:
        return np.zeros(len(xy), dtype=np.bool_)
    left = ~floor_map.contains(xy)
    return left | floor_map.crosses(before, xy) if walls else left


def sample_around(floor_map: FloorMap | None, centre: Floats, sigma_m: float, n: int, rng: Rng) -> Floats:
    """Draw ``n`` places (n, 2) around ``centre`` (2,), those preferred where one can stand."""
    xy = centre + sigma_m * rng.standard_normal((n if floor_map is None else _CANDIDATES_PER_SAMPLE * n, 2))
    if floor_map is None:
        return frozen(xy)
    free = xy[floor_map.contains(xy)]
    return frozen(free[np.arange(n) % len(free)] if len(free) else floor_map.nearest_free(xy[:n]))


_RIGHT_ANGLE: Final = 0.5 * math.pi
_MIN_WALL_LENGTH_M: Final = 1.0  # edges of pillars and rounded corners lead nowhere
_WALL_SAMPLE_SPACING_M: Final = 0.25
_CELL_SIZE_M: Final = 0.5
_MARGIN_M: Final = 5.0
_MAX_CELLS: Final = 1_000_000  # cells; those of a larger floor are coarser


class WallDirections:
    """The direction of the nearest wall, tabulated in square cells.

    Args:
        floor: whose walls and edges of outline and obstacles count.
    """

    def __init__(self, floor: Floor) -> None:
        """Find the wall nearest to each cell."""
        edges = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in (*floor.outline, *floor.obstacles)]
        walls = np.concatenate([floor.walls, *edges])
        delta = walls[:, 1] - walls[:, 0]
        length_m = np.hypot(*delta.T)
        walls, delta, length_m = (each[length_m >= _MIN_WALL_LENGTH_M] for each in (walls, delta, length_m))
        self._side_m, self._origin, self._last = _CELL_SIZE_M, np.zeros(2), np.zeros(2)
        self._rad: NDArray[np.float32] = np.full((1, 1), np.nan, np.float32)
        if len(walls) == 0:
            return
        pieces = np.ceil(length_m / _WALL_SAMPLE_SPACING_M).astype(np.int64)
        wall = np.repeat(np.arange(len(walls)), pieces)
        piece = np.arange(len(wall)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        on_wall = walls[wall, 0] + ((piece + 0.5) / pieces[wall])[:, None] * delta[wall]
        self._origin = walls.min(axis=(0, 1)) - _MARGIN_M
        extent_m = walls.max(axis=(0, 1)) + _MARGIN_M - self._origin
        self._side_m = max(_CELL_SIZE_M, math.sqrt(float(np.prod(extent_m)) / _MAX_CELLS))
        columns, rows = np.ceil(extent_m / self._side_m).astype(int).tolist()
        self._last = np.array([columns - 1.0, rows - 1.0])
        column, row = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
        middles = self._origin + self._side_m * (np.stack([column, row], axis=-1) + 0.5)
        nearest = wall[cKDTree(on_wall).query(middles)[1]]
        self._rad = np.mod(np.arctan2(delta[:, 0], delta[:, 1]), _RIGHT_ANGLE).astype(np.float32)[nearest]

    def nearest_wall_heading_rad(self, xy: Floats) -> NDArray[np.float32]:
        """Return for places (…, 2) the heading (…,) of the nearest wall, modulo a right angle; NaN without walls."""
        cell = xy - self._origin
        cell *= 1.0 / self._side_m
        np.maximum(cell, 0.0, out=cell)
        np.minimum(cell, self._last, out=cell)
        column, row = np.moveaxis(cell.astype(np.int64), -1, 0)
        nearest: NDArray[np.float32] = self._rad[column, row]
        return nearest
