"""The walk files of the Indoor Location & Navigation format.

From lines to records and from records to events; what is broken is counted. A record is ``unix_ms TAB TYPE TAB
columns…``; lines that start with ``#`` are headers. Published files hold lines that lost their line end, so that two
records are joined. Such a line is split where 13 digits and ``TAB TYPE_`` stand. The last column of a record that no
line end closes may be truncated and is dropped, unless it is itself a complete time of 13 digits. Column 1 is the
measured time of a motion sample, but of everything else the time it was logged. Lines are not in the order of that
column, so the arrival of a line is the running maximum of column 1.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from math import isfinite, sqrt
from typing import Final, NamedTuple

import numpy as np

from tickfix.api import LATEST_NS, TICK_NS, Event, MotionSamples, Samples, Scan, Truth
from tickfix.readers.input_files import RejectCounter


class BadValueError(ValueError):
    """A record whose content cannot be; its text is the reason to count."""


def parse_numbers(columns: Sequence[bytes]) -> tuple[float, ...]:
    """Return columns as finite numbers."""
    try:
        values = tuple(map(float, columns))
    except ValueError:
        raise BadValueError("not a number") from None
    if not all(map(isfinite, values)):
        raise BadValueError("non-finite number")
    if b"_" in b"".join(columns):  # Python reads 1_0 as 10, writers of such files never do
        raise BadValueError("not a number")
    return values


def parse_rssi(column: bytes) -> float:
    """Return a received signal strength in dBm."""
    (rssi_dbm,) = parse_numbers([column])
    if not -127.0 < rssi_dbm < 0.0:  # −127 and 0 are Android's words for "unknown"
        raise BadValueError("implausible rssi")
    return rssi_dbm


def parse_identifier(column: bytes) -> str:
    """Return a transmitter's id, or a part of one."""
    if not column or not column.isascii() or not column.decode("ascii").isprintable() or b" " in column:
        raise BadValueError("broken transmitter id")
    return column.decode("ascii")


def complete_quaternion(x: float, y: float, z: float) -> tuple[float, ...]:
    """Complete Android's rotation vector (x, y, z of a unit quaternion with w ≥ 0)."""
    square = x * x + y * y + z * z
    if square <= 1.0:
        return x, y, z, sqrt(1.0 - square)
    if square > 1.01:
        raise BadValueError("not a rotation")
    norm = sqrt(square)  # rounding pushed a half turn just over one
    return x / norm, y / norm, z / norm, 0.0


EVENT_TYPES: Final = {
    b"TYPE_ACCELEROMETER": (5, 6),
    b"TYPE_GYROSCOPE": (5, 6),
    b"TYPE_MAGNETIC_FIELD": (5, 6),
    b"TYPE_ROTATION_VECTOR": (5, 6),
    b"TYPE_WIFI": (7, 7),
    b"TYPE_BEACON": (7, 10),
    b"TYPE_WAYPOINT": (4, 4),
}
"""The types that become events: least and greatest number of columns, time and type included."""

