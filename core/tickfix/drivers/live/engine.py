"""The loop of a live engine: what came in is written down and fed, what is due is folded, written down and said.

One round takes what waits in the hub, feeds it, runs every device that it touched and every one whose tick is due,
commits the journal once, and only then publishes and acknowledges. So nobody hears what a restart could not repeat.
Rounds begin at least a few milliseconds apart: devices that are due at about the same time are folded together.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final

from tickfix.api import Event, PluginError, Scan, Truth
from tickfix.api.errors import PortError
from tickfix.drivers.live.commands import obey
from tickfix.drivers.live.deadlines import Deadlines
from tickfix.drivers.live.errors import EngineError, OverrunError
from tickfix.drivers.live.folding import Done, Feed, Folding, Step
from tickfix.drivers.live.histogram import Histogram
from tickfix.drivers.live.ledger import Ledger
from tickfix.drivers.live.outbox import Outbox
from tickfix.drivers.live.overload import Overload
from tickfix.drivers.live.scans import Decided, Locating, Scans
from tickfix.drivers.live.settings import LiveSettings
from tickfix.drivers.live.speaker import Speaker
from tickfix.journal import JournalError
from tickfix.kernel import Outcome, Standing
from tickfix.ports import Clock, Command, Hub, Incoming
from tickfix.ports.intake import Item
from tickfix.wire import Bye, Hello, encode_event
from tickfix.wire.decisions import Drop, Finish, Run

_IDLE_S: Final = 0.25
_MOST: Final = 2_000
_LOOK_NS: Final = 1_000_000_000
_MOST_TICKS: Final = 100
"""A run closes so many ticks of a device at most: what one message made due is folded between the others' ticks."""
_MOST_BEHIND: Final = 3_000
"""Ticks of a device that wait to be folded, when its further messages are answered ``busy``."""


