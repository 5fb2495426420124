"""One device: the epoch that its clock is in, and the beginning of the next."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from tickfix.api.events import Event, Fix, Scan
from tickfix.kernel.epoch import Epoch, Output
from tickfix.kernel.intake import Outcome
from tickfix.kernel.measurements import Item, explode
from tickfix.kernel.observing import Question
from tickfix.kernel.randomness import Streams
from tickfix.kernel.snapshot import DeviceSnapshot
from tickfix.kernel.stages import Caller, Pipeline
from tickfix.kernel.together import Asking, alone


@dataclass(frozen=True, slots=True)
class Standing:
    """How far a device has come.

    Attributes:
        epoch: of its clock.
        newest_ns: its newest measurement that is believed, on its clock.
        next_tick: the first tick that is not closed, None before there is one.
        passed: the newest tick that the data has passed; while it is not closed, more is due.
    """

    epoch: int
    newest_ns: int | None
    next_tick: int | None
    passed: int | None = None

    @property
    def behind(self) -> int:
        """How many ticks the data has passed that are not closed."""
        return 0 if self.passed is None or self.next_tick is None else max(0, self.passed + 1 - self.next_tick)


class Device:
    """One device: the epoch its clock is in, and the beginning of the next."""

    def __init__(
        self,
        device: str,
        pipelines: Sequence[Pipeline],
        call: Caller,
        counts: Counter[str],
        *,
        seed: int,
        horizon_ns: int,
        checkpoint_bytes: int,
        known: Fix | None = None,
        number: int = 0,
    ) -> None:
        """Begin with nothing measured, in epoch ``number``."""
        self._device = device
        self._pipelines = pipelines
        self._call = call
        self._counts = counts
        self._streams = Streams(seed, device)
        self._horizon_ns = horizon_ns
        self._checkpoint_bytes = checkpoint_bytes
        self._pending = Output()
        self._number = number
        self._epoch = self._begin(known)

    def feed(self, event: Event, *, overtaken: bool = False) -> Outcome:
        """Insert an event into the timeline; nothing is folded yet.

        Args:
            event: of this device.
            overtaken: something sent after it has taken the clock further.
        """
        inserted = self._epoch.timeline.insert(event, overtaken=overtaken)
        anew: list[Item] = inserted.anew
        if anew:
            # The clock started anew: what the old one showed is over, and its last ticks are published.
            alone(self._epoch.finish(self._pending), self._call)
            self._number += 1
            self._epoch = self._begin(None)
            # Once for a message: else one that leaps to and fro could begin a thousand epochs.
            self._counts["dropped"] += len(self._epoch.timeline.insert_items(anew))
        return inserted.outcome

    def run(self, tick: int | None = None, most: int | None = None) -> Asking[Output]:
        """Fold what is due: ticks that the data has passed, or up to ``tick`` where the driver closes it.

        At most ``most`` ticks are closed, where that is told.
        """
        due = max((k for k in (self._epoch.timeline.passed, tick) if k is not None), default=None)
        next_tick = self._next_tick
        if due is not None and next_tick is not None:
            due = max(due, next_tick - 1)
            due = due if most is None else min(due, next_tick - 1 + most)
        output, self._pending = self._pending, Output()
        yield from self._epoch.run(due, output)
        return output

    def finish(self) -> Asking[Output]:
        """Fold and settle everything; nothing more will come."""
        output, self._pending = self._pending, Output()
        yield from self._epoch.finish(output)
        return output

    def questions(self, scan: Scan) -> list[Question]:
        """Return what the fingerprints will be asked once ``scan`` is fed."""
        return [q for item in explode(scan, Counter()) for q in self._epoch.questions(item.content)]

    @property
    def standing(self) -> Standing:
        """How far it has come."""
        timeline = self._epoch.timeline
        return Standing(self._number, timeline.newest_ns, self._next_tick, timeline.passed)

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
        if self._pending != Output():
            raise RuntimeError(f"{self._device}: a snapshot was asked for while estimates wait to be said")
        return DeviceSnapshot(self._device, self._number, self._epoch.snapshot())

    def restore(self, kept: DeviceSnapshot) -> Asking[None]:
        """Become what ``kept`` says."""
        self._number = kept.number
        if kept.number:
            self._epoch = self._begin(None)
        yield from self._epoch.restore(kept.epoch)

    @property
    def _next_tick(self) -> int | None:
        epoch = self._epoch
        return epoch.timeline.first if epoch.published is None else epoch.published + 1

    def _begin(self, known: Fix | None) -> Epoch:
        return Epoch(
            self._device,
            self._number,
            self._pipelines,
            self._streams,
            self._call,
            self._counts,
            horizon_ns=self._horizon_ns,
            checkpoint_bytes=self._checkpoint_bytes,
            known=known,
        )
