"""Reader of the Indoor Location & Navigation recordings (github location-competition/indoor-location-competition-20).

A building is a folder of floor folders; a floor folder holds ``path_data_files/*.txt``, ``floor_info.json`` and
``geojson_map.json``. Files may be gzipped.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Final

from tickfix.api import Floor, ReaderError, Recording
from tickfix.readers.compressed import read_bytes
from tickfix.readers.indoor_location_events import build_events
from tickfix.readers.indoor_location_floor import INFO, MAP, read_floor
from tickfix.readers.indoor_location_lines import floor_name, records, scan_ends
from tickfix.readers.rejects import Rejects

WALKS: Final = "path_data_files"


class IndoorLocationReader:
    """Reads smartphone walks with waypoints, see :mod:`tickfix.readers.indoor_location_lines` for the format."""

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
        rejects = Rejects()
        data, damage = read_bytes(path)
        if damage:
            rejects.add("cut gzip", data.count(b"\n") + 1, damage)
        name = path.name.removesuffix(".gz").removesuffix(".txt")
        folder = _floor_folder(path)
        floor = floor_name(data) if folder is None else folder.name
        events = build_events(records(data, rejects), scan_ends(data), name, floor, rejects)
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
        return None if folder is None else read_floor(folder)


def _is_walk(path: Path) -> bool:
    if not path.name.endswith((".txt", ".txt.gz")):
        return False
    if path.parent.name == WALKS:
        return True
    try:
        head, _ = read_bytes(path, limit=4096)
    except ReaderError:
        return False
    return b"\tTYPE_" in head or head.startswith(b"#\tstartTime:")


def _floor_folder(path: Path) -> Path | None:
    folder = path.absolute().parent
    if folder.name == WALKS:
        return folder.parent
    return folder if (folder / INFO).exists() or (folder / MAP).exists() else None
