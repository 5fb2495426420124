"""Map ``walls``: the vector geometry of a floor, with exact crossings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
import shapely

from tickfix.api import BaseMap, Bools, Context, Floats, Floor, TrainedModel, frozen, parameter
from tickfix_maps.segment_index import CellGrid, SegmentIndex


@dataclass(frozen=True)
class WallsParams:
    """Parameters of ``walls``."""

    clearance_m: Annotated[float, parameter("distance kept from a wall by what is moved off it", unit="m", ge=0)] = 0.05


class Walls(BaseMap[WallsParams]):
    """Floor geometry as drawn: one cannot leave the outline, enter an obstacle or pass a wall.

    A floor without outline has no edge: one can stand anywhere outside its obstacles.
    """

    name = "walls"
    Params = WallsParams

    def __init__(self, params: WallsParams, context: Context, trained: TrainedModel | None = None) -> None:
        """Index the walls of ``context.floor``; areas are prepared when first asked for."""
        super().__init__(params, context, trained)
        assert context.floor is not None  # noqa: S101 - maps are built per floor
        self._floor = context.floor
        self._index = SegmentIndex(wall_segments(context.floor))

    def contains(self, xy: Floats) -> Bools:
        """Return for each point (n, 2) whether one can stand there."""
        if self._walkable is None:
            return np.ones(len(xy), dtype=np.bool_)
        cells, free, uniform = self._free
        cell = cells.index_of(xy.T)
        inside: Bools = free[cell]
        unsure = np.flatnonzero(~uniform[cell])
        inside[unsure] = shapely.contains_xy(self._walkable, xy[unsure])
        return inside

    def crosses(self, a: Floats, b: Floats) -> Bools:
        """Return for each move (n, 2) → (n, 2) whether it passes through or touches a wall."""
        return self._index.crosses(a, b)

    def nearest_free(self, xy: Floats) -> Floats:
        """Return for each point the nearest place where one can stand, itself where that is the place."""
        if self._walkable is None or self._inner is None:
            return xy
        free = xy.copy()
        blocked = ~self.contains(xy)
        if blocked.any():
            lines = shapely.shortest_line(self._inner, shapely.points(xy[blocked]))
            free[blocked] = shapely.get_coordinates(lines).reshape(-1, 2, 2)[:, 0]
        return free

    def snap(self, previous: Floats | None, xy: Floats) -> Floats:
        """Return the nearest free place to ``xy`` (2,); coming from ``previous``, no further than the first wall."""
        if previous is not None and bool(self.crosses(previous[None], xy[None])[0]):
            delta = xy - previous
            length = float(np.hypot(*delta))
            share = self._index.first_crossing(previous, xy) - self.params.clearance_m / max(length, 1e-9)
            xy = previous + max(0.0, share) * delta
        free: Floats = self.nearest_free(xy[None])[0]
        return free

    @property
    def free(self) -> Any:
        """The area where one can stand with clearance to all walls, a shapely geometry; None without outline."""
        return None if self._walkable is None else self._inner

    @cached_property
    def _free(self) -> tuple[CellGrid, Bools, Bools]:
        """Cells, in which of them one can stand, and which of them are uniform."""
        cells = CellGrid(_edges(self._floor))
        return cells, *cells.uniform_cells(lambda xy: shapely.contains_xy(self._walkable, xy))

    @cached_property
    def _walkable(self) -> Any:
        """The area where one can stand, None where it has no bounds and no obstacles."""
        area = _odd_even(self._floor.outline)
        if area is None:
            return None
        if self._floor.obstacles:
            area = area.difference(shapely.union_all([_area(ring) for ring in self._floor.obstacles]))
        shapely.prepare(area)
        return area

    @cached_property
    def _inner(self) -> Any:
        """The same, less a margin along obstacles and walls; None where nothing would be left."""
        inner = self._walkable.buffer(-self.params.clearance_m)
        if len(self._floor.walls):
            inner = inner.difference(shapely.MultiLineString(list(self._floor.walls)).buffer(self.params.clearance_m))
        return None if inner.is_empty else inner


def wall_segments(floor: Floor) -> Floats:
    """Return everything that blocks a move, (m, 2, 2): walls and the edges of outline and obstacles."""
    return frozen(np.concatenate([floor.walls, _edges(floor)]))


def _edges(floor: Floor) -> Floats:
    rings = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in (*floor.outline, *floor.obstacles)]
    return np.concatenate([np.zeros((0, 2, 2)), *rings])


def _area(ring: Floats) -> Any:
    return shapely.make_valid(shapely.Polygon(ring))


def _odd_even(rings: tuple[Floats, ...]) -> Any:
    """Return the area inside an odd number of the rings, None without rings."""
    area = None
    for ring in rings:
        area = _area(ring) if area is None else area.symmetric_difference(_area(ring))
    return area
