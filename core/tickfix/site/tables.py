"""Radio map and survey tracks as named arrays in files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tickfix.api import RadioMap, SiteError, TickfixError
from tickfix.site.arrays_file import load_arrays, save_arrays
from tickfix.site.site import SurveyTrack


def _strings(values: Iterable[str]) -> NDArray[np.str_]:
    return np.array(list(values), dtype=np.str_)


def save_radio_map(path: Path, radio_map: RadioMap) -> None:
    """Write the fields of ``radio_map`` under their names."""
    arrays: dict[str, Any] = {field.name: getattr(radio_map, field.name) for field in fields(RadioMap)}
    arrays |= {name: _strings(arrays[name]) for name in ("floors", "transmitters")}
    save_arrays(path, {name: np.asarray(array) for name, array in arrays.items()})


def load_radio_map(path: Path) -> RadioMap:
    """Read a radio map.

    Raises:
        SiteError: when the file is missing, damaged, or its arrays do not belong together.
    """
    arrays: dict[str, Any] = dict(load_arrays(path))
    _expect(path, arrays, {field.name for field in fields(RadioMap)})
    try:
        for name in ("floors", "transmitters"):
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


def save_tracks(path: Path, tracks: tuple[SurveyTrack, ...]) -> None:
    """Write the tracks one after the other; ``start`` says where in ``t_ns`` and ``xy`` each begins."""
    lengths = np.array([len(track.t_ns) for track in tracks], dtype=np.int64)
    arrays: dict[str, NDArray[Any]] = {
        "walk": _strings(track.walk for track in tracks),
        "floor": _strings(track.floor for track in tracks),
        "chain": _strings(track.chain for track in tracks),
        "start": np.cumsum(lengths) - lengths,
        "t_ns": np.concatenate([np.zeros(0, np.int64), *(track.t_ns for track in tracks)]),
        "xy": np.concatenate([np.zeros((0, 2)), *(track.xy for track in tracks)]),
    }
    save_arrays(path, arrays)


def load_tracks(path: Path) -> tuple[SurveyTrack, ...]:
    """Read survey tracks.

    Raises:
        SiteError: when the file is missing, damaged, or its arrays do not belong together.
    """
    arrays = load_arrays(path)
    names = ("walk", "floor", "chain")
    _expect(path, arrays, {*names, "start", "t_ns", "xy"})
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


def _expect(path: Path, arrays: dict[str, Any], names: set[str]) -> None:
    if set(arrays) != names:
        missing, extra = sorted(names - set(arrays)), sorted(set(arrays) - names)
        raise SiteError(f"{path}: arrays missing: {missing}, unknown: {extra}; survey again")
