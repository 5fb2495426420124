"""When a tick of a device closes though its data has not passed it, which devices have a backlog, and when the loop is
overloaded. Pure: time comes in as an argument.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Final

from tickfix.api import TICK_NS
from tickfix.kernel import DeviceProgress

_BIN_NS: Final = 2_000_000_000
_MAX_BINS: Final = 15
_FRESH_BINS: Final = 3
_CLOCK_STEP_NS: Final = 500_000_000


class ClockOffset:
    """Estimates our monotonic time minus a device's time.

    A message arrives late by its time in the network and in the sender's batch, never early. So the smallest difference
    seen is the best estimate of the offset, and a larger one is no evidence. Each bin holds the minimum of two seconds;
    the estimate is the minimum over the last fifteen bins, which follows a drift of 200 ppm within 6 ms.
    """

    def __init__(self) -> None:
        """Begin with nothing heard."""
        self._bins: deque[tuple[int, int]] = deque(maxlen=_MAX_BINS)
        self._offset_ns: int | None = None

    def observe(self, device_ns: int, now_ns: int) -> None:
        """Record that something measured at ``device_ns`` arrived at ``now_ns``."""
        difference_ns, bin_ = now_ns - device_ns, now_ns // _BIN_NS
        if self._bins and self._bins[-1][0] == bin_:
            self._bins[-1] = (bin_, min(self._bins[-1][1], difference_ns))
        else:
            self._bins.append((bin_, difference_ns))
        while self._bins[0][0] <= bin_ - _MAX_BINS:
            self._bins.popleft()
        smallest_ns = min(d for _, d in self._bins)
        # A minimum adapts at once when the device's clock steps ahead, but would keep the old offset for half a minute
        # when it steps back, and close every tick too early meanwhile. Three bins in a row that are all half a second
        # above the minimum are such a step: delays of the network do not stay that long without one quick message.
        fresh = list(self._bins)[-_FRESH_BINS:]
        if len(fresh) == _FRESH_BINS and min(d for _, d in fresh) > smallest_ns + _CLOCK_STEP_NS:
            self._bins = deque(fresh, maxlen=_MAX_BINS)
            smallest_ns = min(d for _, d in fresh)
        self._offset_ns = smallest_ns

    @property
    def offset_ns(self) -> int | None:
        """The estimate, None before the first message."""
        return self._offset_ns


@dataclass(slots=True)
class DeviceDeadline:
    """What the deadlines know of a device.

    Attributes:
        offset: of its clock.
        newest_ns: its newest measurement.
        last_seen_ns: when it was last heard, on our clock.
        next_tick: the first tick that is not closed.
        queued_ns: the deadline under which it stands in the queue.
    """

    offset: ClockOffset = field(default_factory=ClockOffset)
    newest_ns: int = 0
    last_seen_ns: int = 0
    next_tick: int | None = None
    queued_ns: int | None = None


class Deadlines:
    """The devices by the time at which their next tick is to close.

    A device that sends nothing gets its ticks for ``coast_ns`` after its newest measurement; then they wait for it, so
    that what it measured meanwhile is not late when it comes.

    Args:
        grace_ns: how long after its time, as the device's clock shows it, a tick waits for data.
        coast_ns: see above; less than the horizon.
    """

    def __init__(self, grace_ns: int, coast_ns: int) -> None:
        """Begin with no device."""
        self._grace_ns = grace_ns
        self._coast_ticks = coast_ns // TICK_NS
        self._devices: dict[str, DeviceDeadline] = {}
        self._queue: list[tuple[int, str]] = []

    def observe(self, device: str, newest_ns: int, next_tick: int | None, *, arrival_ns: int) -> None:
        """Record an arrival.

        Args:
            newest_ns: the device's newest measurement that its timeline believes.
            next_tick: the first tick that is not closed, None while there is none.
            arrival_ns: when it arrived, on our clock.
        """
        due = self._devices.setdefault(device, DeviceDeadline())
        if newest_ns < due.newest_ns:  # its clock restarted
            due.offset = ClockOffset()
        if newest_ns != due.newest_ns:
            due.offset.observe(newest_ns, arrival_ns)
        due.newest_ns, due.last_seen_ns = newest_ns, arrival_ns
        self.closed(device, next_tick)

    def closed(self, device: str, next_tick: int | None) -> None:
        """Record which tick is the first that is not closed, and queue its deadline."""
        due = self._devices.get(device)
        if due is None:
            return
        due.next_tick = next_tick
        deadline_ns = self._deadline_ns(due)
        if deadline_ns is not None and (due.queued_ns is None or deadline_ns != due.queued_ns):
            due.queued_ns = deadline_ns
            heapq.heappush(self._queue, (deadline_ns, device))

    def forget(self, device: str) -> None:
        """The device is gone."""
        self._devices.pop(device, None)

    def next_ns(self) -> int | None:
        """Return the earliest deadline, None where nothing is to come."""
        # A deadline that moved is not removed from the heap but queued again; entries that no longer hold are skipped.
        while self._queue:
            deadline_ns, device = self._queue[0]
            due = self._devices.get(device)
            if due is not None and due.queued_ns == deadline_ns and self._deadline_ns(due) == deadline_ns:
                return deadline_ns
            heapq.heappop(self._queue)
        return None

    def due(self, now_ns: int) -> list[tuple[str, int, int]]:
        """Return, and no longer wait for, what is due: device, the tick to close up to, and when it was due."""
        found = []
        while (deadline_ns := self.next_ns()) is not None and deadline_ns <= now_ns:
            _, device = heapq.heappop(self._queue)
            due = self._devices[device]
            due.queued_ns = None
            offset_ns = due.offset.offset_ns
            if offset_ns is None or due.next_tick is None:
                continue
            latest = (now_ns - offset_ns - self._grace_ns) // TICK_NS
            found.append((device, min(latest, self._last_coasting_tick(due)), deadline_ns))
        return found

    def idle(self, since_ns: int) -> list[str]:
        """Return the devices that were last heard before ``since_ns``."""
        return [device for device, due in self._devices.items() if due.last_seen_ns < since_ns]

    def deadline_ns(self, device: str, tick: int) -> int | None:
        """Return when a tick of a device is due, None as long as its clock is not known."""
        due = self._devices.get(device)
        offset_ns = None if due is None else due.offset.offset_ns
        return None if offset_ns is None else tick * TICK_NS + offset_ns + self._grace_ns

    def offset_ns(self, device: str) -> int | None:
        """Return our clock minus the device's, None as long as it is not known."""
        due = self._devices.get(device)
        return None if due is None else due.offset.offset_ns

    @property
    def devices(self) -> tuple[str, ...]:
        """The devices known."""
        return tuple(self._devices)

    def _last_coasting_tick(self, due: DeviceDeadline) -> int:
        return due.newest_ns // TICK_NS + self._coast_ticks

    def _deadline_ns(self, due: DeviceDeadline) -> int | None:
        offset_ns = due.offset.offset_ns
        if offset_ns is None or due.next_tick is None or due.next_tick > self._last_coasting_tick(due):
            return None
        return due.next_tick * TICK_NS + offset_ns + self._grace_ns


