"""Routes that people can walk.

The grid of places at a margin from all walls, shortest paths on it, and random, given or covering routes with rounded
corners.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from tickfix.api import Bools, Floats, Floor, Ints, Rng, frozen
from tickfix.simulation.floor_plans import barriers, count_wall_crossings

_COMFORT_M = 0.5
"""People keep to the middle: within about this distance of the margin a way feels longer than it is …"""
_DISCOMFORT = 1.5
"""… by up to this factor, less one."""
_SHORTCUT_CELLS = 60
"""How many cells of a route are searched for a short cut in one go."""


@dataclass(frozen=True, slots=True, eq=False)
class WalkableGrid:
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

    def shortest_path_tree(self, cell: int, limit_m: float = np.inf) -> tuple[Floats, Ints]:
        """Return how far every cell feels from ``cell`` (n,), inf beyond the limit, and which precedes it (n,)."""
        distance, before = dijkstra(self.graph, indices=cell, limit=limit_m, return_predecessors=True)
        return distance, before

    def path(self, before: Ints, cell: int) -> Floats:
        """Return the corners (k, 2) of the way along the predecessors ``before`` to ``cell``, short cuts taken."""
        cells = [cell]
        while before[cells[-1]] >= 0:
            cells.append(int(before[cells[-1]]))
        return self._shorten(np.array(cells[::-1]))

    def covers(self, ways: Floats) -> Bools:
        """Return for each polyline (m, k, 2) whether it keeps the margin: (m,)."""
        free: Bools = shapely.covers(self.region, shapely.linestrings(ways))
        return free

    def _shorten(self, cells: Ints) -> Floats:
        """Go straight where that is free and feels no longer than the way along the cells."""
        xy = self.xy[cells]
        cost = np.concatenate([[0.0], np.cumsum(np.asarray(self.graph[cells[:-1], cells[1:]]).ravel())])
        corners = [0]
        while corners[-1] < len(cells) - 1:
            i = corners[-1]
            ahead = np.arange(min(len(cells) - 1, i + _SHORTCUT_CELLS), i, -1)
            lines = np.stack([np.broadcast_to(xy[i], (len(ahead), 2)), xy[ahead]], axis=1)
            good = (j for j in ahead[self.covers(lines)] if self._path_cost(xy[i], xy[j]) <= cost[j] - cost[i] + 1e-9)
            corners.append(int(next(good, i + 1)))
        return xy[corners]

    def _path_cost(self, a: Floats, b: Floats) -> float:
        length = float(np.hypot(*(b - a)))
        n = int(np.ceil(2.0 * length / self.cell_m)) + 1
        points = a + (np.arange(n)[:, None] + 0.5) / n * (b - a)
        column, row = np.floor(points / self.cell_m).astype(np.int64).T
        cells = self.index[row, column]
        clearance = np.where(cells >= 0, self.clearance_m[cells], 0.0)
        return length * float(_discomfort(clearance).mean())


def walkable_grid(floor: Floor, margin_m: float = 0.3, cell_m: float = 0.35) -> WalkableGrid:
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
    return WalkableGrid(
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
    # Only a step along the rim can leave the region: for example round the end of a wall.
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


_ARC_STEP_RAD = 0.06
"""A rounded corner is a polygon with such angles: far below what turns a person."""
_SMALLEST_RADIUS_M = 0.15
"""A corner tighter than this is no curve: one stops and turns on the spot."""


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """The line that somebody means to walk.

    Attributes:
        floor: name of the floor.
        xy: (n, 2) metres, no two neighbours equal. At a sharp corner the walker turns on the spot.
    """

    floor: str
    xy: Floats

    def __post_init__(self) -> None:
        """Freeze the line.

        Raises:
            ValueError: when it is no line.
        """
        xy = frozen(self.xy)
        if xy.ndim != 2 or xy.shape[1] != 2 or len(xy) < 2 or not np.all(np.hypot(*np.diff(xy, axis=0).T) > 0):
            raise ValueError(
                f"xy: found shape {xy.shape}, expected at least two points (n, 2), each apart from the last"
            )
        object.__setattr__(self, "xy", xy)

    @property
    def length_m(self) -> float:
        """Length of the line."""
        return float(np.hypot(*np.diff(self.xy, axis=0).T).sum())


def route_through(grid: WalkableGrid, places: Floats, radius_m: float = 0.8) -> Route:
    """Return the natural way past ``places`` (k, 2), k ≥ 2, in their order, with corners rounded."""
    cells = [grid.nearest(place) for place in np.asarray(places, dtype=np.float64)]
    legs = []
    for a, b in pairwise(cells):
        if a != b:
            legs.append(grid.path(grid.shortest_path_tree(a)[1], b))
    return _join_legs(grid, legs, radius_m)


def random_route(grid: WalkableGrid, rng: Rng, length_m: float = 80.0, radius_m: float = 0.8) -> Route:
    """Return a route of at least ``length_m`` from one random place to the next, each leg at least 8 m."""
    roomy = np.flatnonzero(grid.clearance_m >= min(0.5, float(np.median(grid.clearance_m))))
    cell = int(rng.choice(roomy))
    legs: list[Floats] = []
    total = 0.0
    while total < length_m:
        cost, before = grid.shortest_path_tree(cell)
        far = roomy[cost[roomy] >= min(8.0, float(cost[roomy].max()))]
        cell = int(rng.choice(far))
        legs.append(grid.path(before, cell))
        total += _polyline_length(legs[-1])
    return _join_legs(grid, legs, radius_m)


def survey_routes(
    grid: WalkableGrid, spacing_m: float = 3.0, length_m: float = 80.0, radius_m: float = 0.8
) -> tuple[Route, ...]:
    """Return routes that together come within about ``spacing_m`` of every place, each where the last one ended.

    Places to visit are taken from the middle of corridors and rooms outwards, ``spacing_m`` apart; the next is always
    the nearest one not yet passed.
    """
    targets = _targets(grid, spacing_m)
    walls = barriers(grid.floor)
    left = np.ones(len(targets), dtype=bool)
    cell = int(targets[np.argmin(grid.xy[targets].sum(axis=1))])
    left[targets == cell] = False
    routes: list[Route] = []
    legs: list[Floats] = []
    while left.any():
        cost, before = grid.shortest_path_tree(cell, 5.0 * spacing_m)
        if not np.isfinite(cost[targets[left]]).any():
            cost, before = grid.shortest_path_tree(cell)
        cell = int(targets[np.argmin(np.where(left, cost[targets], np.inf))])
        legs.append(grid.path(before, cell))
        left &= ~_visited(grid.xy[targets], legs[-1], spacing_m / 2.0, walls)
        left[targets == cell] = False
        if sum(map(_polyline_length, legs)) >= length_m or not left.any():
            routes.append(_join_legs(grid, legs, radius_m))
            legs = []
    return tuple(routes)


def _targets(grid: WalkableGrid, spacing_m: float) -> Ints:
    """Choose cells, the roomiest first, each the spacing from all chosen before it or behind a wall from them."""
    walls = barriers(grid.floor)
    chosen: list[int] = []
    covered = np.zeros(len(grid.xy), dtype=bool)
    for cell in np.argsort(-grid.clearance_m, kind="stable"):
        if covered[cell]:
            continue
        chosen.append(int(cell))
        near = np.flatnonzero(((grid.xy - grid.xy[cell]) ** 2).sum(axis=1) < spacing_m**2)
        here = np.broadcast_to(grid.xy[cell], (len(near), 2))
        covered[near[count_wall_crossings(here, grid.xy[near], walls) == 0]] = True
    return np.array(chosen)


def _visited(places: Floats, path: Floats, within_m: float, walls: Floats) -> Bools:
    """Return which places (n, 2) were seen from the way within some distance: (n,)."""
    along = _resampled(path, 0.5)
    apart = np.hypot(*(places[:, None] - along[None]).transpose(2, 0, 1))
    nearest = along[apart.argmin(axis=1)]
    passed: Bools = (apart.min(axis=1) <= within_m) & (count_wall_crossings(places, nearest, walls) == 0)
    return passed


def _resampled(path: Floats, step_m: float) -> Floats:
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    at = np.linspace(0.0, s[-1], int(np.ceil(s[-1] / step_m)) + 1)
    return np.stack([np.interp(at, s, path[:, 0]), np.interp(at, s, path[:, 1])], axis=1)


def _polyline_length(path: Floats) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def _join_legs(grid: WalkableGrid, legs: Sequence[Floats], radius_m: float) -> Route:
    if not legs:
        raise ValueError("places: all lie in one cell, expected at least two apart")
    corners = np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])
    return Route(grid.floor.name, round_corners(grid, corners, radius_m))


def round_corners(grid: WalkableGrid, corners: Floats, radius_m: float) -> Floats:
    """Replace the corners of a line (n, 2) by arcs of ``radius_m``, or as much as there is room for."""
    line = [corners[:1]]
    for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
        arcs = (_arc(before, corner, after, radius_m * shrink) for shrink in (1.0, 0.7, 0.5, 0.3))
        line.append(next(_fitting(grid, arcs), corner[None]))
    line.append(corners[-1:])
    points = np.concatenate(line)
    apart = np.hypot(*np.diff(points, axis=0).T) > 1e-6
    kept: Floats = points[np.concatenate([[True], apart])]
    return kept


def _fitting(grid: WalkableGrid, arcs: Iterator[Floats | None]) -> Iterator[Floats]:
    return (arc for arc in arcs if arc is not None and bool(grid.covers(arc[None])[0]))


def _arc(before: Floats, corner: Floats, after: Floats, radius_m: float) -> Floats | None:
    """Return an arc (k, 2) that touches both sides of a corner, None where it would be too tight to be one."""
    u, v = corner - before, after - corner
    lu, lv = float(np.hypot(*u)), float(np.hypot(*v))
    u, v = u / lu, v / lv
    turn = float(np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v))
    if abs(turn) < 1e-6:
        return None
    half = np.tan(abs(turn) / 2.0)
    # Each corner may take 0.45 of its sides, so that the arcs of two neighbours never overlap.
    radius = min(radius_m, 0.45 * min(lu, lv) / half)
    if radius < _SMALLEST_RADIUS_M:
        return None
    n = int(np.ceil(abs(turn) / _ARC_STEP_RAD)) + 1
    angle = np.linspace(0.0, turn, n)
    start = corner - u * radius * half
    normal = np.array([-u[1], u[0]]) * np.sign(turn)
    arc: Floats = start + radius * (np.sin(np.abs(angle))[:, None] * u + (1.0 - np.cos(angle))[:, None] * normal)
    return arc
