"""Routes that people can really walk: through doors, along corridors, never through a wall."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tickfix.api import Bools, Floats, Ints, Rng, frozen
from tickfix.simulation.crossings import barriers, count_crossings
from tickfix.simulation.walkable import Walkable

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


def route_through(ground: Walkable, places: Floats, radius_m: float = 0.8) -> Route:
    """Return the natural way past ``places`` (k, 2), k ≥ 2, in their order, with corners rounded."""
    cells = [ground.nearest(place) for place in np.asarray(places, dtype=np.float64)]
    legs = []
    for a, b in pairwise(cells):
        if a != b:
            legs.append(ground.way(ground.tree(a)[1], b))
    return _join(ground, legs, radius_m)


def random_route(ground: Walkable, rng: Rng, length_m: float = 80.0, radius_m: float = 0.8) -> Route:
    """Return a route of at least ``length_m`` from one random place to the next, each leg at least 8 m."""
    roomy = np.flatnonzero(ground.clearance_m >= min(0.5, float(np.median(ground.clearance_m))))
    cell = int(rng.choice(roomy))
    legs: list[Floats] = []
    total = 0.0
    while total < length_m:
        felt, before = ground.tree(cell)
        far = roomy[felt[roomy] >= min(8.0, float(felt[roomy].max()))]
        cell = int(rng.choice(far))
        legs.append(ground.way(before, cell))
        total += _length(legs[-1])
    return _join(ground, legs, radius_m)


def survey_routes(
    ground: Walkable, spacing_m: float = 3.0, length_m: float = 80.0, radius_m: float = 0.8
) -> tuple[Route, ...]:
    """Return routes that together come within about ``spacing_m`` of every place, each where the last one ended.

    Places to visit are taken from the middle of corridors and rooms outwards, ``spacing_m`` apart; the next is always
    the nearest one not yet passed.
    """
    targets = _targets(ground, spacing_m)
    walls = barriers(ground.floor)
    left = np.ones(len(targets), dtype=bool)
    cell = int(targets[np.argmin(ground.xy[targets].sum(axis=1))])
    left[targets == cell] = False
    routes: list[Route] = []
    legs: list[Floats] = []
    while left.any():
        felt, before = ground.tree(cell, 5.0 * spacing_m)
        if not np.isfinite(felt[targets[left]]).any():
            felt, before = ground.tree(cell)
        cell = int(targets[np.argmin(np.where(left, felt[targets], np.inf))])
        legs.append(ground.way(before, cell))
        left &= ~_passed(ground.xy[targets], legs[-1], spacing_m / 2.0, walls)
        left[targets == cell] = False
        if sum(map(_length, legs)) >= length_m or not left.any():
            routes.append(_join(ground, legs, radius_m))
            legs = []
    return tuple(routes)


def _targets(ground: Walkable, spacing_m: float) -> Ints:
    """Choose cells, the roomiest first, each the spacing from all chosen before it or behind a wall from them."""
    walls = barriers(ground.floor)
    chosen: list[int] = []
    covered = np.zeros(len(ground.xy), dtype=bool)
    for cell in np.argsort(-ground.clearance_m, kind="stable"):
        if covered[cell]:
            continue
        chosen.append(int(cell))
        near = np.flatnonzero(((ground.xy - ground.xy[cell]) ** 2).sum(axis=1) < spacing_m**2)
        here = np.broadcast_to(ground.xy[cell], (len(near), 2))
        covered[near[count_crossings(here, ground.xy[near], walls) == 0]] = True
    return np.array(chosen)


def _passed(places: Floats, way: Floats, within_m: float, walls: Floats) -> Bools:
    """Tell which places (n, 2) were seen from the way within some distance: (n,)."""
    along = _resampled(way, 0.5)
    apart = np.hypot(*(places[:, None] - along[None]).transpose(2, 0, 1))
    nearest = along[apart.argmin(axis=1)]
    passed: Bools = (apart.min(axis=1) <= within_m) & (count_crossings(places, nearest, walls) == 0)
    return passed


def _resampled(way: Floats, step_m: float) -> Floats:
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    at = np.linspace(0.0, s[-1], int(np.ceil(s[-1] / step_m)) + 1)
    return np.stack([np.interp(at, s, way[:, 0]), np.interp(at, s, way[:, 1])], axis=1)


def _length(way: Floats) -> float:
    return float(np.hypot(*np.diff(way, axis=0).T).sum())


def _join(ground: Walkable, legs: Sequence[Floats], radius_m: float) -> Route:
    if not legs:
        raise ValueError("places: all lie in one cell, expected at least two apart")
    corners = np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])
    return Route(ground.floor.name, round_corners(ground, corners, radius_m))


def round_corners(ground: Walkable, corners: Floats, radius_m: float) -> Floats:
    """Replace the corners of a line (n, 2) by arcs of ``radius_m``, or as much as there is room for."""
    line = [corners[:1]]
    for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
        arcs = (_arc(before, corner, after, radius_m * shrink) for shrink in (1.0, 0.7, 0.5, 0.3))
        line.append(next(_fitting(ground, arcs), corner[None]))
    line.append(corners[-1:])
    points = np.concatenate(line)
    apart = np.hypot(*np.diff(points, axis=0).T) > 1e-6
    kept: Floats = points[np.concatenate([[True], apart])]
    return kept


def _fitting(ground: Walkable, arcs: Iterator[Floats | None]) -> Iterator[Floats]:
    return (arc for arc in arcs if arc is not None and bool(ground.covers(arc[None])[0]))


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
