"""Maps of the floors: one of nothing, and exact ones that faster maps are compared with."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import shapely

from tickfix.api import Bools, Floats, Floor, FloorMap, Ints
from tickfix.testing.world.plan import floors


class OpenMap:
    """A map of nothing: one can stand and walk everywhere."""

    def contains(self, xy: Floats) -> Bools:
        """Tell that one can stand there."""
        return np.ones(len(xy), dtype=np.bool_)

    def crosses(self, a: Floats, b: Floats) -> Bools:  # noqa: ARG002
        """Tell that nothing is in the way."""
        return np.zeros(len(a), dtype=np.bool_)

    def nearest_free(self, xy: Floats) -> Floats:
        """Return the places themselves."""
        return xy

    def snap(self, previous: Floats | None, xy: Floats) -> Floats:  # noqa: ARG002
        """Return the place itself."""
        return xy


class PlainMap:
    """The geometry of a floor by shapely, one by one and slowly: what faster maps are compared with.

    Attributes:
        area: where one can stand, None where that has no bounds.
        lines: everything nobody passes.
    """

    def __init__(self, floor: Floor) -> None:
        """Take the floor as it is drawn."""
        rings = [*floor.outline, *floor.obstacles]
        segments = [*floor.walls, *(edge for ring in rings for edge in _edges(ring))]
        self.lines = shapely.MultiLineString([segment.tolist() for segment in segments])
        self.area: Any = None
        for ring in floor.outline:
            polygon = shapely.make_valid(shapely.Polygon(ring))
            self.area = polygon if self.area is None else self.area.symmetric_difference(polygon)
        if self.area is not None and floor.obstacles:
            obstacles = [shapely.make_valid(shapely.Polygon(ring)) for ring in floor.obstacles]
            self.area = self.area.difference(shapely.union_all(obstacles))

    def contains(self, xy: Floats) -> Bools:
        """Tell for each point whether it lies inside."""
        if self.area is None:
            return np.ones(len(xy), dtype=np.bool_)
        return np.array([self.area.contains(shapely.Point(p)) for p in xy], dtype=np.bool_)

    def crosses(self, a: Floats, b: Floats) -> Bools:
        """Tell for each move whether it meets a line."""
        return np.array([self._way(p, q).intersects(self.lines) for p, q in zip(a, b, strict=True)], dtype=np.bool_)

    def distance_m(self, a: Floats, b: Floats) -> Floats:
        """Return how near each move comes to a line: (n,) float64, metres; 0 where it meets one."""
        return np.array([self._way(p, q).distance(self.lines) for p, q in zip(a, b, strict=True)])

    def outside_m(self, xy: Floats) -> Floats:
        """Return how far each point is from where one can stand: (n,) float64, metres."""
        if self.area is None:
            return np.zeros(len(xy))
        return np.array([self.area.distance(shapely.Point(p)) for p in xy])

    def nearest_free(self, xy: Floats) -> Floats:
        """Return each point, moved a centimetre inside where it was outside."""
        free = np.array(xy)
        for n in np.flatnonzero(~self.contains(xy)):
            free[n] = shapely.shortest_line(self.area.buffer(-0.01), shapely.Point(xy[n])).coords[0]
        return free

    def snap(self, previous: Floats | None, xy: Floats) -> Floats:
        """Return the nearest free place, or stay where a line is in the way."""
        if previous is not None and self.crosses(previous[None], xy[None])[0]:
            return previous
        nearest: Floats = self.nearest_free(xy[None])[0]
        return nearest

    @staticmethod
    def _way(p: Floats, q: Floats) -> Any:
        return shapely.Point(p) if (p == q).all() else shapely.LineString([p, q])


def plain_maps() -> Mapping[str, FloorMap]:
    """Return exact maps of both floors."""
    return MappingProxyType({name: PlainMap(floor) for name, floor in floors().items()})


def _edges(ring: Floats) -> Ints | Floats:
    closed = np.concatenate([ring, ring[:1]])
    return np.stack([closed[:-1], closed[1:]], axis=1)
