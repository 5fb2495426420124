"""Reader of the Indoor Location & Navigation recordings (github location-competition/indoor-location-competition-20),
and of the floor plans beside them. A building is a folder of floor folders; a floor folder holds
``path_data_files/*.txt``, ``floor_info.json`` and ``geojson_map.json``. Files may be gzipped. The bounding box of
the first GeoJSON feature, the floor's outline, is the rectangle ``width`` × ``height`` metres of
``floor_info.json`` with its origin in the south-west corner; all other polygons are obstacles.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Final

import numpy as np
import shapely
from shapely.geometry import shape

from tickfix.api import Floats, Floor, ReaderError, Recording
from tickfix.readers.indoor_location_log import build_events, floor_name, last_line_of_scans, log_entries
from tickfix.readers.input_files import RejectCounter, read_bytes

FLOOR_INFO_FILE: Final = "floor_info.json"
FLOOR_MAP_FILE: Final = "geojson_map.json"

_LEVEL: Final = re.compile(r"(?P<below>B)?[FLP]?(?P<number>\d+)[FL]?", re.IGNORECASE)
_BELOW: Final = re.compile(r"(\d+)B", re.IGNORECASE)


def level_from_name(name: str) -> int:
    """Return the storey in a floor's name: F1, 1F, L1 → 1; B1, 1B → −1; 0 if there is none."""
    if match := _LEVEL.fullmatch(name):
        return -int(match["number"]) if match["below"] else int(match["number"])
    match = _BELOW.fullmatch(name)
    return -int(match[1]) if match else 0


def read_floor_plan(folder: Path) -> Floor | None:
    """Return the floor stored in ``folder``, named like it: None without any plan, no geometry where a file is missing.

    Raises:
        ReaderError: naming the file that is broken and what was found there.
    """
    info, plan = folder / FLOOR_INFO_FILE, folder / FLOOR_MAP_FILE
    if not info.exists() and not plan.exists():
        return None
    if not info.exists():
        return Floor(name=folder.name, level=level_from_name(folder.name))
    width, height = _read_size(info)
    if not plan.exists():
        return Floor(name=folder.name, level=level_from_name(folder.name), width_m=width, height_m=height)
    outline, obstacles, walls = _read_geometry(plan, width, height)
    return Floor(
        name=folder.name,
        level=level_from_name(folder.name),
        width_m=width,
        height_m=height,
        outline=outline,
        obstacles=obstacles,
        walls=walls,
    )


def _read_json(path: Path) -> Any:
    try:
        return json.loads(path.read_bytes())
    except OSError as error:
        raise ReaderError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise ReaderError(f"{path}: found no JSON ({error}); restore the published file or remove it") from error


def _read_size(path: Path) -> tuple[float, float]:
    try:
        info = _read_json(path)["map_info"]
        width, height = float(info["width"]), float(info["height"])
    except (KeyError, TypeError, ValueError) as error:
        raise ReaderError(f"{path}: expected numbers map_info.width and map_info.height in metres") from error
    if not (0.0 < width < math.inf and 0.0 < height < math.inf):
        raise ReaderError(f"{path}: found {width} × {height} m, expected a positive width and height")
    return width, height


def _read_geometry(path: Path, width: float, height: float) -> tuple[tuple[Floats, ...], tuple[Floats, ...], Floats]:
    try:
        features = [feature for feature in _read_json(path)["features"] if feature["geometry"] is not None]
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
    walls = [np.stack([xy[:-1], xy[1:]], axis=1) for s in metric[1:] for xy in _line_strings(s)]
    return (
        tuple(_open_ring(ring) for ring in outline),
        tuple(_open_ring(ring) for ring in obstacles),
        np.concatenate(walls) if walls else np.zeros((0, 2, 2)),
    )


def _polygons(geometry: Any) -> list[Any]:
    return [part for part in shapely.get_parts(geometry) if part.geom_type == "Polygon" and not part.is_empty]


def _line_strings(geometry: Any) -> list[Floats]:
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


def _open_ring(ring: Any) -> Floats:
    """Return the ring's points without the last, which repeats the first."""
    return np.asarray(ring.coords, dtype=np.float64)[:-1, :2]


WALKS_FOLDER: Final = "path_data_files"


class IndoorLocationReader:
    """Reads smartphone walks with waypoints, see :mod:`tickfix.readers.indoor_location_log` for the format."""

    kind: ClassVar[str] = "reader"
    name: ClassVar[str] = "indoor-location"

    def recordings(self, path: Path) -> Sequence[Path]:
        """Return the walks at ``path``: a file, a floor folder, a building or any folder of these; sorted by path.

        In a folder ``path_data_files`` every ``.txt`` and ``.txt.gz`` is a walk; elsewhere only what looks like one.
        """
        if path.is_file():
            return [path] if _is_walk(path) else []
        return sorted(file for file in path.rglob("*.txt*") if file.is_file() and _is_walk(file))

    def read(self, path: Path) -> Recording:
        """Read one walk.

        Motion samples are batched within half ticks; a scan's readings keep their last-seen times; a beacon is a scan
        of source ``"ble"`` whose transmitter is ``ble:uuid:major:minor:mac``. ``arrival_ns`` is the running maximum of
        the lines' times. What cannot be used is counted in ``rejected`` by reason.

        Raises:
            ReaderError: when the file cannot be opened, or holds nothing that could be used.
        """
        rejects = RejectCounter()
        data, damage = read_bytes(path)
        if damage:
            rejects.add("cut gzip", data.count(b"\n") + 1, damage)
        name = path.name.removesuffix(".gz").removesuffix(".txt")
        folder = _floor_folder(path)
        floor = floor_name(data) if folder is None else folder.name
        events = build_events(log_entries(data, rejects), last_line_of_scans(data), name, floor, rejects)
        if not events:
            seen = "; ".join(rejects.problems[:3]) or f"{len(data)} bytes without a record"
            raise ReaderError(f"{path}: nothing could be read ({seen}); expected lines 'unix_ms TAB TYPE_… TAB values'")
        return Recording(
            name=name,
            floor=floor,
            events=events,
            rejected=MappingProxyType(rejects.counts),
            problems=rejects.problems,
            path=path,
        )

    def floor(self, path: Path) -> Floor | None:
        """Return the plan of the floor of the walk at ``path``, or of the floor folder ``path``; None where none is.

        Raises:
            ReaderError: naming the file of the plan that is broken.
        """
        folder = path if path.is_dir() else _floor_folder(path)
        return None if folder is None else read_floor_plan(folder)


def _is_walk(path: Path) -> bool:
    if not path.name.endswith((".txt", ".txt.gz")):
        return False
    if path.parent.name == WALKS_FOLDER:
        return True
    try:
        head, _ = read_bytes(path, limit=4096)
    except ReaderError:
        return False
    return b"\tTYPE_" in head or head.startswith(b"#\tstartTime:")


def _floor_folder(path: Path) -> Path | None:
    folder = path.absolute().parent
    if folder.name == WALKS_FOLDER:
        return folder.parent
    return folder if (folder / FLOOR_INFO_FILE).exists() or (folder / FLOOR_MAP_FILE).exists() else None
