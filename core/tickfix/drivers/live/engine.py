"""The loop of a live engine: what came in is written down and fed, what is due is folded, written down and said.

One round takes what waits in the hub, feeds it, runs every device that it touched and every one whose tick is due,
commits the journal once, and only then publishes and acknowledges. So nobody hears what a restart could not repeat.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import Any, Final

from tickfix.api import Scan, Truth
from tickfix.drivers.live.deadlines import Deadlines
from tickfix.drivers.live.errors import EngineError
from tickfix.drivers.live.histogram import Histogram
from tickfix.drivers.live.ledger import Ledger
from tickfix.drivers.live.locating import Locator
from tickfix.drivers.live.outbox import Outbox
from tickfix.drivers.live.overload import Overload
from tickfix.drivers.live.replica import Replica
from tickfix.drivers.live.settings import LiveSettings
from tickfix.drivers.live.speaker import Speaker
from tickfix.kernel import Outcome
from tickfix.ports import Clock, Command, Hub, Incoming
from tickfix.ports.intake import Item
from tickfix.wire import Bye, Hello
from tickfix.wire.decisions import Drop, Finish, Fold, Primary, Run

_IDLE_S: Final = 0.25
_MOST: Final = 2_000
_LOOK_NS: Final = 1_000_000_000


class Engine:
    """Runs until it is told to stop.

    Args:
        replica: begun, or restored.
        names: of the pipelines, in their order.
        after_round: called with the engine after each round, at least four times a second.
        tell: told, in a sentence, what an operator must know.
    """

    def __init__(
        self,
        replica: Replica,
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
        self._deadlines = Deadlines(round(settings.grace_ms * 1e6), round(settings.coast_s * 1e9))
        self._locator = Locator(
            hub.wake,
            threads=settings.locators,
            timeout_s=settings.locate_timeout_s,
            clock_ns=self._clock.monotonic_ns,
        )
        self._overload = Overload(settings.overload_s)
        self._asked: dict[int, Incoming] = {}
        self._to_locate: dict[str, deque[int]] = {}
        self._in_flight: set[tuple[str, str, int]] = set()
        self._outbox = Outbox(hub, ledger, on_disk=settings.durability == "ack", tell=tell)
        self._speaker = Speaker(replica, ledger, self._outbox, settings, site=site, names=names, clock=self._clock)
        self._stopping = False
        self._looked_ns = 0
        self.work = Histogram()
        self.counts: Counter[str] = Counter()

    @property
    def overload(self) -> str | None:
        """Why new devices are refused, None when all is well."""
        if self._outbox.full:
            return self._outbox.full
        return f"more than {self._settings.overload_s:g} s behind" if self._overload.announced else None

    def report(self) -> dict[str, Any]:
        """Return what an operator wants to know, as plain values."""
        kernel = self._replica.kernel
        return {
            "devices": len(kernel.devices),
            "ticks": self._speaker.ticks,
            "lateness_ms": self._speaker.lateness.summary(),
            "work_ms": self.work.summary(),
            "measurements": dict(kernel.measurements),
            "missing": kernel.missing,
            "failures": dict(kernel.failures),
            "journal": self._ledger.status(),
            "overload": self.overload,
            "comparison": self._speaker.contest.report(),
            "primary": self._speaker.primary,
            "scans": {"being located": self._locator.waiting, "given up": self.counts["scans given up"]},
            "rounds": self.counts["rounds"],
            "withheld": self._speaker.withheld,
            "overloads": self.counts["overloads"],
            "expired": self.counts["expired"],
        }

    def devices(self, most: int) -> tuple[dict[str, Any], ...]:
        """Return how far each device has come, ``most`` of them."""
        kernel, found = self._replica.kernel, []
        for device in kernel.devices[:most]:
            standing = kernel.standing(device)
            if standing is not None:
                found.append(
                    {
                        "device": device,
                        "epoch": standing.epoch,
                        "newest_ns": standing.newest_ns,
                        "next_tick": standing.next_tick,
                        "clock_offset_ns": self._deadlines.offset_ns(device),
                    }
                )
        return tuple(found)

    def adopt(self) -> None:
        """Take over what the replica was restored with: its devices and the scans that wait to be located."""
        now_ns = self._clock.monotonic_ns()
        for device in self._replica.kernel.devices:
            standing = self._replica.kernel.standing(device)
            if standing is not None and standing.newest_ns is not None:
                self._deadlines.heard(device, standing.newest_ns, standing.next_tick, arrived_ns=now_ns)
        for number, scan in self._replica.waiting.items():
            self._in_flight.add((scan.device, scan.session, scan.seq))
            self._ask(number, scan)

    def serve(self) -> None:
        """Run until told to stop, by :meth:`stop` or over the control port.

        Raises:
            EngineError: when it falls behind and the overrun policy is ``fail``.
            JournalError: when the journal cannot be written for another reason than a full disk.
        """
        try:
            while not self._stopping:
                self._round(self._wait_s())
        finally:
            self._locator.stop()

    def stop(self) -> None:
        """Stop after this round; from any thread."""
        self._stopping = True
        self._hub.wake()

    def drain(self) -> None:
        """Settle all that is known of every device."""
        for device in self._replica.kernel.devices:
            self._finish(device, "drained")
        self._outbox.flush(self._replica.snapshot, self._clock.monotonic_ns())

    def _wait_s(self) -> float:
        next_ns = None if self._outbox.full else self._deadlines.next_ns()
        if next_ns is None:
            return _IDLE_S
        return min(_IDLE_S, max(0.0, (next_ns - self._clock.monotonic_ns()) * 1e-9))

    def _round(self, wait_s: float) -> None:
        items = self._hub.take(wait_s, _MOST)
        begun_ns = self._clock.monotonic_ns()
        self.counts["rounds"] += 1
        touched: dict[str, int] = {}
        for item in items:
            if isinstance(item, Command):
                stops = obey(item, self._hub, self._replica, self._ledger, self._names, self.drain)
                self._stopping = self._stopping or stops
            elif self._outbox.full:
                self._hub.answer(item, Outcome.BUSY, self._outbox.full)
            else:
                self._take_in(item, touched)
        due: list[tuple[str, int, int]] = []
        if not self._outbox.full:
            self._let_in(touched)
            due = self._deadlines.due(begun_ns)
            for device, received_ns in touched.items():
                self._run(device, None, received_ns)
            for device, tick, due_ns in due:
                self._run(device, tick, due_ns)
            self._expire(begun_ns)
        self._outbox.flush(self._replica.snapshot, begun_ns)
        now_ns = self._clock.monotonic_ns()
        oldest_ns = min([due_ns for _, _, due_ns in due] + list(touched.values()), default=now_ns)
        if due or touched:
            self.work.add((now_ns - begun_ns) * 1e-6)
        self._watch(now_ns - oldest_ns, now_ns)
        self._after_round(self)

    def _take_in(self, item: Incoming, touched: dict[str, int]) -> None:
        event = item.event
        if isinstance(event, Hello):
            self._outbox.answer(item, Outcome.ACCEPTED)
            return
        if isinstance(event, Bye):
            self._finish(event.device, "bye")
            self._outbox.answer(item, Outcome.ACCEPTED)
            return
        number = (event.device, event.session, event.seq)
        if (event.seq > 0 and number in self._in_flight) or self._replica.kernel.repeats(event):
            self._outbox.answer(item, Outcome.DUPLICATE)
            return
        if isinstance(event, Truth):
            self._speaker.contest.truth(event)
        record = self._ledger.event(event)
        outcome = self._replica.event(record, event)
        if outcome is not None:
            self._outbox.answer(item, outcome)
            self._heard(event.device, item.received_ns, touched)
        elif isinstance(event, Scan):
            self._asked[record] = item
            self._in_flight.add(number)
            self._ask(record, event)

    def _ask(self, number: int, scan: Scan) -> None:
        """Have a scan located; those of a device one after the other, since each stands in the next one's window."""
        queue = self._to_locate.setdefault(scan.device, deque())
        queue.append(number)
        if len(queue) == 1:
            self._locator.ask(number, scan.device, self._replica.kernel.questions(scan))

    def _let_in(self, touched: dict[str, int]) -> None:
        """Fold the scans that are located by now, and give up those that will not be."""
        for located in self._locator.done():
            scan = self._replica.waiting.get(located.number)
            if scan is None:
                continue  # its device is gone
            if located.reason:
                self.counts["scans given up"] += 1
                self._decide_on_scan(Drop(number=located.number, reason=located.reason), scan)
            else:
                received_ns = self._decide_on_scan(Fold(number=located.number), scan)
                self._heard(scan.device, received_ns, touched)
            self._ask_next(scan.device)

    def _ask_next(self, device: str) -> None:
        queue = self._to_locate[device]
        queue.popleft()
        if queue:
            self._locator.ask(queue[0], device, self._replica.kernel.questions(self._replica.waiting[queue[0]]))
        else:
            del self._to_locate[device]

    def _decide_on_scan(self, decision: Fold | Drop, scan: Scan) -> int:
        """Let a scan in or leave it out, and acknowledge it; return when it was received."""
        self._in_flight.discard((scan.device, scan.session, scan.seq))
        self._ledger.decision(decision, scan.device, scan.t_ns)
        _, outcome = self._replica.decide(decision)
        item = self._asked.pop(decision.number, None)
        if item is None:
            return self._clock.monotonic_ns()
        detail = decision.reason if isinstance(decision, Drop) else ""
        self._outbox.answer(item, outcome or Outcome.ACCEPTED, detail)
        return item.received_ns

    def _heard(self, device: str, received_ns: int, touched: dict[str, int]) -> None:
        standing = self._replica.kernel.standing(device)
        if standing is not None and standing.newest_ns is not None:
            self._deadlines.heard(device, standing.newest_ns, standing.next_tick, arrived_ns=received_ns)
            touched[device] = received_ns

    def _run(self, device: str, tick: int | None, due_ns: int) -> None:
        decision = Run(device=device, tick=tick)
        output, _ = self._replica.decide(decision)
        standing = self._replica.kernel.standing(device)
        if standing is not None:
            self._deadlines.closed(device, standing.next_tick)
        if output.published or output.revised or output.settled:
            newest_ns = 0 if standing is None or standing.newest_ns is None else standing.newest_ns
            self._ledger.decision(decision, device, newest_ns)
            self._speaker.say(output, due_ns)

    def _finish(self, device: str, reason: str) -> None:
        if device not in self._replica.kernel.devices:
            return
        for number, scan in [(n, s) for n, s in self._replica.waiting.items() if s.device == device]:
            self._decide_on_scan(Drop(number=number, reason=f"the device is gone: {reason}"), scan)
        self._to_locate.pop(device, None)
        decision = Finish(device=device, reason=reason)
        output, _ = self._replica.decide(decision)
        self._ledger.decision(decision, device, 0)
        self._speaker.say(output, None)
        self._speaker.contest.finish(device)
        self._deadlines.forget(device)
        self._hub.forget(device)

    def _expire(self, now_ns: int) -> None:
        if now_ns - self._looked_ns < _LOOK_NS:
            return
        self._looked_ns = now_ns
        for device in self._deadlines.silent(now_ns - round(self._settings.expire_s * 1e9)):
            self.counts["expired"] += 1
            self._finish(device, "silent")

    def _watch(self, lateness_ns: int, now_ns: int) -> None:
        if not self._overload.late(lateness_ns, now_ns):
            return
        if not self._overload.announced:
            self._hub.refuse(None)
            self._tell("the loop keeps up again: new devices are let in")
            return
        self.counts["overloads"] += 1
        message = f"overload: the loop is {lateness_ns * 1e-9:.1f} s behind with {len(self._deadlines.devices)} devices"
        if self._settings.overrun == "fail":
            raise EngineError(f"{message}, and overrun = 'fail'")
        self._hub.refuse(f"the engine is {self.overload}")
        self._tell(f"{message}; new devices are refused until it keeps up")


