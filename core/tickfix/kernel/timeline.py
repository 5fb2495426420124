"""One device's past and present within one epoch of its clock: what was measured, in its order, tick by tick.

A timeline is a set. Whatever the order of arrival and however samples were batched, the same measurements make the same
timeline, and everything that is read from it comes in the order of (time, kind, source, content). One sensor has
one sample per instant: of two that differ, the smaller in lexicographic order stands, so that arrival decides nothing.
"""

from __future__ import annotations

from bisect import insort
from collections import Counter
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Final

import numpy as np

from tickfix.api.arrays import Floats, Ints
from tickfix.api.events import LATEST_NS, SENSORS, TICK_NS, Event, Fix, MotionSamples, Samples, Scan
from tickfix.api.values import Readings, Window
from tickfix.kernel.clock import EPOCH_JUMP_NS, DeviceClock, HeldMeasurement, TimestampVerdict
from tickfix.kernel.deduplication import MessageOutcome
from tickfix.kernel.measurements import (
    Measurement,
    RecentScans,
    TickSamples,
    fix_sort_key,
    is_increasing,
    scan_sort_key,
    split_by_tick,
    split_event,
    tick_of,
    to_rows,
)
from tickfix.kernel.snapshot import StreamSnapshot, TimelineSnapshot

_ACTIVE_NS: Final = 1_000_000_000
_MAX_SCANS_OR_FIXES: Final = 64
MAX_ADVANCE_NS: Final = 600_000_000_000
"""One message takes a device's clock no further, so that folding what it makes due stays bounded."""
MOTION_SENSORS: Final = frozenset(SENSORS) - {"pressure"}
"""Sensors that do not pause while they are on: the watermark waits for them. Of others nobody knows their rate."""
_MAX_OTHER_SENSORS: Final = 16
"""Sensors of other names within a tick: of more, the first in the order of their names stand, whatever came first."""


@dataclass(slots=True)
class TickMeasurements:
    """What was measured within one tick: of scans and of fixes the first 64 in their order."""

    samples: dict[str, TickSamples] = field(default_factory=dict)
    scans: list[Scan] = field(default_factory=list)
    fixes: list[Fix] = field(default_factory=list)


@dataclass(slots=True)
class ChangedTicks:
    """The earliest ticks whose content changed since they were last read; None means nothing did."""

    motion: int | None = None
    scans: int | None = None
    fixes: int | None = None


@dataclass(slots=True)
class InsertResult:
    """What became of an event.

    Attributes:
        outcome: of the message.
        restart: measurements that begin a new epoch, in their order; they and what followed them are not in this
            timeline.
    """

    outcome: MessageOutcome
    restart: list[Measurement] = field(default_factory=list)


