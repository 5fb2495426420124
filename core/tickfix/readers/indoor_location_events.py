"""Records of an indoor-location recording become events.

Column 1 is the measured time of a motion sample, but of everything else the time it was logged. Lines are not in the
order of that column: sensors and Bluetooth come in bursts. What reached the phone's log first stands first in the file,
so the arrival of a line is the running maximum of column 1.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final

import numpy as np

from tickfix.api import TICK_NS, Event, MotionSamples, Samples, Scan, Truth
from tickfix.readers.indoor_location_lines import Record
from tickfix.readers.indoor_location_values import BadValueError, identifier, numbers, quaternion, rssi
from tickfix.readers.rejects import Rejects

BATCH_NS: Final = TICK_NS // 2
"""Motion lines are batched by cells of this grid, so that a batch never crosses a tick."""

CLOCKS_NS: Final = 2_000_000_000
"""Last-seen times come from another clock of the phone: one so little ahead of the log's counts as the log's."""

_MS: Final = 1_000_000
_MOTION: Final = {
    b"TYPE_ACCELEROMETER": "accelerometer",
    b"TYPE_GYROSCOPE": "gyroscope",
    b"TYPE_MAGNETIC_FIELD": "magnetometer",
    b"TYPE_ROTATION_VECTOR": "rotation_vector",
}


def build_events(
    records: Iterable[Record], scan_ends: Mapping[int, int], name: str, floor: str, rejects: Rejects
) -> tuple[Event, ...]:
    """Return the events of one walk in the order they were logged.

    Args:
        records: in the order of the file.
        scan_ends: number of the last line of each Wi-Fi scan, by its time in milliseconds.
        name: of the recording; it becomes device and session of the events.
        floor: of the waypoints.
        rejects: takes the records whose values cannot be.
    """
    builder = _Builder(name, floor)
    handlers: dict[bytes, Callable[[Record], None]] = dict.fromkeys(_MOTION, builder.motion)
    handlers |= {b"TYPE_WIFI": builder.wifi, b"TYPE_BEACON": builder.beacon, b"TYPE_WAYPOINT": builder.waypoint}
    for record in records:
        if builder.open_scans:
            for ms in [ms for ms in builder.open_scans if scan_ends[ms] < record.line]:
                builder.close_scan(ms)
        builder.arrival_ns = record.logged_ms * _MS
        try:
            handlers[record.type](record)
        except BadValueError as error:
            rejects.add(str(error), record.line, b"\t".join(record.columns))
    for ms in tuple(builder.open_scans):
        builder.close_scan(ms)
    builder.flush_motion()
    return tuple(builder.events)


class _Builder:
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

    def motion(self, record: Record) -> None:
        """Add a sample to the batch; a batch lies within one cell of time and of arrival."""
        t_ns = record.ms * _MS
        x, y, z = numbers(record.columns[:3])
        sensor = _MOTION[record.type]
        values = quaternion(x, y, z) if sensor == "rotation_vector" else (x, y, z)
        cell = (-(-t_ns // BATCH_NS), -(-self.arrival_ns // BATCH_NS))
        if cell != self._batch_cell:
            self.flush_motion()
            self._batch_cell = cell
        times, rows = self._batch[sensor]
        times.append(t_ns)
        rows.append(values)
        self._batch_arrival_ns = self.arrival_ns

    def wifi(self, record: Record) -> None:
        """Add a reading to the scan that was logged at the record's time."""
        _ssid, bssid, strength, _frequency, last_seen = record.columns
        if not last_seen.isdigit():
            raise BadValueError("not a number")
        heard_ns, logged_ns = int(last_seen) * _MS, record.ms * _MS
        if heard_ns > logged_ns + CLOCKS_NS:
            raise BadValueError("heard after it was logged")
        if heard_ns < logged_ns - 24 * 3600 * 1000 * _MS:
            raise BadValueError("implausible time")
        reading = (identifier(bssid), rssi(strength), min(heard_ns, logged_ns))
        self.open_scans[record.ms].append(reading)

    def close_scan(self, ms: int) -> None:
        """Emit the scan that was logged at ``ms``."""
        self._scan(self.open_scans.pop(ms), "wifi")

    def beacon(self, record: Record) -> None:
        """Emit a beacon as a scan of its own.

        Its id ends with the MAC address: the beacons of a whole building may share UUID, major and minor.
        """
        uuid, major, minor, _power, strength, *rest = record.columns
        parts = [uuid, major, minor, *(rest[1:2] if len(rest) > 1 and rest[1] else [])]
        name = "ble:" + ":".join(identifier(part) for part in parts)
        self._scan([(name, rssi(strength), record.ms * _MS)], "ble")

    def waypoint(self, record: Record) -> None:
        """Emit a waypoint; it counts by itself, so that truth leaves no trace in what trackers see."""
        xy = np.array(numbers(record.columns))
        self.flush_motion()
        self.events.append(
            Truth(
                t_ns=record.ms * _MS,
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
