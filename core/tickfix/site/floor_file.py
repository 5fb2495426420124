"""A floor's plan as GeoJSON in metres, which people edit in any GIS tool.

Every feature has a property ``role``: the polygons of ``outline`` bound the floor (a ``hole`` is a part of it that is
not there), nobody walks through the polygons of ``obstacle`` or the lines of ``wall``. Features of other roles are left
alone. Coordinates are metres in the floor's frame, x east, y north.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import shape

from tickfix.api import Floats, Floor, SiteError, TickfixError


def save_floor(path: Path, floor: Floor) -> None:
    """Write the geometry of ``floor``; name, level and size stand in ``site.json``."""
    features = [_polygon("hole" if _is_hole(i, floor.outline) else "outline", r) for i, r in enumerate(floor.outline)]
    features += [_polygon("obstacle", ring) for ring in floor.obstacles]
    features += [_feature("wall", "LineString", wall.tolist()) for wall in floor.walls]
    lines = ",\n".join(json.dumps(feature) for feature in features)
    path.write_text(f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n', encoding="utf-8")


def load_floor(path: Path, *, name: str, level: int, width_m: float, height_m: float) -> Floor:
    """Read what :func:`save_floor` wrote or somebody edited: multi-part shapes and lines of many points are taken too.

    Raises:
        SiteError: when the file is missing or no GeoJSON that fits.
    """
    try:
        features = json.loads(path.read_bytes())["features"]
        shapes = [(feature["properties"]["role"], shape(feature["geometry"])) for feature in features]
    except FileNotFoundError:
        raise SiteError(f"{path}: missing; restore it from a copy of the site or survey again") from None
    except Exception as error:
        raise SiteError(
            f"{path}: found no GeoJSON feature collection with a role in each feature's properties "
            f"({type(error).__name__}: {error}); undo the last edit or survey again"
        ) from error
    outline: list[Floats] = []
    obstacles: list[Floats] = []
    walls: list[Floats] = []
    for role, geometry in shapes:
        for part in shapely.get_parts(geometry):
            _take(path, role, part, outline, obstacles, walls)
    try:
        return Floor(
            name=name,
            level=level,
            width_m=width_m,
            height_m=height_m,
            outline=tuple(outline),
            obstacles=tuple(obstacles),
            walls=np.concatenate(walls) if walls else np.zeros((0, 2, 2)),
        )
    except TickfixError as error:
        raise SiteError(f"{path}: {error}") from error


def _take(
    path: Path, role: str, part: Any, outline: list[Floats], obstacles: list[Floats], walls: list[Floats]
) -> None:
    expected = {"outline": "Polygon", "hole": "Polygon", "obstacle": "Polygon", "wall": "LineString"}.get(role)
    if expected is None:
        return
    xy = shapely.get_coordinates(part)
    if part.geom_type != expected or len(xy) < 2 or not np.isfinite(xy).all():
        raise SiteError(f"{path}: found {part.geom_type} with {len(xy)} points as {role}, expected a finite {expected}")
    if role == "wall":
        walls.append(np.stack([xy[:-1], xy[1:]], axis=1))
    elif role == "obstacle":
        if len(part.interiors):
            raise SiteError(f"{path}: found an obstacle with a hole; cut it into pieces without holes")
        obstacles.append(_ring(part.exterior))
    else:
        outline.extend(_ring(ring) for ring in (part.exterior, *part.interiors))


def _ring(ring: Any) -> Floats:
    return np.asarray(ring.coords, dtype=np.float64)[:-1, :2]


def _polygon(role: str, ring: Floats) -> dict[str, Any]:
    points = ring.tolist()
    return _feature(role, "Polygon", [[*points, points[0]] if points[0] != points[-1] else points])


def _feature(role: str, kind: str, coordinates: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": {"role": role},
        "geometry": {"type": kind, "coordinates": coordinates},
    }


def _is_hole(i: int, rings: tuple[Floats, ...]) -> bool:
    """Tell whether ring ``i`` lies within an odd number of the others; only the label in the file depends on it."""
    point = shapely.Polygon(rings[i]).representative_point()
    return sum(bool(shapely.Polygon(ring).covers(point)) for j, ring in enumerate(rings) if j != i) % 2 == 1