class Timeline:
    """The measurements of one device and epoch.

    Args:
        horizon_ns: how far behind the last closed tick a measurement may still be inserted.
        counts: where single measurements are counted, by what became of them.
    """

    def __init__(self, horizon_ns: int, counts: Counter[str]) -> None:
        """Begin with nothing measured."""
        self._horizon_ns = horizon_ns
        self._counts = counts
        self._clock = DeviceClock(horizon_ns, MOTION_SENSORS)
        self._intervals: dict[int, TickMeasurements] = {}
        self._scans = RecentScans()
        self._since: int | None = None
        self.first: int | None = None
        self.closed: int | None = None
        self.changes = ChangedTicks()

    def insert(self, event: Event, *, out_of_order: bool = False) -> InsertResult:
        """Insert what can be used of an event (any but truth) and say what became of it.

        Args:
            event: of this device.
            out_of_order: something sent after it has taken the clock further: it is late, and tells of no new epoch.
        """
        before = dict(self._counts)
        if isinstance(event, MotionSamples) and self._insert_batch(event):
            return InsertResult(self._outcome(before))
        items = list(split_event(event, self._counts))
        restart = self.insert_measurements(items, out_of_order=out_of_order)
        return InsertResult(self._outcome(before), restart)

    def insert_measurements(self, items: list[Measurement], *, out_of_order: bool = False) -> list[Measurement]:
        """Insert measurements in the order given; return those that begin a new epoch, with all that follow them.

        The clock goes on by ten minutes at most, however many there are; what comes after that is dropped.
        """
        since_ns = self._clock.latest_ns
        for n, measurement in enumerate(items):
            latest_ns = self._clock.latest_ns
            since_ns = latest_ns if since_ns is None else since_ns
            if latest_ns is not None and since_ns is not None and latest_ns - since_ns > MAX_ADVANCE_NS:
                self._counts["dropped"] += len(items) - n
                return []
            verdict = self._clock.classify(measurement.t_ns, measurement.stream, self._limit_ns)
            if verdict is TimestampVerdict.FOLLOW:
                self._insert(measurement)
                self._insert_held(self._clock.release_caught_up())
            elif verdict is TimestampVerdict.STALE or (out_of_order and verdict is TimestampVerdict.HOLD_BEHIND):
                self._counts["stale"] += 1
            else:
                held = HeldMeasurement(
                    measurement.t_ns, measurement.stream, measurement, ahead=verdict is TimestampVerdict.HOLD_AHEAD
                )
                self._counts["held"] += 1
                self._counts["dropped"] += self._clock.hold(held)
                released, restart = self._clock.release_confirmed(held)
                if restart:
                    return [h.measurement for h in released] + items[n + 1 :]
                self._insert_held(released)
        return []

    def finish(self) -> None:
        """Nothing more will come: insert what is held within reach of this epoch, drop the rest."""
        latest_ns = self._clock.latest_ns
        for held in self._clock.release_all():
            # Within a minute of what is known now: each of them within a minute of the one before would lead anywhere.
            if held.ahead and latest_ns is not None and held.t_ns <= latest_ns + EPOCH_JUMP_NS:
                self._insert_held([held])
            else:
                self._counts["dropped"] += 1

    @property
    def newest_ns(self) -> int | None:
        """The time of the newest measurement, None before the first."""
        return self._clock.latest_ns

    @property
    def newest(self) -> int | None:
        """The tick that closes the interval of the newest measurement, None before the first."""
        return None if self._clock.latest_ns is None else tick_of(self._clock.latest_ns)

    @property
    def watermark(self) -> int | None:
        """The newest tick that every motion sensor heard in the last second has passed, None before the first."""
        now_ns = self._clock.latest_ns
        if now_ns is None:
            return None
        since_ns = now_ns - _ACTIVE_NS
        active = [t for stream, t in self._clock.last_ns.items() if t >= since_ns and stream in MOTION_SENSORS]
        return min(active, default=now_ns) // TICK_NS

    def close(self, tick: int) -> None:
        """Note that ``tick`` and all before it are closed."""
        if self.closed is None or tick > self.closed:
            self.closed = tick

    def motion(self, tick: int) -> MotionSamples:
        """Return the motion samples of a tick, every sensor's in strictly increasing time."""
        interval = self._intervals.get(tick)
        sensors: dict[str, Samples] = {}
        if interval is not None:
            sensors = {name: interval.samples[name].ordered() for name in sorted(interval.samples)}
        return MotionSamples(sensors=sensors, t0_ns=(tick - 1) * TICK_NS, t1_ns=tick * TICK_NS)

    def scans(self, tick: int) -> list[Scan]:
        """Return the scans of a tick in their order."""
        interval = self._intervals.get(tick)
        return [] if interval is None else interval.scans

    def fixes(self, tick: int) -> list[Fix]:
        """Return the fixes that others computed for a tick, in their order."""
        interval = self._intervals.get(tick)
        return [] if interval is None else interval.fixes

    def window(self, scan: Scan, window: Window) -> Readings:
        """Return the readings that ``window`` asks for, ending with ``scan``: each once, none over a minute old."""
        return self._scans.window(scan, window)

    def windows_with(self, scan: Scan, tick: int, window: Window) -> tuple[Readings, ...]:
        """Return the windows of ``scan``, as if it were inserted, and of all other wanted scans after ``tick``."""
        recent = self._scans.with_scan(scan)
        after = [s for s in recent.kept if tick_of(s.t_ns) > tick and s.source in window.sources]
        return tuple(recent.window(s, window) for s in after)

    def forget(self, tick: int) -> None:
        """Drop what no tick from ``tick`` on can need."""
        # What was forgotten before lies beyond the horizon, and nothing comes there any more.
        since, self._since = self._since, tick
        for old in list(self._intervals) if since is None else range(since, tick):
            if old < tick:
                self._intervals.pop(old, None)
        self._scans.forget_before((tick - 1) * TICK_NS)

    def snapshot(self) -> TimelineSnapshot:
        """Return what is kept, as a value."""
        found: dict[tuple[str, int], list[Samples]] = {}
        fixes: list[Fix] = []
        for tick in sorted(self._intervals):
            fixes += self._intervals[tick].fixes
            for name, samples in self._intervals[tick].samples.items():
                found.setdefault((name, samples.columns), []).append(samples.ordered())
        return TimelineSnapshot(
            first=self.first,
            closed=self.closed,
            since=self._since,
            streams=tuple(
                StreamSnapshot(name, np.concatenate([s.t_ns for s in kept]), np.concatenate([s.values for s in kept]))
                for (name, _), kept in sorted(found.items(), key=itemgetter(0))
            ),
            scans=self._scans.kept,
            fixes=tuple(fixes),
            clock=self._clock.snapshot(),
            changed=(self.changes.motion, self.changes.scans, self.changes.fixes),
        )

    def restore(self, kept: TimelineSnapshot) -> None:
        """Become what ``kept`` says."""
        self._clock.restore(kept.clock)
        self._scans = RecentScans(kept.scans)
        for stream in kept.streams:
            times = stream.t_ns.tolist()
            if is_increasing(times):
                for tick, begin, end in split_by_tick(times):
                    samples = self._samples(tick, stream.stream, stream.rows.shape[1])
                    samples.extend(stream.t_ns[begin:end], stream.rows[begin:end])
                continue
            for t_ns, row in zip(times, to_rows(stream.rows), strict=True):
                self._samples(tick_of(t_ns), stream.stream, len(row)).put(t_ns, row)
        for fix in kept.fixes:
            self._interval(tick_of(fix.t_ns)).fixes.append(fix)
        for scan in kept.scans:
            if kept.since is None or tick_of(scan.t_ns) >= kept.since:
                self._interval(tick_of(scan.t_ns)).scans.append(scan)
        self._since, self.first, self.closed = kept.since, kept.first, kept.closed
        self.changes = ChangedTicks(*kept.changed)

    def _interval(self, tick: int) -> TickMeasurements:
        interval = self._intervals.get(tick)
        if interval is None:
            interval = self._intervals[tick] = TickMeasurements()
        return interval

    def _samples(self, tick: int, stream: str, columns: int) -> TickSamples:
        """Return where samples of a sensor belong; of those that have no place in the tick, a place that is not kept.

        Only sensors of other names than :data:`SENSORS` may have no place. What stands must not depend on the order of
        arrival: so of rows of different width the narrowest stand, and of too many names the first.
        """
        sensors = self._interval(tick).samples
        samples = sensors.get(stream)
        if samples is None:
            samples = sensors[stream] = TickSamples(columns)
            if stream not in SENSORS:
                others = sorted(name for name in sensors if name not in SENSORS)
                for name in others[_MAX_OTHER_SENSORS:]:
                    del sensors[name]
                    self._counts["overflow"] += 1
        elif samples.columns > columns:
            samples = sensors[stream] = TickSamples(columns)
        elif samples.columns < columns:
            return TickSamples(columns)
        return samples

    @property
    def _limit_ns(self) -> int | None:
        if self.closed is not None:
            return self.closed * TICK_NS - self._horizon_ns
        return None if self._clock.latest_ns is None else self._clock.latest_ns - self._horizon_ns

    def _outcome(self, before: dict[str, int]) -> MessageOutcome:
        def increased(count: str) -> bool:
            return self._counts.get(count, 0) > before.get(count, 0)

        if increased("accepted") or increased("held"):
            return MessageOutcome.ACCEPTED
        for outcome in (MessageOutcome.LATE, MessageOutcome.DUPLICATE, MessageOutcome.STALE):
            if increased(outcome.value):
                return outcome
        return MessageOutcome.MALFORMED

    def _insert_batch(self, batch: MotionSamples) -> bool:
        """Insert a batch none of whose samples needs judging one by one; tell whether that was so."""
        reach_ns, limit_ns = self._clock.reach_ns, self._limit_ns
        if reach_ns is None or limit_ns is None or self._clock.held_count:
            return False
        oldest_ns, newest_ns = max(limit_ns, 0), min(reach_ns, LATEST_NS)
        found = [(name, samples.t_ns.tolist(), samples) for name, samples in batch.sensors.items() if len(samples)]
        for _, times, samples in found:
            if min(times) < oldest_ns or max(times) > newest_ns or not np.isfinite(samples.values).all():
                return False
        for name, times, samples in found:
            if is_increasing(times):
                # Copies: those of the message go with it, and there are no negative zeros, see to_rows.
                self._insert_ordered(name, times, samples.t_ns.copy(), samples.values + 0.0)
            else:
                for t_ns, row in zip(times, to_rows(samples.values), strict=True):
                    self._insert(Measurement(t_ns, name, row))
        return True

    def _insert_ordered(self, stream: str, times: list[int], t_ns: Ints, rows: Floats) -> None:
        """Insert samples of one sensor in increasing time, as inserting one by one would; ``times`` are ``t_ns``."""
        for tick, begin, end in split_by_tick(times):
            samples = self._samples(tick, stream, rows.shape[1])
            n_new, changed = samples.extend(t_ns[begin:end], rows[begin:end])
            if samples.overflow:
                self._counts["overflow"] += samples.take_overflow()
            if changed and (self.changes.motion is None or tick < self.changes.motion):
                self.changes.motion = tick
            self._count(n_new, end - begin, tick)
        self._counts["dropped"] += self._clock.follow(times[-1], stream)

    def _count(self, n_new: int, n: int, tick: int) -> None:
        """Count ``n`` measurements of a tick, so many of which were new, and take note of the tick."""
        if n_new < n:
            self._counts["duplicate"] += n - n_new
        if n_new:
            late = self.closed is not None and tick <= self.closed
            self._counts["late" if late else "accepted"] += n_new
        if self.first is None or tick < self.first:
            self.first = tick

    def _insert_held(self, released: list[HeldMeasurement]) -> None:
        """Insert what was held, unless a driver has closed the ticks beyond it while it waited."""
        for held in released:
            limit_ns = self._limit_ns
            if limit_ns is not None and held.t_ns < limit_ns:
                self._counts["stale"] += 1
            else:
                self._insert(held.measurement)

    def _insert(self, measurement: Measurement) -> None:
        tick = tick_of(measurement.t_ns)
        self._counts["dropped"] += self._clock.follow(measurement.t_ns, measurement.stream)
        if isinstance(measurement.content, Scan):
            is_new = self._insert_scan(self._interval(tick), measurement.content, tick)
        elif isinstance(measurement.content, Fix):
            is_new = self._insert_fix(self._interval(tick), measurement.content, tick)
        else:
            samples = self._samples(tick, measurement.stream, len(measurement.content))
            is_new, changed = samples.put(measurement.t_ns, measurement.content)
            if samples.overflow:
                self._counts["overflow"] += samples.take_overflow()
            if changed:
                self.changes.motion = tick if self.changes.motion is None else min(tick, self.changes.motion)
        self._count(int(is_new), 1, tick)

    def _insert_scan(self, interval: TickMeasurements, scan: Scan, tick: int) -> bool:
        order = scan_sort_key(scan)
        if any(scan_sort_key(present) == order for present in interval.scans):
            return False
        insort(interval.scans, scan, key=scan_sort_key)
        self._scans.add(scan)
        if len(interval.scans) > _MAX_SCANS_OR_FIXES:
            self._scans.remove(interval.scans.pop())
            self._counts["overflow"] += 1
        self.changes.scans = tick if self.changes.scans is None else min(tick, self.changes.scans)
        return True

    def _insert_fix(self, interval: TickMeasurements, fix: Fix, tick: int) -> bool:
        order = fix_sort_key(fix)
        if any(fix_sort_key(present) == order for present in interval.fixes):
            return False
        insort(interval.fixes, fix, key=fix_sort_key)
        if len(interval.fixes) > _MAX_SCANS_OR_FIXES:
            interval.fixes.pop()
            self._counts["overflow"] += 1
        self.changes.fixes = tick if self.changes.fixes is None else min(tick, self.changes.fixes)
        return True