@dataclass(frozen=True, slots=True)
class Task:
    """A step to be done, and whom it concerns.

    Attributes:
        step: what the replica is to do.
        device: whose.
        since_ns: from when on it could be done, on our clock; None where nobody waited for it.
        item: the message that brought it, to be answered with what comes of it.
        answer: what is answered if the step itself has no outcome, and why.
    """

    step: Step
    device: str
    since_ns: int | None
    item: Incoming | None = None
    answer: tuple[Outcome, str] = (Outcome.ACCEPTED, "")


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
        self._deadlines = Deadlines(round(settings.grace_ms * 1e6), round(settings.coast_s * 1e9))
        self._overload = Overload(settings.overload_s)
        self._scans = Scans(locating)
        self._standings: dict[str, Standing] = {}
        self._behind: dict[str, int] = {}
        self._tasks: list[Task] = []
        self._gathered_numbers: set[tuple[str, str, int]] = set()
        self._outbox = Outbox(hub, ledger, on_disk=settings.durability == "ack", tell=tell)
        self._speaker = Speaker(replica, ledger, self._outbox, settings, site=site, names=names, clock=self._clock)
        self._stopping = False
        self._looked_ns = 0
        self._round_ns = 0
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
        books = self._replica.books()
        return {
            "devices": books.devices,
            "ticks": self._speaker.ticks,
            "lateness_ms": self._speaker.lateness.summary(),
            "work_ms": self.work.summary(),
            "measurements": books.measurements,
            "missing": books.missing,
            "failures": books.failures,
            "journal": self._ledger.status(),
            "overload": self.overload,
            "comparison": self._speaker.contest.report(),
            "primary": self._speaker.primary,
            "scans": {"being located": self._scans.being_located, "given up": self.counts["scans given up"]},
            "rounds": self.counts["rounds"],
            "put off": self.counts["put off"],
            "mishaps": self.counts["mishaps"],
            "withheld": self._speaker.withheld,
            "overloads": self.counts["overloads"],
            "expired": self.counts["expired"],
        }

    def devices(self, most: int) -> tuple[dict[str, Any], ...]:
        """Return how far each device has come, ``most`` of them."""
        return tuple(
            {
                "device": device,
                "epoch": standing.epoch,
                "newest_ns": standing.newest_ns,
                "next_tick": standing.next_tick,
                "clock_offset_ns": self._deadlines.offset_ns(device),
            }
            for device, standing in islice(self._standings.items(), most)
        )

    def adopt(self) -> None:
        """Take over what the replica was restored with: its devices and the scans that wait to be located."""
        now_ns = self._clock.monotonic_ns()
        self._standings = dict(self._replica.standings())
        for device in self._standings:
            self._heard(device, now_ns)
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
        for device in tuple(self._standings):
            self._finish(device, "drained")
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
        if self._behind and not self._outbox.full:
            return 0.0
        next_ns = None if self._outbox.full else self._deadlines.next_ns()
        if next_ns is None:
            return _IDLE_S
        return min(_IDLE_S, max(0.0, (next_ns - self._clock.monotonic_ns()) * 1e-9))

    def _round(self, items: Sequence[Item]) -> None:
        begun_ns = self._round_ns = self._clock.monotonic_ns()
        self.counts["rounds"] += 1
        for item in items:
            if isinstance(item, Command):
                if not self._outbox.full:
                    self._do_tasks_now()
                stops = obey(item, self._hub, self._replica, self._ledger, self._names, self.drain)
                self._stopping = self._stopping or stops
            elif self._outbox.full:
                self._hub.answer(item, Outcome.BUSY, self._outbox.full)
            else:
                self._take_in_safely(item)
        oldest_ns = None
        if not self._outbox.full:
            decided = self._scans.decided()
            self.counts["scans given up"] += sum(isinstance(found.decision, Drop) for found in decided)
            self._let_in(decided)
            oldest_ns = self._run_what_is_due(begun_ns)
            self._do_tasks()
            self._expire(begun_ns)
        self._outbox.flush(self._replica.snapshot, begun_ns)
        now_ns = self._clock.monotonic_ns()
        if oldest_ns is not None:
            self.work.add((now_ns - begun_ns) * 1e-6)
        self._watch(0 if oldest_ns is None else now_ns - oldest_ns, now_ns)
        self._after_round(self)

    def _take_in_safely(self, item: Incoming) -> None:
        """Take a message in; whatever is wrong with it, it costs nobody else anything."""
        try:
            self._take_in(item)
        except (JournalError, PortError, EngineError, PluginError):
            raise
        except Exception as error:  # noqa: BLE001 - see above
            self.counts["mishaps"] += 1
            self._tell(f"a message of {item.event.device!r} could not be taken in: {type(error).__name__}: {error}")
            self._hub.answer(item, Outcome.MALFORMED, f"{type(error).__name__}: {error}")

    def _why_not(self, event: Event) -> str:
        """Say why a device's message has to wait for what it sent before, if so."""
        behind = self._behind.get(event.device, 0)
        if behind > _MOST_BEHIND:
            return f"{behind} ticks of this device wait to be folded"
        if isinstance(event, Scan):
            return self._scans.why_not(event.device)
        return ""

    def _take_in(self, item: Incoming) -> None:
        event = item.event
        if isinstance(event, Hello):
            self._outbox.answer(item, Outcome.ACCEPTED)
            return
        if isinstance(event, Bye):
            self._do_tasks_now()
            if behind := self._behind.get(event.device):
                self.counts["put off"] += 1
                self._hub.answer(item, Outcome.BUSY, f"{behind} ticks of this device wait to be folded")
                return
            self._finish(event.device, "bye")
            self._outbox.answer(item, Outcome.ACCEPTED)
            return
        if event.seq > 0 and self._is_known(event):
            self._outbox.answer(item, Outcome.DUPLICATE)
            return
        if why := self._why_not(event):
            self.counts["put off"] += 1
            self._hub.answer(item, Outcome.BUSY, why)
            return
        if isinstance(event, Truth):
            self._speaker.contest.truth(event)
        self._gathered_numbers.add((event.device, event.session, event.seq))
        body = encode_event(event)
        step = Feed(self._ledger.event(event, body), event, body)
        self._tasks.append(Task(step, event.device, item.received_ns, item))

    def _let_in(self, decided: Sequence[Decided]) -> None:
        """Fold the scans that are located by now, and give up those that will not be."""
        for found in decided:
            decision, scan, item = found.decision, found.scan, found.item
            self._ledger.decision(decision, scan.device, scan.t_ns)
            since_ns = self._clock.monotonic_ns() if item is None else item.received_ns
            why = decision.reason if isinstance(decision, Drop) else ""
            self._tasks.append(Task(decision, scan.device, since_ns, item, (Outcome.ACCEPTED, why)))

    def _run_what_is_due(self, now_ns: int) -> int | None:
        """Run the devices that something came from, and those whose tick is due; return since when the first was."""
        runs: dict[str, tuple[int | None, int]] = {}
        for task in self._tasks:
            if task.since_ns is not None and not isinstance(task.step, Drop) and not _only_waits(task.step):
                since_ns = runs.get(task.device, (None, task.since_ns))[1]
                runs[task.device] = None, min(since_ns, task.since_ns)
        if self._behind:
            # One of those who are behind at a time, so that the others wait for no more than that.
            device = next(iter(self._behind))
            self._behind[device] = self._behind.pop(device)
            runs.setdefault(device, (None, now_ns))
        for device, tick, due_ns in self._deadlines.due(now_ns):
            # What a device that is behind sent was more than can be folded at once: that is no lateness of the loop.
            since_ns = now_ns if device in self._behind else due_ns
            runs[device] = tick, min(since_ns, runs.get(device, (None, since_ns))[1])
        self._tasks += [Task(Run(device=d, tick=tick, most=_MOST_TICKS), d, since) for d, (tick, since) in runs.items()]
        return min((since_ns for _, since_ns in runs.values()), default=None)

    def _do_tasks_now(self) -> None:
        """Do what was gathered before the round is over; what was fed is run, for a snapshot may be asked for next."""
        self._run_what_is_due(self._clock.monotonic_ns())
        self._do_tasks()

    def _do_tasks(self) -> None:
        """Have the replica do what was gathered, and tell everybody what came of it."""
        tasks, self._tasks = self._tasks, []
        self._gathered_numbers.clear()
        for task, done in zip(tasks, self._replica.apply([task.step for task in tasks]), strict=True):
            if done.standing is not None:
                self._standings[task.device] = done.standing
            if isinstance(task.step, Run):
                self._ran(task, task.step, done)
            elif isinstance(task.step, Feed) and isinstance(task.step.event, Scan):
                self._scans.add(task.step.number, task.step.event, task.item)
            else:
                self._entered(task, done)

    def _entered(self, task: Task, done: Done) -> None:
        """An event is in its timeline, or never will be: say so."""
        outcome, why = task.answer
        if task.item is not None:
            self._outbox.answer(task.item, done.outcome or outcome, why)
        if done.outcome is not None and task.since_ns is not None:
            self._heard(task.device, task.since_ns)

    def _ran(self, task: Task, run: Run, done: Done) -> None:
        lost = done.standing is None and task.device in self._standings
        if lost:
            self._forget(task.device)
        standing = self._standings.get(task.device)
        self._behind.pop(task.device, None)
        if standing is not None:
            self._deadlines.closed(task.device, standing.next_tick)
            if standing.behind:
                self._behind[task.device] = standing.behind
        if done.spoke or lost:  # whoever repeats the run must lose the device there, too
            newest_ns = 0 if standing is None or standing.newest_ns is None else standing.newest_ns
            self._ledger.decision(run, task.device, newest_ns)
            self._speaker.say(done.said, task.since_ns)

    def _heard(self, device: str, received_ns: int) -> None:
        standing = self._standings.get(device)
        if standing is not None and standing.newest_ns is not None:
            self._deadlines.heard(device, standing.newest_ns, standing.next_tick, arrived_ns=received_ns)

    def _is_known(self, event: Event) -> bool:
        """Tell whether a message with this number came before: it waits, is gathered, or was fed."""
        return (
            (event.device, event.session, event.seq) in self._gathered_numbers
            or self._scans.is_in_flight(event)
            or self._replica.repeats(event)
        )

    def _finish(self, device: str, reason: str) -> None:
        if device not in self._standings:
            return
        self._let_in(self._scans.drop(device, f"the device is gone: {reason}"))
        self._do_tasks()
        decision = Finish(device=device, reason=reason)
        (done,) = self._replica.apply([decision])
        self._ledger.decision(decision, device, 0)
        self._speaker.say(done.said, None)
        self._speaker.contest.finish(device)
        self._forget(device)

    def _forget(self, device: str) -> None:
        self._standings.pop(device, None)
        self._behind.pop(device, None)
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
            raise OverrunError(f"{message}, and overrun = 'fail'")
        self._hub.refuse(f"the engine is {self.overload}")
        self._tell(f"{message}; new devices are refused until it keeps up")


def _only_waits(step: Step) -> bool:
    """Tell whether a step changes nothing that a run could fold: a scan is located first, and truth is for nobody."""
    return isinstance(step, Feed) and isinstance(step.event, Scan | Truth)
