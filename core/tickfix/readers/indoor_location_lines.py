"""The lines of an indoor-location recording: text in, records out; what is broken is counted.

A record is ``unix_ms TAB TYPE TAB columns…``; lines that start with ``#`` are headers. Published files hold lines that
lost their line end, so that two records are glued into one. Such a line is taken apart where 13 digits and ``TAB
TYPE_`` stand. The last column of a record that no line end closes may be cut, and half a number looks like a number:
it is dropped, unless it is itself a complete time of 13 digits. What then lacks a column is rejected as such.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from tickfix.api import LATEST_NS
from tickfix.readers.rejects import Rejects

USED: Final = {
    b"TYPE_ACCELEROMETER": (5, 6),
    b"TYPE_GYROSCOPE": (5, 6),
    b"TYPE_MAGNETIC_FIELD": (5, 6),
    b"TYPE_ROTATION_VECTOR": (5, 6),
    b"TYPE_WIFI": (7, 7),
    b"TYPE_BEACON": (7, 10),
    b"TYPE_WAYPOINT": (4, 4),
}
"""The types that become events: least and greatest number of columns, time and type included."""

UNUSED: Final = frozenset(
    {
        b"TYPE_ACCELEROMETER_UNCALIBRATED",
        b"TYPE_GYROSCOPE_UNCALIBRATED",
        b"TYPE_MAGNETIC_FIELD_UNCALIBRATED",
        b"TYPE_BLUE",
        b"TYPE_BLU4",
        b"TYPE_DIST1",
        b"TYPE_DIST2",
        b"TYPE_SENSOR_MAGNETIC_FIELD_ACCURACY_CHANGED",
    }
)
"""The types that tickfix knows and leaves alone."""

PLAUSIBLE_MS: Final = 24 * 3600 * 1000
"""No walk takes a day: a time further than that from the file's median is broken."""

_LATEST_MS: Final = LATEST_NS // 1_000_000
_TIME: Final = re.compile(rb"^[0-9]{13}(?=\tTYPE_)", re.MULTILINE)
_WIFI: Final = re.compile(rb"([0-9]{13})\tTYPE_WIFI\t")
_JOIN: Final = re.compile(rb"[0-9]{13}\tTYPE_")
_FLOOR_NAME: Final = re.compile(rb"\tFloorName:([^\t\r\n]*)")


class Record(NamedTuple):
    """One record that may become an event.

    Attributes:
        line: its number in the file, from 1.
        ms: column 1.
        logged_ms: the running maximum of column 1, over lines of all known types.
        type: one of :data:`USED`.
        columns: all further columns.
    """

    line: int
    ms: int
    logged_ms: int
    type: bytes
    columns: list[bytes]


def floor_name(data: bytes) -> str:
    """Return the floor that the header of a recording names, empty where it names none."""
    header = _FLOOR_NAME.search(data[:4096])
    return header[1].decode("utf-8", "replace").strip() if header else ""


def scan_ends(data: bytes) -> dict[int, int]:
    """Return the number of the last line of each Wi-Fi scan, by the time that its lines share."""
    lines = enumerate(data.split(b"\n"), 1)
    return {int(ms): number for number, text in lines if b"\tTYPE_WIFI\t" in text for ms in _WIFI.findall(text)}


def records(data: bytes, rejects: Rejects) -> Iterator[Record]:
    """Yield the usable records of a recording in the order of the file."""
    times = sorted(_TIME.findall(data))
    middle_ms = int(times[len(times) // 2]) if times else 0
    logged_ms = 0
    for line, text, closed in _pieces(data, rejects):
        time = text[:13]
        if text[13:14] != b"\t" or not time.isdigit():
            if not text.isspace():
                rejects.add("broken line", line, text)
            continue
        ms = int(time)
        kind = text[14:].split(b"\t", 1)[0]
        used = USED.get(kind)
        if used is None and kind.rstrip(b"\r") not in UNUSED:
            rejects.add("unknown type" if closed else "cut line", line, text)
        elif abs(ms - middle_ms) > PLAUSIBLE_MS:
            rejects.add("implausible time", line, f"{ms} ms, but {middle_ms} ms in the middle of the file")
        elif ms > _LATEST_MS:
            rejects.add("implausible time", line, f"{ms} ms, beyond {_LATEST_MS} ms")
        else:
            logged_ms = max(logged_ms, ms)
            if used is not None:
                columns = _columns(text, closed)
                if used[0] <= len(columns) <= used[1]:
                    yield Record(line, ms, logged_ms, kind, columns[2:])
                else:
                    many = "too many columns" if len(columns) > used[1] else "missing columns"
                    rejects.add(many if closed else "cut line", line, text)


def _pieces(data: bytes, rejects: Rejects) -> Iterator[tuple[int, bytes, bool]]:
    """Yield line number, text and whether a line end closes it, for each piece of text that is or may be a record."""
    lines = data.split(b"\n")
    for number, text in enumerate(lines, 1):
        if not text or text.startswith(b"#"):
            continue
        closed = number < len(lines)
        if text.find(b"\tTYPE_", 14) < 0:
            yield number, text, closed
            continue
        starts = [match.start() for match in _JOIN.finditer(text) if match.start() > 0]
        if starts:
            rejects.add("joined line", number, text)
        for start, stop in zip([0, *starts], [*starts, len(text)], strict=True):
            yield number, text[start:stop], closed and stop == len(text)


def _columns(text: bytes, closed: bool) -> list[bytes]:  # noqa: FBT001 - a fact of the line
    """Return the columns that are certain."""
    columns = text.removesuffix(b"\r").split(b"\t")
    if not closed and not (len(columns[-1]) == 13 and columns[-1].isdigit()):
        columns.pop()
    return columns