def obey(
    command: Item, hub: Hub, replica: Replica, ledger: Ledger, names: Sequence[str], drain: Callable[[], None]
) -> bool:
    """Do what the control port was told; return whether the engine is to stop.

    Args:
        command: what else came in is refused: nobody is there to take it.
        drain: settles all that is known of every device.
    """
    if not isinstance(command, Command):
        hub.answer(command, Outcome.BUSY, "this engine takes nothing in")
        return False
    if command.what == "stop":
        command.reply(*_done("stopping"))
        return True
    if command.what == "drain":
        hub.refuse_all("the engine is being drained")
        drain()
        command.reply(*_done("drained: every track is settled; stopping"))
        return True
    name = command.args.get("pipeline")
    if command.what != "primary":
        command.reply(*_refused(f"what: found {command.what!r}, expected drain, stop or primary"))
    elif name not in names:
        command.reply(*_refused(f"pipeline: found {name!r}, expected one of {', '.join(names)}"))
    else:
        decision = Primary(pipeline=str(name))
        ledger.decision(decision, "", 0)
        replica.decide(decision)
        command.reply(*_done(f"{name} is published from now on"))
    return False


def _done(what: str) -> tuple[bool, str]:
    return True, what


def _refused(why: str) -> tuple[bool, str]:
    return False, why
