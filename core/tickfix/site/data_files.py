"""The data files of a site folder.

Arrays as ``.npz`` without pickles (radio map, survey tracks, models; equal arrays give equal bytes), and floor plans as
GeoJSON in metres. Every GeoJSON feature has a property ``role``: the polygons of ``outline`` bound the floor (a
``hole`` is cut out of it), one cannot walk through the polygons of ``obstacle`` or the lines of ``wall``; other roles
are ignored. Coordinates are metres in the floor's frame, x east, y north.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import fields
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import shape

from tickfix.api import Floats, Floor, RadioMap, SiteError, TickfixError
from tickfix.site.waypoints import SurveyTrack

_KINDS: Final = frozenset("biufU")


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write ``arrays`` in the order of their names.

    Raises:
        SiteError: naming an array that is not of numbers or strings.
    """
    for name, array in arrays.items():
        if np.asarray(array).dtype.kind not in _KINDS:
            raise SiteError(f"{path.name}: {name} holds {np.asarray(array).dtype}; only numbers and strings are kept")
    with zipfile.ZipFile(path, "w") as file:
        for name in sorted(arrays):
            entry = zipfile.ZipInfo(f"{name}.npy")  # dated 1980, always
            entry.compress_type = zipfile.ZIP_DEFLATED
            with file.open(entry, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(arrays[name]), allow_pickle=False)


