"""Map ``regions``: the geometry of ``walls``, divided into sub-regions.

[wang2015] section 2.1 segments the floor plan into sub-regions by the layout of the building. Floor plans name none, so
this is a generic division: a square grid is laid over the walkable area, and what the walls leave connected within a
square is a sub-region. Two of them are adjacent where one can walk straight from one into the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
import shapely

from tickfix.api import Floats, Ints, frozen, parameter
from tickfix_maps.walls import Walls, WallsParams

_TOUCH_DISTANCE_M = 1e-6


@dataclass(frozen=True)
class RegionsParams(WallsParams):
    """Parameters of ``regions``."""

    region_m: Annotated[
        float, parameter("greatest extent of a sub-region", unit="m", source="[wang2015] 2.1", gt=0)
    ] = 20.0
    min_area_m2: Annotated[
        float,
        parameter("smaller pieces, such as niches between two walls, are none", unit="m²", ge=0, formerly="least_m2"),
    ] = 1.0


class Regions(Walls):
    """Floor geometry as drawn, with the walkable area divided into sub-regions.

    Attributes:
        outlines: the sub-regions as polygons, from west to east in rows from the south; empty on a floor without
            outline, which has no area to divide.
    """

    name = "regions"
    source = "[wang2015] section 2.1"
    Params = RegionsParams
    params: RegionsParams

    @cached_property
    def outlines(self) -> tuple[Any, ...]:
        """The sub-regions, shapely polygons in metres."""
        free = self.free
        if free is None:
            return ()
        size = self.params.region_m
        left, low, right, top = free.bounds
        columns, rows = int(np.ceil((right - left) / size)), int(np.ceil((top - low) / size))
        found = []
        for row in range(max(rows, 1)):
            for column in range(max(columns, 1)):
                x, y = left + column * size, low + row * size
                parts = shapely.get_parts(shapely.intersection(free, shapely.box(x, y, x + size, y + size)))
                areas = shapely.area(parts)
                found += [part for part, area in zip(parts, areas, strict=True) if area >= self.params.min_area_m2]
        return tuple(found)

    @cached_property
    def adjacent(self) -> Ints:
        """(n, 2) int64: pairs of sub-regions that one can walk between, each once, the smaller number first."""
        if not self.outlines:
            return frozen(np.zeros((0, 2)), np.int64)
        a, b = self._tree.query(np.array(self.outlines), predicate="dwithin", distance=_TOUCH_DISTANCE_M)
        a, b = a[a < b], b[a < b]
        # A corner in common is no way through.
        shared = [
            shapely.length(shapely.intersection(self.outlines[i].boundary, self.outlines[j].buffer(_TOUCH_DISTANCE_M)))
            for i, j in zip(a, b, strict=True)
        ]
        passable = np.array(shared, np.float64) > 2.0 * self.params.clearance_m + 10.0 * _TOUCH_DISTANCE_M
        pairs = np.column_stack([a[passable], b[passable]])
        return frozen(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))], np.int64)

    def region_of(self, xy: Floats) -> Ints:
        """Return the number of the sub-region of each point (n, 2), the nearest one's where it is in none: (n,) int64.

        On a floor without sub-regions all are −1.
        """
        if not self.outlines or len(xy) == 0:
            return np.full(len(xy), -1, np.int64)
        pairs = self._tree.query_nearest(shapely.points(xy), all_matches=True)
        numbers = np.full(len(xy), len(self.outlines), np.int64)
        np.minimum.at(numbers, pairs[0], pairs[1])  # on a border, the first of both
        return numbers

    @cached_property
    def _tree(self) -> Any:
        return shapely.STRtree(self.outlines)
