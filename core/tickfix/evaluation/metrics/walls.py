"""What the plan forbids: moves through walls, and positions where nobody can stand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Final

import numpy as np
import shapely

from tickfix.api import Bools, Floats, Floor
from tickfix.evaluation.metrics.smoothness import Places

_LEAST_MOVE_M: Final = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Violations:
    """Counts that pool over walks; only floors with a plan are counted.

    Attributes:
        moves, crossings: moves from tick to tick, and how many of them went through a wall, or into or out of an
            obstacle or the outline.
        positions, outside: published positions, and how many of them lay off the floor or in an obstacle.
    """

    moves: int
    crossings: int
    positions: int
    outside: int


class Plan:
    """One floor's geometry, for many questions."""

    def __init__(self, floor: Floor) -> None:
        """Index walls, obstacles and outline."""
        outline = reduce(shapely.symmetric_difference, _polygons(floor.outline), shapely.Polygon())
        obstacles = shapely.union_all(_polygons(floor.obstacles))
        rings = [shapely.LinearRing(ring) for ring in (*floor.outline, *floor.obstacles) if len(ring) > 2]
        edges = [*rings, *(shapely.LineString(wall) for wall in floor.walls)]
        self.is_drawn = bool(edges)
        self._bounded = not outline.is_empty
        self._free = shapely.difference(outline, obstacles) if self._bounded else obstacles
        shapely.prepare(self._free)
        self._edges = shapely.STRtree(edges)

    def outside(self, xy: Floats) -> Bools:
        """Tell for each place (n, 2) whether nobody can stand there: (n,) bool."""
        within = shapely.intersects_xy(self._free, xy[:, 0], xy[:, 1])
        return np.asarray(~within if self._bounded else within, dtype=np.bool_)

    def crosses(self, a: Floats, b: Floats) -> Bools:
        """Tell for each move from ``a`` (n, 2) to ``b`` (n, 2) whether it meets a wall or an edge: (n,) bool."""
        found = np.zeros(len(a), dtype=np.bool_)
        moved = np.flatnonzero(np.hypot(*(b - a).T) > _LEAST_MOVE_M)
        if len(moved):
            moves = shapely.linestrings(np.stack([a[moved], b[moved]], axis=1))
            hit, _ = self._edges.query(moves, predicate="intersects")
            found[moved[hit]] = True
        return found


def plans(floors: Iterable[Floor]) -> Mapping[str, Plan]:
    """Return the plans of the floors that have one, by name."""
    every = {floor.name: Plan(floor) for floor in floors}
    return {name: plan for name, plan in every.items() if plan.is_drawn}


def violations(track: Places, drawn: Mapping[str, Plan]) -> Violations:
    """Count what a track did against the plans."""
    moves = crossings = positions = outside = 0
    floors = np.array(track.floors, dtype=np.str_)
    for name, plan in drawn.items():
        here = floors == name
        positions += int(here.sum())
        outside += int(plan.outside(track.xy[here]).sum())
        from_ = np.flatnonzero(track.joined & here[:-1]) if len(here) > 1 else np.zeros(0, np.int64)
        moves += len(from_)
        crossings += int(plan.crosses(track.xy[from_], track.xy[from_ + 1]).sum())
    return Violations(moves=moves, crossings=crossings, positions=positions, outside=outside)


def _polygons(rings: Iterable[Floats]) -> list[shapely.Geometry]:
    return [shapely.make_valid(shapely.Polygon(ring)) for ring in rings if len(ring) > 2]