def load_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read what :func:`save_arrays` wrote.

    Raises:
        SiteError: when the file is missing, damaged or pickled.
    """
    try:
        file = np.load(BytesIO(path.read_bytes()), allow_pickle=False)
        if not isinstance(file, np.lib.npyio.NpzFile):
            raise SiteError(f"{path}: found a single array, expected an .npz of named arrays; survey again")
        return {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise SiteError(f"{path}: missing; restore it from a copy of the site or survey again") from None
    except (OSError, ValueError, EOFError, KeyError, AttributeError, zipfile.BadZipFile, zlib.error) as error:
        raise SiteError(f"{path}: found no readable .npz without pickles ({error}); survey again") from error


def _string_array(values: Iterable[str]) -> NDArray[np.str_]:
    return np.array(list(values), dtype=np.str_)


_TEXT_FIELDS: Final = ("floors", "transmitters", "transmitter_source")


def save_radio_map(path: Path, radio_map: RadioMap) -> None:
    """Write the fields of ``radio_map`` under their names."""
    arrays: dict[str, Any] = {field.name: getattr(radio_map, field.name) for field in fields(RadioMap)}
    arrays |= {name: _string_array(arrays[name]) for name in _TEXT_FIELDS}
    save_arrays(path, {name: np.asarray(array) for name, array in arrays.items()})


def load_radio_map(path: Path) -> RadioMap:
    """Read a radio map.

    Raises:
        SiteError: when the file is missing, damaged, or its arrays do not belong together.
    """
    arrays: dict[str, Any] = dict(load_arrays(path))
    arrays.setdefault("transmitter_source", _string_array(()))  # surveyed before transmitters had one: derived from ids
    _check_array_names(path, arrays, {field.name for field in fields(RadioMap)})
    try:
        for name in _TEXT_FIELDS:
            arrays[name] = tuple(map(str, arrays[name].tolist()))
        arrays["reach_m"] = float(arrays["reach_m"])
        radio_map = RadioMap(**arrays)
    except (TickfixError, TypeError, ValueError) as error:
        raise SiteError(f"{path}: {error}; survey again") from error
    for name, within in (
        ("point_floor", radio_map.floors),
        ("sample_point", radio_map.point_xy),
        ("sample_transmitter", radio_map.transmitters),
    ):
        index = getattr(radio_map, name)
        if index.size and not 0 <= index.min() <= index.max() < len(within):
            raise SiteError(f"{path}: {name} goes from {index.min()} to {index.max()} of {len(within)}; survey again")
    return radio_map


def save_survey_tracks(path: Path, tracks: tuple[SurveyTrack, ...]) -> None:
    """Write the tracks one after the other; ``start`` is where in ``t_ns`` and ``xy`` each begins."""
    lengths = np.array([len(track.t_ns) for track in tracks], dtype=np.int64)
    arrays: dict[str, NDArray[Any]] = {
        "walk": _string_array(track.walk for track in tracks),
        "floor": _string_array(track.floor for track in tracks),
        "chain": _string_array(track.chain for track in tracks),
        "start": np.cumsum(lengths) - lengths,
        "t_ns": np.concatenate([np.zeros(0, np.int64), *(track.t_ns for track in tracks)]),
        "xy": np.concatenate([np.zeros((0, 2)), *(track.xy for track in tracks)]),
    }
    save_arrays(path, arrays)


def load_survey_tracks(path: Path) -> tuple[SurveyTrack, ...]:
    """Read survey tracks.

    Raises:
        SiteError: when the file is missing, damaged, or its arrays do not belong together.
    """
    arrays = load_arrays(path)
    names = ("walk", "floor", "chain")
    _check_array_names(path, arrays, {*names, "start", "t_ns", "xy"})
    start, t_ns, xy = arrays["start"], arrays["t_ns"], arrays["xy"]
    integers = start.dtype.kind == t_ns.dtype.kind == "i"
    if {len(arrays[name]) for name in names} != {len(start)} or xy.shape != (*t_ns.shape, 2) or not integers:
        shapes = ", ".join(f"{name} {array.dtype} {array.shape}" for name, array in sorted(arrays.items()))
        raise SiteError(f"{path}: found {shapes}, which do not belong together; survey again")
    for array in (t_ns, xy):
        array.flags.writeable = False
    stops = [*start[1:].tolist(), len(t_ns)]
    return tuple(
        SurveyTrack(walk=str(walk), floor=str(floor), chain=str(chain), t_ns=t_ns[a:b], xy=xy[a:b])
        for walk, floor, chain, a, b in zip(*(arrays[n].tolist() for n in names), start.tolist(), stops, strict=True)
    )


def _check_array_names(path: Path, arrays: dict[str, Any], names: set[str]) -> None:
    if set(arrays) != names:
        missing, extra = sorted(names - set(arrays)), sorted(set(arrays) - names)
        raise SiteError(f"{path}: arrays missing: {missing}, unknown: {extra}; survey again")


def save_floor(path: Path, floor: Floor) -> None:
    """Write the geometry of ``floor``; name, level and size stand in ``site.json``."""
    features = [_polygon("hole" if _is_hole(i, floor.outline) else "outline", r) for i, r in enumerate(floor.outline)]
    features += [_polygon("obstacle", ring) for ring in floor.obstacles]
    features += [_feature("wall", "LineString", wall.tolist()) for wall in floor.walls]
    lines = ",\n".join(json.dumps(feature) for feature in features)
    path.write_text(f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n', encoding="utf-8")


def load_floor(
    path: Path, *, name: str, level: int, width_m: float, height_m: float, elevation_m: float | None = None
) -> Floor:
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
            _add_geometry(path, role, part, outline, obstacles, walls)
    try:
        return Floor(
            name=name,
            level=level,
            width_m=width_m,
            height_m=height_m,
            elevation_m=elevation_m,
            outline=tuple(outline),
            obstacles=tuple(obstacles),
            walls=np.concatenate(walls) if walls else np.zeros((0, 2, 2)),
        )
    except TickfixError as error:
        raise SiteError(f"{path}: {error}") from error


def _add_geometry(
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
    """Return whether ring ``i`` lies within an odd number of the others; only the label in the file depends on it."""
    point = shapely.Polygon(rings[i]).representative_point()
    return sum(bool(shapely.Polygon(ring).covers(point)) for j, ring in enumerate(rings) if j != i) % 2 == 1
