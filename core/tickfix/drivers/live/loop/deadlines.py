"""When a tick of a device closes though its data has not passed it: at its time plus a grace, on our clock.

A device's clock is known only through what it sends: no message arrives before it was sent, so the smallest difference
between arrival and measurement is the offset, up to the fastest way. The minimum over a sliding half minute follows
drift (20 ppm are 0.6 ms in that time) and outlives jitter. When all messages of six seconds say more than the minimum,
the clock has stepped back and only they are believed.
"""

from __future__ import annotations

import heapq
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from tickfix.api import TICK_NS

_BIN_NS: Final = 2_000_000_000
_BINS: Final = 15
_FRESH_BINS: Final = 3
_STEP_NS: Final = 500_000_000


class ClockOffset:
    """Estimates our monotonic time minus a device's time.

    Each bin holds the minimum of two seconds; the estimate is the minimum over the last fifteen bins.
    """

    def __init__(self) -> None:
        """Begin with nothing heard."""
        self._bins: deque[tuple[int, int]] = deque(maxlen=_BINS)
        self._offset_ns: int | None = None

    def heard(self, device_ns: int, now_ns: int) -> None:
        """Take note that something measured at ``device_ns`` arrived at ``now_ns``."""
        difference_ns, bin_ = now_ns - device_ns, now_ns // _BIN_NS
        if self._bins and self._bins[-1][0] == bin_:
            self._bins[-1] = (bin_, min(self._bins[-1][1], difference_ns))
        else:
            self._bins.append((bin_, difference_ns))
        while self._bins[0][0] <= bin_ - _BINS:
            self._bins.popleft()
        smallest_ns = min(d for _, d in self._bins)
        fresh = list(self._bins)[-_FRESH_BINS:]
        if len(fresh) == _FRESH_BINS and min(d for _, d in fresh) > smallest_ns + _STEP_NS:
            self._bins = deque(fresh, maxlen=_BINS)
            smallest_ns = min(d for _, d in fresh)
        self._offset_ns = smallest_ns

    @property
    def offset_ns(self) -> int | None:
        """The estimate, None before the first message."""
        return self._offset_ns


@dataclass(slots=True)
class Due:
    """What the deadlines know of a device.

    Attributes:
        offset: of its clock.
        newest_ns: its newest measurement.
        heard_ns: when it was last heard, on our clock.
        next_tick: the first tick that is not closed.
        entry_ns: the deadline under which it stands in the queue.
    """

    offset: ClockOffset = field(default_factory=ClockOffset)
    newest_ns: int = 0
    heard_ns: int = 0
    next_tick: int | None = None
    entry_ns: int | None = None


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
        self._devices: dict[str, Due] = {}
        self._queue: list[tuple[int, str]] = []

    def heard(self, device: str, newest_ns: int, next_tick: int | None, *, arrived_ns: int) -> None:
        """Take note of what arrived.

        Args:
            newest_ns: the device's newest measurement that its timeline believes.
            next_tick: the first tick that is not closed, None while there is none.
            arrived_ns: when it arrived, on our clock.
        """
        due = self._devices.setdefault(device, Due())
        if newest_ns < due.newest_ns:  # its clock started anew
            due.offset = ClockOffset()
        if newest_ns != due.newest_ns:
            due.offset.heard(newest_ns, arrived_ns)
        due.newest_ns, due.heard_ns = newest_ns, arrived_ns
        self.closed(device, next_tick)

    def closed(self, device: str, next_tick: int | None) -> None:
        """Take note of which tick is the first that is not closed."""
        due = self._devices.get(device)
        if due is None:
            return
        due.next_tick = next_tick
        deadline_ns = self._deadline_ns(due)
        if deadline_ns is not None and (due.entry_ns is None or deadline_ns != due.entry_ns):
            due.entry_ns = deadline_ns
            heapq.heappush(self._queue, (deadline_ns, device))

    def forget(self, device: str) -> None:
        """The device is gone."""
        self._devices.pop(device, None)

    def next_ns(self) -> int | None:
        """Return the earliest deadline, None where nothing is to come."""
        while self._queue:
            deadline_ns, device = self._queue[0]
            due = self._devices.get(device)
            if due is not None and due.entry_ns == deadline_ns and self._deadline_ns(due) == deadline_ns:
                return deadline_ns
            heapq.heappop(self._queue)
        return None

    def due(self, now_ns: int) -> list[tuple[str, int, int]]:
        """Return, and no longer wait for, what is due: device, the tick to close up to, and when it was due."""
        found = []
        while (deadline_ns := self.next_ns()) is not None and deadline_ns <= now_ns:
            _, device = heapq.heappop(self._queue)
            due = self._devices[device]
            due.entry_ns = None
            offset_ns = due.offset.offset_ns
            if offset_ns is None or due.next_tick is None:
                continue
            latest = (now_ns - offset_ns - self._grace_ns) // TICK_NS
            found.append((device, min(latest, self._last(due)), deadline_ns))
        return found

    def silent(self, since_ns: int) -> list[str]:
        """Return the devices that were last heard before ``since_ns``."""
        return [device for device, due in self._devices.items() if due.heard_ns < since_ns]

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

    def _last(self, due: Due) -> int:
        return due.newest_ns // TICK_NS + self._coast_ticks

    def _deadline_ns(self, due: Due) -> int | None:
        offset_ns = due.offset.offset_ns
        if offset_ns is None or due.next_tick is None or due.next_tick > self._last(due):
            return None
        return due.next_tick * TICK_NS + offset_ns + self._grace_ns
