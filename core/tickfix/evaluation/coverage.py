"""Where the survey has been: elsewhere no fingerprint can know a place."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
import shapely

from tickfix.api import Bools, Floats

COVERED_M: Final = 3.0
"""A waypoint this near to a survey walk, or nearer, is covered."""


class Coverage:
    """Tells which places lie within ``radius_m`` of the way of any survey walk on their floor."""

    def __init__(self, polylines: Iterable[tuple[str, Floats]], radius_m: float = COVERED_M) -> None:
        """Index the survey walks.

        Args:
            polylines: for each survey walk its floor and its waypoints (n, 2) in time order, metres, floor frame. One
                that has a single waypoint is a point; one without any covers nothing.
            radius_m: the greatest distance.
        """
        self.radius_m = radius_m
        by_floor: dict[str, list[shapely.Geometry]] = {}
        for floor, xy in polylines:
            if len(xy):
                way = shapely.Point(xy[0]) if len(xy) == 1 else shapely.LineString(xy)
                by_floor.setdefault(floor, []).append(way)
        self._trees = {floor: shapely.STRtree(ways) for floor, ways in by_floor.items()}

    def covers(self, floor: str, xy: Floats) -> Bools:
        """Return for each place (n, 2) on ``floor`` whether it is covered: (n,) bool."""
        covered = np.zeros(len(xy), dtype=np.bool_)
        tree = self._trees.get(floor)
        if tree is not None and len(xy):
            near, _ = tree.query(shapely.points(xy), predicate="dwithin", distance=self.radius_m)
            covered[near] = True
        return covered
