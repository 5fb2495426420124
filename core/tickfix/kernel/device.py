"""One device: the epoch that its clock is in, and the change to the next."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from tickfix.api.events import Event, Fix, Scan
from tickfix.kernel.batch import StepCoroutine, step_one
from tickfix.kernel.deduplication import MessageOutcome
from tickfix.kernel.epoch import Epoch, KernelOutput
from tickfix.kernel.measurements import Measurement, split_event
from tickfix.kernel.snapshot import DeviceSnapshot
from tickfix.kernel.stages import KernelSetup
from tickfix.kernel.tracker import FingerprintRequest


@dataclass(frozen=True, slots=True)
class DeviceProgress:
    """How far a device has come.

    Attributes:
        epoch: of its clock.
        newest_ns: its newest measurement that is believed, on its clock.
        next_tick: the first tick that is not closed, None before there is one.
        watermark: the newest tick that the data has passed; while it is not closed, more is due.
    """

    epoch: int
    newest_ns: int | None
    next_tick: int | None
    watermark: int | None = None

    @property
    def backlog(self) -> int:
        """How many ticks the data has passed that are not closed."""
        return 0 if self.watermark is None or self.next_tick is None else max(0, self.watermark + 1 - self.next_tick)


class Device:
    """One device: the epoch its clock is in, and the beginning of the next."""

    def __init__(self, setup: KernelSetup, device: str, *, known: Fix | None = None, number: int = 0) -> None:
        """Begin with nothing measured, in epoch ``number``; ``known`` is the start, where it is known."""
        self._setup = setup
        self._device = device
        self._pending = KernelOutput()
        self._number = number
        self._epoch = Epoch(setup, device, number, known)

    def feed(self, event: Event, *, out_of_order: bool = False) -> MessageOutcome:
        """Insert an event into the timeline; nothing is folded yet.

        Args:
            event: of this device.
            out_of_order: something sent after it has taken the clock further.
        """
        inserted = self._epoch.timeline.insert(event, out_of_order=out_of_order)
        restart: list[Measurement] = inserted.restart
        if restart:
            # The clock restarted: the old epoch is over, and its last ticks are published. Times of the two clocks
            # cannot be compared, so nothing is carried over.
            step_one(self._epoch.finish(self._pending), self._setup.call)
            self._number += 1
            self._epoch = Epoch(self._setup, self._device, self._number, None)
            # At most one restart per message: else one that jumps back and forth could begin a thousand epochs.
            self._setup.measurements["dropped"] += len(self._epoch.timeline.insert_measurements(restart))
        return inserted.outcome

    def run(self, tick: int | None = None, max_ticks: int | None = None) -> StepCoroutine[KernelOutput]:
        """Fold what is due: ticks that the data has passed, or up to ``tick`` where the driver closes it.

        At most ``max_ticks`` ticks are closed, where that is given.
        """
        due = max((k for k in (self._epoch.timeline.watermark, tick) if k is not None), default=None)
        next_tick = self._next_tick
        if due is not None and next_tick is not None:
            due = max(due, next_tick - 1)
            due = due if max_ticks is None else min(due, next_tick - 1 + max_ticks)
        output, self._pending = self._pending, KernelOutput()
        yield from self._epoch.run(due, output)
        return output

    def finish(self) -> StepCoroutine[KernelOutput]:
        """Fold and settle everything; nothing more will come."""
        output, self._pending = self._pending, KernelOutput()
        yield from self._epoch.finish(output)
        return output

    def fingerprint_requests(self, scan: Scan) -> list[FingerprintRequest]:
        """Return what the fingerprints will be asked once ``scan`` is fed."""
        return [q for item in split_event(scan, Counter()) for q in self._epoch.fingerprint_requests(item.content)]

    @property
    def progress(self) -> DeviceProgress:
        """How far it has come."""
        timeline = self._epoch.timeline
        return DeviceProgress(self._number, timeline.newest_ns, self._next_tick, timeline.watermark)

    @property
    def reached(self) -> tuple[int, int | None]:
        """How far the clock has come: its epoch, and the newest measurement in it."""
        return self._number, self._epoch.timeline.newest_ns

    @property
    def number(self) -> int:
        """The number of the epoch that the clock is in."""
        return self._number

    def snapshot(self) -> DeviceSnapshot:
        """Return the device as a value; :meth:`run` must have followed the last :meth:`feed`."""
        if self._pending != KernelOutput():
            raise RuntimeError(
                f"{self._device}: estimates of the last restart are pending; call run() before snapshot()"
            )
        return DeviceSnapshot(self._device, self._number, self._epoch.snapshot())

    def restore(self, kept: DeviceSnapshot) -> StepCoroutine[None]:
        """Restore a snapshot."""
        self._number = kept.number
        if kept.number:
            self._epoch = Epoch(self._setup, self._device, kept.number, None)
        yield from self._epoch.restore(kept.epoch)

    @property
    def _next_tick(self) -> int | None:
        epoch = self._epoch
        return epoch.timeline.first if epoch.published is None else epoch.published + 1
