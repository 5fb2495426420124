"""A floor's plan as a quiet background, and the part of it that a walk needs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Final

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.path import Path as Outline
from shapely.geometry.polygon import orient

from tickfix.api import Floats, Floor

_FLOOR: Final = "#f5f5f3"
_OBSTACLE: Final = "#e5e5e2"
_EDGE: Final = "#bcbcb8"
_WALL: Final = "#8f8f8b"
_MARGIN_M: Final = 4.0
_LEAST_M: Final = 20.0
_SLIMMEST: Final = 0.45


def draw_plan(axes: Axes, floor: Floor) -> None:
    """Draw outline, obstacles and walls; a floor without geometry leaves the axes empty."""
    outline = reduce(shapely.symmetric_difference, _polygons(floor.outline), shapely.Polygon())
    looks = ((outline, _FLOOR, 0.8), (shapely.union_all(_polygons(floor.obstacles)), _OBSTACLE, 0.5))
    for order, (area, face, width) in enumerate(looks, start=1):
        paths = [_path(polygon) for polygon in shapely.get_parts(area) if isinstance(polygon, shapely.Polygon)]
        axes.add_collection(
            PathCollection(
                [path for path in paths if len(path)], facecolors=face, edgecolors=_EDGE, linewidths=width, zorder=order
            ),
            autolim=False,
        )
    walls = LineCollection(list(floor.walls), colors=_WALL, linewidths=0.7, zorder=3, capstyle="round")
    axes.add_collection(walls, autolim=False)


def crop(walk: Floats, tracks: Floats) -> tuple[Floats, Floats]:
    """Return the corners (2,), (2,) of what to show: the walk, tracks that stay near it, and a margin.

    Args:
        walk: (n, 2) the truth; where it is empty the tracks take its place.
        tracks: (m, 2) all positions drawn. One that goes astray runs out of the picture rather than shrink the rest:
            kept are places within a third of the walk's extent, or 10 m, of its bounding box.
    """
    frame = walk if len(walk) else tracks
    if not len(frame):
        return np.zeros(2), np.full(2, _LEAST_M)
    low, high = frame.min(axis=0), frame.max(axis=0)
    reach = max(10.0, float(np.hypot(*(high - low))) / 3.0)
    near = tracks[((tracks >= low - reach) & (tracks <= high + reach)).all(axis=1)]
    shown = np.concatenate([frame, near])
    low, high = shown.min(axis=0) - _MARGIN_M, shown.max(axis=0) + _MARGIN_M
    extent = np.maximum(high - low, max(_LEAST_M, _SLIMMEST * float((high - low).max())))
    middle = (low + high) / 2
    return middle - extent / 2, middle + extent / 2


def _polygons(rings: Sequence[Floats]) -> list[shapely.Geometry]:
    return [shapely.make_valid(shapely.Polygon(ring)) for ring in rings if len(ring) > 2]


def _path(polygon: shapely.Polygon) -> Outline:
    # Renderers fill by winding number, so holes must run against their shell.
    wound = orient(polygon)
    rings = [np.asarray(ring.coords) for ring in (wound.exterior, *wound.interiors)]
    return Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings if len(ring)))
