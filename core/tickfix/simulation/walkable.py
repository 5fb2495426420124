"""Where one can walk on a floor, and the way from one place to another."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
import shapely
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from tickfix.api import Bools, Floats, Floor, Ints
from tickfix.simulation.crossings import barriers

_COMFORT_M = 0.5
"""People keep to the middle: within about this distance of the margin a way feels longer than it is …"""
_DISCOMFORT = 1.5
"""… by up to this factor, less one."""
_LOOK_AHEAD = 60
"""How many cells of a way are looked over for a short cut at once."""


@dataclass(frozen=True, slots=True, eq=False)
class Walkable:
    """A grid over the largest connected part of a floor on which one can walk without touching a wall.

    Attributes:
        floor: the floor.
        margin_m: every place is at least this far from walls, obstacles and the outline.
        cell_m: edge of a cell.
        region: the polygon of all places with this margin.
        xy: (n, 2) metres, the middles of the cells.
        clearance_m: (n,) how much further from the next wall than the margin each is.
        index: (rows, columns) number of the cell, −1 where there is none.
        graph: (n, n) sparse, metres as they feel.
    """

    floor: Floor
    margin_m: float
    cell_m: float
    region: Any
    xy: Floats
    clearance_m: Floats
    index: Ints
    graph: csr_matrix

    def nearest(self, xy: Floats) -> int:
        """Return the cell nearest to a place (2,)."""
        return int(np.argmin(((self.xy - xy) ** 2).sum(axis=1)))

    def tree(self, cell: int, limit_m: float = np.inf) -> tuple[Floats, Ints]:
        """Return how far every cell feels from ``cell`` (n,), inf beyond the limit, and which precedes it (n,)."""
        distance, before = dijkstra(self.graph, indices=cell, limit=limit_m, return_predecessors=True)
        return distance, before

    def way(self, before: Ints, cell: int) -> Floats:
        """Return the corners (k, 2) of the way along the predecessors ``before`` to ``cell``, short cuts taken."""
        cells = [cell]
        while before[cells[-1]] >= 0:
            cells.append(int(before[cells[-1]]))
        return self._shorten(np.array(cells[::-1]))

    def covers(self, ways: Floats) -> Bools:
        """Tell of each polyline (m, k, 2) whether it keeps the margin: (m,)."""
        free: Bools = shapely.covers(self.region, shapely.linestrings(ways))
        return free

    def _shorten(self, cells: Ints) -> Floats:
        """Go straight where that is free and feels no longer than the way along the cells."""
        xy = self.xy[cells]
        felt = np.concatenate([[0.0], np.cumsum(np.asarray(self.graph[cells[:-1], cells[1:]]).ravel())])
        corners = [0]
        while corners[-1] < len(cells) - 1:
            i = corners[-1]
            ahead = np.arange(min(len(cells) - 1, i + _LOOK_AHEAD), i, -1)
            lines = np.stack([np.broadcast_to(xy[i], (len(ahead), 2)), xy[ahead]], axis=1)
            good = (j for j in ahead[self.covers(lines)] if self._felt(xy[i], xy[j]) <= felt[j] - felt[i] + 1e-9)
            corners.append(int(next(good, i + 1)))
        return xy[corners]

    def _felt(self, a: Floats, b: Floats) -> float:
        length = float(np.hypot(*(b - a)))
        n = int(np.ceil(2.0 * length / self.cell_m)) + 1
        points = a + (np.arange(n)[:, None] + 0.5) / n * (b - a)
        column, row = np.floor(points / self.cell_m).astype(np.int64).T
        cells = self.index[row, column]
        clearance = np.where(cells >= 0, self.clearance_m[cells], 0.0)
        return length * float(_discomfort(clearance).mean())


def walkable(floor: Floor, margin_m: float = 0.3, cell_m: float = 0.35) -> Walkable:
    """Find where one can walk.

    Args:
        floor: walls, obstacles and the outline bound the ways; without an outline the drawing's edge does.
        margin_m: to keep from them; a door must be wider than twice this.
        cell_m: at most 1.4 margins: then no step from cell to cell can pass a wall, and a cell fits into every door
            that is wider than two margins and a cell.

    Raises:
        ValueError: when cells are too large for the margin, or nothing is left to walk on.
    """
    if cell_m * np.sqrt(2.0) >= 2.0 * margin_m:
        raise ValueError(f"cell_m: found {cell_m} m, expected less than {np.sqrt(2.0) * margin_m:.2f} m")
    region = _region(floor, margin_m)
    columns, rows = (int(np.ceil(size / cell_m)) for size in (floor.width_m, floor.height_m))
    cells = np.stack(np.meshgrid(np.arange(columns, dtype=np.float64), np.arange(rows, dtype=np.float64)), axis=-1)
    middle: Floats = (cells + 0.5) * cell_m
    free = shapely.contains_xy(region, middle[..., 0], middle[..., 1])
    if not free.any():
        raise ValueError(f"floor {floor.name}: nothing to walk on at {margin_m} m from its walls")
    clearance = np.asarray(distance_transform_edt(np.pad(free, 1)))[1:-1, 1:-1] * cell_m
    index = np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)
    graph = _graph(index, clearance, middle, region, cell_m)
    _, part = connected_components(graph, directed=False)
    keep = np.flatnonzero(part == np.argmax(np.bincount(part)))
    number = np.full(len(part) + 1, -1)  # the last, for −1, stays −1
    number[keep] = np.arange(len(keep))
    return Walkable(
        floor, margin_m, cell_m, region, middle[free][keep], clearance[free][keep], number[index], graph[keep][:, keep]
    )


def _region(floor: Floor, margin_m: float) -> Any:
    rings = floor.outline or (
        np.array([[0, 0], [floor.width_m, 0], [floor.width_m, floor.height_m], [0, floor.height_m]]),
    )
    area = reduce(shapely.symmetric_difference, [shapely.make_valid(shapely.polygons(ring)) for ring in rings])
    solid = [shapely.make_valid(shapely.polygons(ring)) for ring in floor.obstacles if len(ring) > 2]
    walls = shapely.multilinestrings(shapely.linestrings(barriers(floor)))
    taken = shapely.union_all([*solid, walls])
    region = shapely.difference(shapely.buffer(area, -margin_m), shapely.buffer(taken, margin_m))
    shapely.prepare(region)
    return region


def _graph(index: Ints, clearance_m: Floats, xy: Floats, region: Any, cell_m: float) -> csr_matrix:
    """Join neighbouring cells, diagonal ones too, where the step between them keeps the margin."""
    n = int(index.max()) + 1
    discomfort = _discomfort(clearance_m[index >= 0])
    starts, ends, weights = [], [], []
    h, w = index.shape
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
        here, there = index[max(0, -dy) : h - max(0, dy), : w - dx], index[max(0, dy) : h + min(0, dy), dx:]
        both = (here >= 0) & (there >= 0)
        a, b = here[both], there[both]
        starts.append(a)
        ends.append(b)
        weights.append(cell_m * np.hypot(dx, dy) * (discomfort[a] + discomfort[b]) / 2.0)
    a, b, weight = np.concatenate(starts), np.concatenate(ends), np.concatenate(weights)
    # Only a step along the rim can leave the region: round the end of a wall, say.
    clearance, middle = clearance_m[index >= 0], xy[index >= 0]
    rim = np.flatnonzero((clearance[a] < 2.0 * cell_m) & (clearance[b] < 2.0 * cell_m))
    keep = np.ones(len(a), dtype=bool)
    keep[rim] = shapely.covers(region, shapely.linestrings(np.stack([middle[a[rim]], middle[b[rim]]], axis=1)))
    a, b, weight = a[keep], b[keep], weight[keep]
    return csr_matrix(
        (np.tile(weight, 2), (np.concatenate([a, b]), np.concatenate([b, a]))),
        shape=(n, n),
    )


def _discomfort(clearance_m: Floats) -> Floats:
    return 1.0 + _DISCOMFORT * np.exp(-clearance_m / _COMFORT_M)
