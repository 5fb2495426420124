"""The plan of a floor of an indoor-location building: longitude and latitude in, metres out.

The bounding box of the first GeoJSON feature, the floor's outline, is the rectangle ``width`` × ``height`` metres of
``floor_info.json`` with its origin in the south-west corner. All other polygons are shops and shafts.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from shapely.geometry import shape

from tickfix.api import Floats, Floor, ReaderError

INFO: Final = "floor_info.json"
MAP: Final = "geojson_map.json"

_LEVEL: Final = re.compile(r"(?P<below>B)?[FLP]?(?P<number>\d+)[FL]?", re.IGNORECASE)
_BELOW: Final = re.compile(r"(\d+)B", re.IGNORECASE)


def level_of(name: str) -> int:
    """Return the storey that a floor's name tells: F1, 1F, L1 → 1; B1, 1B → −1; 0 where it tells none."""
    if match := _LEVEL.fullmatch(name):
        return -int(match["number"]) if match["below"] else int(match["number"])
    match = _BELOW.fullmatch(name)
    return -int(match[1]) if match else 0


def read_floor(folder: Path) -> Floor | None:
    """Return the floor stored in ``folder``, named like it: None without any plan, no geometry where a file is missing.

    Raises:
        ReaderError: naming the file that is broken and what was found there.
    """
    info, plan = folder / INFO, folder / MAP
    if not info.exists() and not plan.exists():
        return None
    if not info.exists():
        return Floor(name=folder.name, level=level_of(folder.name))
    width, height = _size(info)
    if not plan.exists():
        return Floor(name=folder.name, level=level_of(folder.name), width_m=width, height_m=height)
    outline, obstacles, walls = _geometry(plan, width, height)
    return Floor(
        name=folder.name,
        level=level_of(folder.name),
        width_m=width,
        height_m=height,
        outline=outline,
        obstacles=obstacles,
        walls=walls,
    )


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_bytes())
    except OSError as error:
        raise ReaderError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise ReaderError(f"{path}: found no JSON ({error}); restore the published file or remove it") from error


def _size(path: Path) -> tuple[float, float]:
    try:
        info = _json(path)["map_info"]
        width, height = float(info["width"]), float(info["height"])
    except (KeyError, TypeError, ValueError) as error:
        raise ReaderError(f"{path}: expected numbers map_info.width and map_info.height in metres") from error
    if not (0.0 < width < math.inf and 0.0 < height < math.inf):
        raise ReaderError(f"{path}: found {width} × {height} m, expected a positive width and height")
    return width, height


def _geometry(path: Path, width: float, height: float) -> tuple[tuple[Floats, ...], tuple[Floats, ...], Floats]:
    try:
        features = [feature for feature in _json(path)["features"] if feature["geometry"] is not None]
        shapes = [shape(feature["geometry"]) for feature in features]
    except ReaderError:
        raise
    except Exception as error:
        raise ReaderError(f"{path}: found no GeoJSON feature collection ({type(error).__name__}: {error})") from error
    if not shapes or not _polygons(shapes[0]):
        raise ReaderError(f"{path}: the first feature must be the floor's outline, a polygon")
    west, south, east, north = shapes[0].bounds
    if not (west < east and south < north and all(map(math.isfinite, (west, south, east, north)))):
        raise ReaderError(f"{path}: the outline spans {west}…{east} by {south}…{north} degrees, expected an area")
    scale = np.array([width / (east - west), height / (north - south)])
    metric = [shapely.transform(s, lambda lonlat: (lonlat - [west, south]) * scale) for s in shapes]
    outline = [ring for polygon in _polygons(metric[0]) for ring in (polygon.exterior, *polygon.interiors)]
    obstacles = [whole.exterior for s in metric[1:] for polygon in _polygons(s) for whole in _without_holes(polygon)]
    walls = [np.stack([xy[:-1], xy[1:]], axis=1) for s in metric[1:] for xy in _lines(s)]
    return (
        tuple(_open(ring) for ring in outline),
        tuple(_open(ring) for ring in obstacles),
        np.concatenate(walls) if walls else np.zeros((0, 2, 2)),
    )


def _polygons(geometry: Any) -> list[Any]:
    return [part for part in shapely.get_parts(geometry) if part.geom_type == "Polygon" and not part.is_empty]


def _lines(geometry: Any) -> list[Floats]:
    return [shapely.get_coordinates(part) for part in shapely.get_parts(geometry) if part.geom_type == "LineString"]


def _without_holes(polygon: Any) -> list[Any]:
    """Cut a polygon through its holes, until none of the pieces has one: an obstacle is a ring."""
    if not polygon.interiors:
        return [polygon]
    if not polygon.is_valid:
        return [piece for part in _polygons(shapely.make_valid(polygon)) for piece in _without_holes(part)]
    x = polygon.interiors[0].centroid.x
    west, south, east, north = polygon.bounds
    halves = (shapely.box(west, south, x, north), shapely.box(x, south, east, north))
    return [piece for half in halves for part in _polygons(polygon & half) for piece in _without_holes(part)]


def _open(ring: Any) -> Floats:
    """Return the ring's points without the last, which repeats the first."""
    return np.asarray(ring.coords, dtype=np.float64)[:-1, :2]