IGNORED_TYPES: Final = frozenset(
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

MAX_TIME_OFFSET_MS: Final = 24 * 3600 * 1000
"""No walk takes a day: a time further than that from the file's median is broken."""

_LATEST_MS: Final = LATEST_NS // 1_000_000
_TIME: Final = re.compile(rb"^[0-9]{13}(?=\tTYPE_)", re.MULTILINE)
_WIFI: Final = re.compile(rb"([0-9]{13})\tTYPE_WIFI\t")
_JOIN: Final = re.compile(rb"[0-9]{13}\tTYPE_")
_FLOOR_NAME: Final = re.compile(rb"\tFloorName:([^\t\r\n]*)")


class LogEntry(NamedTuple):
    """One record that may become an event.

    Attributes:
        line: its number in the file, from 1.
        ms: column 1.
        logged_ms: the running maximum of column 1, over lines of all known types.
        type: one of :data:`EVENT_TYPES`.
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


def last_line_of_scans(data: bytes) -> dict[int, int]:
    """Return the number of the last line of each Wi-Fi scan, by the time that its lines share."""
    lines = enumerate(data.split(b"\n"), 1)
    return {int(ms): number for number, text in lines if b"\tTYPE_WIFI\t" in text for ms in _WIFI.findall(text)}


def log_entries(data: bytes, rejects: RejectCounter) -> Iterator[LogEntry]:
    """Yield the usable records of a recording in the order of the file."""
    times = sorted(_TIME.findall(data))
    middle_ms = int(times[len(times) // 2]) if times else 0
    logged_ms = 0
    for line, text, closed in _split_joined_lines(data, rejects):
        time = text[:13]
        if text[13:14] != b"\t" or not time.isdigit():
            if not text.isspace():
                rejects.add("broken line", line, text)
            continue
        ms = int(time)
        kind = text[14:].split(b"\t", 1)[0]
        used = EVENT_TYPES.get(kind)
        if used is None and kind.rstrip(b"\r") not in IGNORED_TYPES:
            rejects.add("unknown type" if closed else "cut line", line, text)
        elif abs(ms - middle_ms) > MAX_TIME_OFFSET_MS:
            rejects.add("implausible time", line, f"{ms} ms, but {middle_ms} ms in the middle of the file")
        elif ms > _LATEST_MS:
            rejects.add("implausible time", line, f"{ms} ms, beyond {_LATEST_MS} ms")
        else:
            logged_ms = max(logged_ms, ms)
            if used is not None:
                columns = _complete_columns(text, closed)
                if used[0] <= len(columns) <= used[1]:
                    yield LogEntry(line, ms, logged_ms, kind, columns[2:])
                else:
                    many = "too many columns" if len(columns) > used[1] else "missing columns"
                    rejects.add(many if closed else "cut line", line, text)


def _split_joined_lines(data: bytes, rejects: RejectCounter) -> Iterator[tuple[int, bytes, bool]]:
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


def _complete_columns(text: bytes, closed: bool) -> list[bytes]:  # noqa: FBT001 - a fact of the line
    """Return the columns that are certain."""
    columns = text.removesuffix(b"\r").split(b"\t")
    if not closed and not (len(columns[-1]) == 13 and columns[-1].isdigit()):
        columns.pop()
    return columns


BATCH_NS: Final = TICK_NS // 2
"""Motion lines are batched by cells of this grid, so that a batch never crosses a tick."""

MAX_CLOCK_SKEW_NS: Final = 2_000_000_000
"""Last-seen times come from another clock of the phone: one so little ahead of the log's counts as the log's."""

_MS: Final = 1_000_000
_MOTION_SENSORS: Final = {
    b"TYPE_ACCELEROMETER": "accelerometer",
    b"TYPE_GYROSCOPE": "gyroscope",
    b"TYPE_MAGNETIC_FIELD": "magnetometer",
    b"TYPE_ROTATION_VECTOR": "rotation_vector",
}


def build_events(
    entries: Iterable[LogEntry], scan_ends: Mapping[int, int], name: str, floor: str, rejects: RejectCounter
) -> tuple[Event, ...]:
    """Return the events of one walk in the order they were logged.

    Args:
        entries: in the order of the file.
        scan_ends: number of the last line of each Wi-Fi scan, by its time in milliseconds.
        name: of the recording; it becomes device and session of the events.
        floor: of the waypoints.
        rejects: takes the records whose values cannot be.
    """
    builder = _EventBuilder(name, floor)
    handlers: dict[bytes, Callable[[LogEntry], None]] = dict.fromkeys(_MOTION_SENSORS, builder.motion)
    handlers |= {b"TYPE_WIFI": builder.wifi, b"TYPE_BEACON": builder.beacon, b"TYPE_WAYPOINT": builder.waypoint}
    for entry in entries:
        if builder.open_scans:
            for ms in [ms for ms in builder.open_scans if scan_ends[ms] < entry.line]:
                builder.close_scan(ms)
        builder.arrival_ns = entry.logged_ms * _MS
        try:
            handlers[entry.type](entry)
        except BadValueError as error:
            rejects.add(str(error), entry.line, b"\t".join(entry.columns))
    for ms in tuple(builder.open_scans):
        builder.close_scan(ms)
    builder.flush_motion()
    return tuple(builder.events)


class _EventBuilder:
    """Collects events; the only state is what is not yet complete: one batch of motion, and open scans."""

    def __init__(self, name: str, floor: str) -> None:
        self.events: list[Event] = []
        self.arrival_ns = 0
        self.open_scans: defaultdict[int, list[tuple[str, float, int]]] = defaultdict(list)
        self._name = name
        self._floor = floor
        self._seq = 0
        self._truths = 0
        self._batch: defaultdict[str, tuple[list[int], list[tuple[float, ...]]]] = defaultdict(lambda: ([], []))
        self._batch_cell = (0, 0)
        self._batch_arrival_ns = 0

    def motion(self, entry: LogEntry) -> None:
        """Add a sample to the batch; a batch lies within one cell of time and of arrival."""
        t_ns = entry.ms * _MS
        x, y, z = parse_numbers(entry.columns[:3])
        sensor = _MOTION_SENSORS[entry.type]
        values = complete_quaternion(x, y, z) if sensor == "rotation_vector" else (x, y, z)
        cell = (-(-t_ns // BATCH_NS), -(-self.arrival_ns // BATCH_NS))
        if cell != self._batch_cell:
            self.flush_motion()
            self._batch_cell = cell
        times, rows = self._batch[sensor]
        times.append(t_ns)
        rows.append(values)
        self._batch_arrival_ns = self.arrival_ns

    def wifi(self, entry: LogEntry) -> None:
        """Add a reading to the scan that was logged at the record's time."""
        _ssid, bssid, strength, _frequency, last_seen = entry.columns
        if not last_seen.isdigit():
            raise BadValueError("not a number")
        heard_ns, logged_ns = int(last_seen) * _MS, entry.ms * _MS
        if heard_ns > logged_ns + MAX_CLOCK_SKEW_NS:
            raise BadValueError("heard after it was logged")
        if heard_ns < logged_ns - 24 * 3600 * 1000 * _MS:
            raise BadValueError("implausible time")
        reading = (parse_identifier(bssid), parse_rssi(strength), min(heard_ns, logged_ns))
        self.open_scans[entry.ms].append(reading)

    def close_scan(self, ms: int) -> None:
        """Emit the scan that was logged at ``ms``."""
        self._scan(self.open_scans.pop(ms), "wifi")

    def beacon(self, entry: LogEntry) -> None:
        """Emit a beacon as a scan of its own.

        Its id ends with the MAC address: the beacons of a whole building may share UUID, major and minor.
        """
        uuid, major, minor, _power, strength, *rest = entry.columns
        parts = [uuid, major, minor, *(rest[1:2] if len(rest) > 1 and rest[1] else [])]
        name = "ble:" + ":".join(parse_identifier(part) for part in parts)
        self._scan([(name, parse_rssi(strength), entry.ms * _MS)], "ble")

    def waypoint(self, entry: LogEntry) -> None:
        """Emit a waypoint; it counts by itself, so that truth leaves no trace in what trackers see."""
        xy = np.array(parse_numbers(entry.columns))
        self.flush_motion()
        self.events.append(
            Truth(
                t_ns=entry.ms * _MS,
                floor=self._floor,
                xy=xy,
                device=self._name,
                arrival_ns=self.arrival_ns,
                session=self._name,
                seq=self._truths,
            )
        )
        self._truths += 1

    def flush_motion(self) -> None:
        """Emit the batch."""
        if not self._batch:
            return
        sensors = {sensor: Samples(np.array(times), np.array(rows)) for sensor, (times, rows) in self._batch.items()}
        self._batch.clear()
        self.events.append(
            MotionSamples(
                sensors=sensors,
                device=self._name,
                arrival_ns=self._batch_arrival_ns,
                session=self._name,
                seq=self._next_seq(),
            )
        )

    def _scan(self, readings: Sequence[tuple[str, float, int]], source: str) -> None:
        self.flush_motion()
        transmitters, rssi_dbm, heard_ns = zip(*readings, strict=True)
        self.events.append(
            Scan(
                transmitters=transmitters,
                rssi_dbm=np.array(rssi_dbm),
                heard_ns=np.array(heard_ns),
                source=source,
                device=self._name,
                arrival_ns=self.arrival_ns,
                session=self._name,
                seq=self._next_seq(),
            )
        )

    def _next_seq(self) -> int:
        self._seq += 1
        return self._seq - 1
