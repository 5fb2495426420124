"""Single measurements in a canonical order that owes nothing to batches or arrival, the samples of a tick, and
windows of scans."""

from __future__ import annotations

from bisect import bisect_right, insort
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from operator import lt
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from tickfix.api.arrays import Bools, Floats, Ints, frozen_columns
from tickfix.api.events import LATEST_NS, TICK_NS, Event, Fix, MotionSamples, Pressure, Samples, Scan
from tickfix.api.values import Readings, Window

SampleRow: TypeAlias = tuple[float, ...]


class Measurement(NamedTuple):
    """A single measurement: a sensor's row, a scan or a fix."""

    t_ns: int
    stream: str
    content: Any


def split_event(event: Event, counts: Counter[str]) -> Iterable[Measurement]:
    """Yield the single measurements of an event in their order; what is not finite or has no time is counted."""
    if isinstance(event, MotionSamples):
        items = []
        for name, samples in event.sensors.items():
            usable = np.isfinite(samples.values).all(axis=1) & _is_valid_time(samples.t_ns)
            counts["invalid"] += int(len(samples) - usable.sum())
            rows = zip(samples.t_ns[usable].tolist(), to_rows(samples.values[usable]), strict=True)
            items += [Measurement(t_ns, name, row) for t_ns, row in rows]
        yield from sorted(items)
    elif isinstance(event, Pressure):
        if _is_valid_time(event.t_ns) and np.isfinite(event.pressure_hpa):
            yield Measurement(event.t_ns, "pressure", (float(event.pressure_hpa) + 0.0,))
        else:
            counts["invalid"] += 1
    elif isinstance(event, Scan):
        usable = _has_numbers(event) & (event.heard_ns >= 0) & (event.heard_ns <= event.t_ns)
        counts["invalid_readings"] += int(len(event) - usable.sum())
        if not _is_valid_time(event.t_ns) or (len(event) and not usable.any()):
            counts["invalid"] += 1
            return
        if not usable.all():
            heard = tuple(t for t, ok in zip(event.transmitters, usable, strict=True) if ok)
            event = replace(
                event,
                transmitters=heard,
                rssi_dbm=event.rssi_dbm[usable],
                heard_ns=event.heard_ns[usable],
                values={name: column[usable] for name, column in event.values.items()},
            )
        yield Measurement(event.t_ns, f"scan {event.source}", event)
    elif isinstance(event, Fix):
        (a, b), (c, d) = event.covariance.tolist()
        finite = np.isfinite(event.xy).all() and np.isfinite(event.covariance).all()
        if _is_valid_time(event.t_ns) and finite and b == c and a > 0 and a * d - b * c > 0:
            yield Measurement(event.t_ns, f"fix {event.source}", event)
        else:
            counts["invalid"] += 1


def _has_numbers(scan: Scan) -> Bools:
    """Tell for each reading whether it can be used: something was measured, and nothing is infinite; (n,) bool."""
    usable: Bools = np.isfinite(scan.rssi_dbm)
    if scan.values:
        columns = np.stack([scan.rssi_dbm, *scan.values.values()])
        usable = np.asarray(np.isfinite(columns).any(axis=0) & ~np.isinf(columns).any(axis=0))
    return usable


def _is_valid_time(t_ns: Any) -> Any:
    return (t_ns >= 0) & (t_ns <= LATEST_NS)


def to_rows(values: Floats) -> list[SampleRow]:
    """Return the rows (n, c) as tuples, with no negative zero: it would equal the positive one and differ in bits."""
    return [tuple(row) for row in (values + 0.0).tolist()]


def scan_sort_key(scan: Scan) -> tuple[Any, ...]:
    """Return what scans of a device are ordered by; equal for equal scans."""
    # The number of the message is no part of it: a phone that restarts sends its queue again under new numbers.
    order = (scan.t_ns, scan.source, scan.transmitters, scan.rssi_dbm.tobytes(), scan.heard_ns.tobytes())
    return (*order, *((name, column.tobytes()) for name, column in scan.values.items())) if scan.values else order


def fix_sort_key(fix: Fix) -> tuple[Any, ...]:
    """Return what fixes of a device are ordered by; equal for equal fixes."""
    return (fix.t_ns, fix.source, fix.floor, fix.xy.tobytes(), fix.covariance.tobytes())