class DeviceSchedule:
    """The devices that are followed.

    Attributes:
        deadlines: by which their next ticks close.
    """

    def __init__(self, deadlines: Deadlines) -> None:
        """Begin with none."""
        self.deadlines = deadlines
        self._progress: dict[str, DeviceProgress] = {}
        self._backlog: dict[str, int] = {}

    def __contains__(self, device: str) -> bool:
        """Whether a device is followed."""
        return device in self._progress

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the devices; some may be forgotten meanwhile."""
        return iter(tuple(self._progress))

    def update(self, device: str, progress: DeviceProgress) -> None:
        """Record a device's progress."""
        self._progress[device] = progress

    def observe(self, device: str, received_ns: int) -> None:
        """Record that a device's data was accepted, which was received at ``received_ns`` on our clock."""
        progress = self._progress.get(device)
        if progress is not None and progress.newest_ns is not None:
            self.deadlines.observe(device, progress.newest_ns, progress.next_tick, arrival_ns=received_ns)

    def record_run(self, device: str, progress: DeviceProgress | None) -> None:
        """Record a device's progress after a run; None if the device is not followed."""
        self._backlog.pop(device, None)
        if progress is not None:
            self.deadlines.closed(device, progress.next_tick)
            if progress.backlog:
                self._backlog[device] = progress.backlog

    def backlog(self, device: str) -> int:
        """Return how many ticks of a device wait to be folded."""
        return self._backlog.get(device, 0)

    @property
    def has_backlog(self) -> bool:
        """Whether ticks of some device wait to be folded."""
        return bool(self._backlog)

    def next_with_backlog(self) -> str | None:
        """Return one of the devices that are behind, each in its turn; None when none is."""
        if not self._backlog:
            return None
        device = next(iter(self._backlog))
        self._backlog[device] = self._backlog.pop(device)
        return device

    def forget(self, device: str) -> None:
        """Let go of a device."""
        self._progress.pop(device, None)
        self._backlog.pop(device, None)
        self.deadlines.forget(device)

    def rows(self, most: int) -> tuple[dict[str, Any], ...]:
        """Return how far each device has come, ``most`` of them, as plain values."""
        return tuple(
            {
                "device": device,
                "epoch": progress.epoch,
                "newest_ns": progress.newest_ns,
                "next_tick": progress.next_tick,
                "clock_offset_ns": self.deadlines.offset_ns(device),
            }
            for device, progress in islice(self._progress.items(), most)
        )


_RECOVERY_SHARE: Final = 0.25
_HOLD_FACTOR: Final = 3.0


class OverloadDetector:
    """Watches how late the loop is.

    It is overloaded when it was later than ``limit_s`` for three times as long without a break, and recovers when it
    was no later than a quarter of it for as long.
    """

    def __init__(self, limit_s: float) -> None:
        """Begin with all well."""
        self._limit_ns = round(limit_s * 1e9)
        self._span_ns = round(_HOLD_FACTOR * limit_s * 1e9)
        self._since_ns: int | None = None
        self.active = False
        self.episodes = 0

    def update(self, lag_ns: int, now_ns: int) -> bool:
        """Record how late the loop is now; return whether it has just become overloaded, or just recovered."""
        recovered, lagging = lag_ns <= _RECOVERY_SHARE * self._limit_ns, lag_ns > self._limit_ns
        turning = recovered if self.active else lagging
        if not turning:
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns = now_ns
        if now_ns - self._since_ns < self._span_ns:
            return False
        self.active = not self.active
        self.episodes += self.active
        self._since_ns = None
        return True
