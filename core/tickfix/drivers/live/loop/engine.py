"""The loop of a live engine: what came in is written down and fed, what is due is folded, written down and said.

One round takes what waits in the hub, feeds it, runs every device that it touched and every one whose tick is due,
commits the journal once, and only then publishes and acknowledges. So nobody hears what a restart could not repeat.
Rounds begin at least a few milliseconds apart: devices that are due at about the same time are folded together.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, Final

from tickfix.drivers.live.commands import obey
from tickfix.drivers.live.errors import OverrunError
from tickfix.drivers.live.folding import Folding
from tickfix.drivers.live.histogram import Histogram
from tickfix.drivers.live.ledger import Ledger
from tickfix.drivers.live.loop.deadlines import Deadlines
from tickfix.drivers.live.loop.devices import Devices
from tickfix.drivers.live.loop.intake import Intake
from tickfix.drivers.live.loop.overload import Overload
from tickfix.drivers.live.loop.scans import Locating, Scans
from tickfix.drivers.live.loop.tasks import Tasks
from tickfix.drivers.live.outbox import Outbox
from tickfix.drivers.live.settings import LiveSettings
from tickfix.drivers.live.speaker import Speaker
from tickfix.kernel import Outcome
from tickfix.ports import Clock, Command, Hub
from tickfix.ports.intake import Item

_IDLE_S: Final = 0.25
_MOST: Final = 2_000
_LOOK_NS: Final = 1_000_000_000


class Engine:
    """Runs until it is told to stop.

    Args:
        replica: begun, or restored.
        locating: locates scans beside the loop, and wakes the hub when one is done.
        names: of the pipelines, in their order.
        after_round: called with the engine after each round, at least four times a second.
        tell: told, in a sentence, what an operator must know.
    """

    def __init__(
        self,
        replica: Folding,
        locating: Locating,
        hub: Hub,
        ledger: Ledger,
        settings: LiveSettings,
        *,
        site: str,
        names: Sequence[str],
        clock: Clock | None = None,
        after_round: Callable[[Engine], None] = lambda _: None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Prepare the loop; :meth:`serve` runs it."""
        self._replica = replica
        self._hub = hub
        self._ledger = ledger
        self._settings = settings
        self._names = tuple(names)
        self._clock = Clock() if clock is None else clock
        self._after_round = after_round
        self._tell = tell
        self._overload = Overload(settings.overload_s)
        self._devices = Devices(Deadlines(round(settings.grace_ms * 1e6), round(settings.coast_s * 1e9)))
        self._scans = Scans(locating)
        self._outbox = outbox = Outbox(hub, ledger, on_disk=settings.durability == "ack", tell=tell)
        self._speaker = speaker = Speaker(replica, ledger, outbox, settings, site=site, names=names, clock=self._clock)
        self._tasks = Tasks(replica, self._devices, self._scans, ledger, speaker, outbox, hub, self._clock)
        self._intake = Intake(
            replica, self._devices, self._scans, self._tasks, ledger, outbox, hub, contest=speaker.contest, tell=tell
        )
        self._stopping = False
        self._looked_ns = 0
        self._round_ns = 0
        self._rounds = 0
        self._expired = 0
        self._work = Histogram()

    @property
    def overload(self) -> str | None:
        """Why new devices are refused, None when all is well."""
        if self._outbox.full:
            return self._outbox.full
        return f"more than {self._settings.overload_s:g} s behind" if self._overload.announced else None

    def report(self) -> dict[str, Any]:
        """Return what an operator wants to know, as plain values."""
        books = self._replica.books()
        return {
            "devices": books.devices,
            "ticks": self._speaker.ticks,
            "lateness_ms": self._speaker.lateness.summary(),
            "work_ms": self._work.summary(),
            "measurements": books.measurements,
            "missing": books.missing,
            "failures": books.failures,
            "journal": self._ledger.status(),
            "overload": self.overload,
            "comparison": self._speaker.contest.report(),
            "primary": self._speaker.primary,
            "scans": {"being located": self._scans.being_located, "given up": self._scans.given_up},
            "rounds": self._rounds,
            "put off": self._intake.put_off,
            "mishaps": self._intake.mishaps,
            "withheld": self._speaker.withheld,
            "overloads": self._overload.times,
            "expired": self._expired,
        }

    def devices(self, most: int) -> tuple[dict[str, Any], ...]:
        """Return how far each device has come, ``most`` of them."""
        return self._devices.listed(most)

    def adopt(self) -> None:
        """Take over what the replica was restored with: its devices and the scans that wait to be located."""
        self._devices.adopt(self._replica.standings(), self._clock.monotonic_ns())
        self._scans.adopt(self._replica.waiting)

    def serve(self) -> None:
        """Run until told to stop, by :meth:`stop` or over the control port.

        Raises:
            OverrunError: when it falls behind and the overrun policy is ``fail``.
            JournalError: when the journal cannot be written for another reason than a full disk.
        """
        try:
            while not self._stopping:
                self._round(self._gathered())
        finally:
            self._scans.stop()

    def stop(self) -> None:
        """Stop after this round; from any thread."""
        self._stopping = True
        self._hub.wake()

    def drain(self) -> None:
        """Settle all that is known of every device."""
        for device in self._devices:
            self._tasks.finish(device, "drained")
        self._outbox.flush(self._replica.snapshot, self._clock.monotonic_ns())

    def _gathered(self) -> list[Item]:
        """Wait until something is there or due, and until the last round is long enough ago."""
        items = self._hub.take(self._wait_s(), _MOST)
        early_ns = self._round_ns + round(self._settings.round_ms * 1e6) - self._clock.monotonic_ns()
        if early_ns > 0:
            time.sleep(early_ns * 1e-9)
            items += self._hub.take(0.0, _MOST - len(items))
        return items

    def _wait_s(self) -> float:
        if self._devices.any_behind and not self._outbox.full:
            return 0.0
        next_ns = None if self._outbox.full else self._devices.deadlines.next_ns()
        if next_ns is None:
            return _IDLE_S
        return min(_IDLE_S, max(0.0, (next_ns - self._clock.monotonic_ns()) * 1e-9))

    def _round(self, items: Sequence[Item]) -> None:
        begun_ns = self._round_ns = self._clock.monotonic_ns()
        self._rounds += 1
        for item in items:
            if isinstance(item, Command):
                if not self._outbox.full:
                    self._tasks.do_now()
                stops = obey(item, self._hub, self._replica, self._ledger, self._names, self.drain)
                self._stopping = self._stopping or stops
            elif self._outbox.full:
                self._hub.answer(item, Outcome.BUSY, self._outbox.full)
            else:
                self._intake.take(item)
        oldest_ns = None
        if not self._outbox.full:
            self._tasks.let_in(self._scans.decided())
            oldest_ns = self._tasks.run_what_is_due(begun_ns)
            self._tasks.do()
            self._expire(begun_ns)
        self._outbox.flush(self._replica.snapshot, begun_ns)
        now_ns = self._clock.monotonic_ns()
        if oldest_ns is not None:
            self._work.add((now_ns - begun_ns) * 1e-6)
        self._watch(0 if oldest_ns is None else now_ns - oldest_ns, now_ns)
        self._after_round(self)

    def _expire(self, now_ns: int) -> None:
        if now_ns - self._looked_ns < _LOOK_NS:
            return
        self._looked_ns = now_ns
        for device in self._devices.deadlines.silent(now_ns - round(self._settings.expire_s * 1e9)):
            self._expired += 1
            self._tasks.finish(device, "silent")

    def _watch(self, lateness_ns: int, now_ns: int) -> None:
        if not self._overload.late(lateness_ns, now_ns):
            return
        if not self._overload.announced:
            self._hub.refuse(None)
            self._tell("the loop keeps up again: new devices are let in")
            return
        n = len(self._devices.deadlines.devices)
        message = f"overload: the loop is {lateness_ns * 1e-9:.1f} s behind with {n} devices"
        if self._settings.overrun == "fail":
            raise OverrunError(f"{message}, and overrun = 'fail'")
        self._hub.refuse(f"the engine is {self.overload}")
        self._tell(f"{message}; new devices are refused until it keeps up")