_MAX_SAMPLES_PER_TICK: Final = 512
"""Samples of a sensor within a tick: 2560 Hz."""


def tick_of(t_ns: int) -> int:
    """Return the tick that closes the interval holding ``t_ns``: the smallest k with k·200 ms ≥ t."""
    return -(-t_ns // TICK_NS)


def is_increasing(times: list[int]) -> bool:
    """Tell whether every time is later than the one before."""
    return all(map(lt, times, times[1:]))


def split_by_tick(times: list[int]) -> Iterator[tuple[int, int, int]]:
    """Yield the ticks of increasing times, and where the times of each begin and end."""
    begin = 0
    while begin < len(times):
        tick = tick_of(times[begin])
        end = bisect_right(times, tick * TICK_NS, begin)
        yield tick, begin, end
        begin = end


def _unchecked_samples(t_ns: Ints, values: Floats) -> Samples:
    """Return samples without checking again what was checked when they came."""
    samples = object.__new__(Samples)
    object.__setattr__(samples, "t_ns", t_ns)
    object.__setattr__(samples, "values", values)
    return samples


class TickSamples:
    """Samples of one sensor, (n,) instants and (n, c) rows; of two rows at an instant the smaller one stands.

    Of more instants than any sensor has in 200 ms the first 512 stand, in whatever order they come.

    What comes in order is kept in the arrays that brought it. What does not turns them into a mapping, which takes
    anything and is put in order when it is read.

    Attributes:
        columns: numbers of each row.
        overflow: samples left out, since this was last taken.
    """

    __slots__ = ("_by_time", "_last_ns", "_n", "_pieces", "columns", "overflow")

    def __init__(self, columns: int = 0) -> None:
        """Begin empty, for rows of ``columns`` numbers."""
        self.columns = columns
        self._pieces: list[tuple[Ints, Floats]] = []
        self._last_ns = -1
        self._n = 0
        self._by_time: dict[int, SampleRow] | None = None
        self.overflow = 0

    def extend(self, t_ns: Ints, rows: Floats) -> tuple[int, bool]:
        """Take samples in, in increasing time; return how many instants are new, and whether anything changed.

        Args:
            t_ns: (n,), none negative; kept.
            rows: (n, c), finite, without negative zeros; kept.
        """
        if self._by_time is None and t_ns.item(0) > self._last_ns:
            room = max(0, _MAX_SAMPLES_PER_TICK - self._n)
            self.overflow += max(0, len(t_ns) - room)
            if room:
                self._pieces.append((t_ns[:room], rows[:room]))
                self._n += len(self._pieces[-1][0])
            self._last_ns = t_ns.item(-1)
            return len(t_ns), room > 0
        found = [self.put(t, row) for t, row in zip(t_ns.tolist(), to_rows(rows), strict=True)]
        return sum(new for new, _ in found), any(changed for _, changed in found)

    def put(self, t_ns: int, row: SampleRow) -> tuple[bool, bool]:
        """Take one sample in; return whether its instant is new, and whether anything changed."""
        if self._by_time is None:
            self._by_time = self._to_mapping()
            self._pieces.clear()
        present = self._by_time.get(t_ns)
        changed = present is None or row < present
        if changed:
            self._by_time[t_ns] = row
        if len(self._by_time) > 2 * _MAX_SAMPLES_PER_TICK:  # seldom, so that one more sample costs little
            self.overflow += len(self._by_time) - _MAX_SAMPLES_PER_TICK
            self._by_time = dict(sorted(self._by_time.items())[:_MAX_SAMPLES_PER_TICK])
        return present is None, changed

    def take_overflow(self) -> int:
        """Return how many samples were left out since this was last asked."""
        overflow, self.overflow = self.overflow, 0
        return overflow

    def ordered(self) -> Samples:
        """Return what is there, in increasing time."""
        if self._by_time is not None:
            ordered = sorted(self._by_time.items())[:_MAX_SAMPLES_PER_TICK]
            return Samples(np.array([t for t, _ in ordered], np.int64), np.array([row for _, row in ordered]))
        if len(self._pieces) > 1:
            # One piece from now on, for whoever asks next.
            t_ns = np.concatenate([times for times, _ in self._pieces])
            self._pieces = [(t_ns, np.concatenate([rows for _, rows in self._pieces]))]
        t_ns, values = self._pieces[0]
        t_ns.setflags(write=False)  # nobody else has them: not copied again
        values.setflags(write=False)
        return _unchecked_samples(t_ns, values)

    def _to_mapping(self) -> dict[int, SampleRow]:
        return {t: row for t_ns, rows in self._pieces for t, row in zip(t_ns.tolist(), to_rows(rows), strict=True)}


MAX_WINDOW_NS: Final = 60_000_000_000
"""The longest window of readings: scans are kept for so long, whatever is refolded."""


class RecentScans:
    """The scans of the last minute, in their order."""

    def __init__(self, scans: tuple[Scan, ...] = ()) -> None:
        """Begin with those that are known, in their order."""
        self._scans = list(scans)

    def add(self, scan: Scan) -> None:
        """Take a scan in; it must not be there yet."""
        insort(self._scans, scan, key=scan_sort_key)

    def remove(self, scan: Scan) -> None:
        """Take a scan out again; it must be there."""
        del self._scans[bisect_right(self._scans, scan_sort_key(scan), key=scan_sort_key) - 1]

    def with_scan(self, scan: Scan) -> RecentScans:
        """Return the same scans and one more, if it is not there yet."""
        if any(scan_sort_key(present) == scan_sort_key(scan) for present in self._scans if present.t_ns == scan.t_ns):
            return RecentScans(self.kept)
        more = RecentScans(self.kept)
        more.add(scan)
        return more

    def forget_before(self, t_ns: int) -> None:
        """Drop what no window that ends at ``t_ns`` or later holds."""
        while self._scans and self._scans[0].t_ns < t_ns - MAX_WINDOW_NS:
            del self._scans[0]

    def window(self, scan: Scan, window: Window) -> Readings:
        """Return the readings that ``window`` asks for, ending with ``scan``: each once, none over a minute old.

        The scan itself need not have been added.
        """
        oldest_ns = scan.t_ns - round(min(window.seconds * 1e9, MAX_WINDOW_NS))
        order = scan_sort_key(scan)
        end = bisect_right(self._scans, order, key=scan_sort_key)
        if end and scan_sort_key(self._scans[end - 1]) == order:
            end -= 1
        scans = [scan][: window.scans]
        for candidate in reversed(self._scans[:end]):
            if candidate.t_ns < oldest_ns or len(scans) == window.scans:
                break
            if candidate.source == scan.source:
                scans.append(candidate)
        return _window_readings(scan, scans[::-1], oldest_ns)

    @property
    def kept(self) -> tuple[Scan, ...]:
        """All of them."""
        return tuple(self._scans)


def _window_readings(newest: Scan, scans: list[Scan], oldest_ns: int) -> Readings:
    found: dict[tuple[str, int], tuple[int, float, int]] = {}
    for number, scan in enumerate(scans):
        heard = zip(scan.transmitters, scan.heard_ns.tolist(), scan.rssi_dbm.tolist(), strict=True)
        for i, (transmitter, heard_ns, rssi_dbm) in enumerate(heard):
            if heard_ns >= oldest_ns:
                found.setdefault((transmitter, heard_ns), (number, rssi_dbm, i))
    # Number, time and name differ in every row, so that a NaN is never compared.
    rows = sorted((number, heard_ns, name, rssi, i) for (name, heard_ns), (number, rssi, i) in found.items())
    columns = {name for scan in scans for name in scan.values}
    values = {
        name: [float(of[row[4]]) if (of := scans[row[0]].values.get(name)) is not None else np.nan for row in rows]
        for name in columns
    }
    return Readings(
        t_ns=newest.t_ns,
        transmitters=tuple(row[2] for row in rows),
        rssi_dbm=np.array([row[3] for row in rows], np.float64),
        heard_ns=np.array([row[1] for row in rows], np.int64),
        scan=np.array([row[0] for row in rows], np.int64),
        scan_t_ns=tuple(scan.t_ns for scan in scans),
        source=newest.source,
        values=frozen_columns(values, len(rows)),
    )
