"""What is to be done in a round: gathered, done by the replica in one go, and told to all whom it concerns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from tickfix.api import Event, Scan, Truth
from tickfix.drivers.live.folding import Done, Feed, Folding, Step
from tickfix.drivers.live.ledger import Ledger
from tickfix.drivers.live.loop.devices import Devices
from tickfix.drivers.live.loop.scans import Decided, Scans
from tickfix.drivers.live.outbox import Outbox
from tickfix.drivers.live.speaker import Speaker
from tickfix.kernel import Outcome
from tickfix.ports import Clock, Hub, Incoming
from tickfix.wire.decisions import Drop, Finish, Run

_MOST_TICKS: Final = 100
"""A run closes so many ticks of a device at most: what one message made due is folded between the others' ticks."""


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


class Tasks:
    """The tasks of a round, in their order."""

    def __init__(
        self,
        replica: Folding,
        devices: Devices,
        scans: Scans,
        ledger: Ledger,
        speaker: Speaker,
        outbox: Outbox,
        hub: Hub,
        clock: Clock,
    ) -> None:
        """Begin with nothing to do."""
        self._replica = replica
        self._devices = devices
        self._scans = scans
        self._ledger = ledger
        self._speaker = speaker
        self._outbox = outbox
        self._hub = hub
        self._clock = clock
        self._tasks: list[Task] = []
        self._numbers: set[tuple[str, str, int]] = set()

    def feed(self, feed: Feed, item: Incoming) -> None:
        """Have the event that a message brought fed."""
        event = feed.event
        self._numbers.add((event.device, event.session, event.seq))
        self._tasks.append(Task(feed, event.device, item.received_ns, item))

    def is_gathered(self, event: Event) -> bool:
        """Tell whether an event with this number waits to be fed."""
        return (event.device, event.session, event.seq) in self._numbers

    def let_in(self, decided: Sequence[Decided]) -> None:
        """Have the scans folded that are located by now, and those given up that will not be."""
        for found in decided:
            decision, scan, item = found.decision, found.scan, found.item
            self._ledger.decision(decision, scan.device, scan.t_ns)
            since_ns = self._clock.monotonic_ns() if item is None else item.received_ns
            why = decision.reason if isinstance(decision, Drop) else ""
            self._tasks.append(Task(decision, scan.device, since_ns, item, (Outcome.ACCEPTED, why)))

    def run_what_is_due(self, now_ns: int) -> int | None:
        """Have the devices run that something came from, and whose tick is due; return since when the first was."""
        runs: dict[str, tuple[int | None, int]] = {}
        for task in self._tasks:
            if task.since_ns is not None and not isinstance(task.step, Drop) and not _only_waits(task.step):
                since_ns = runs.get(task.device, (None, task.since_ns))[1]
                runs[task.device] = None, min(since_ns, task.since_ns)
        # One of those who are behind at a time, so that the others wait for no more than that.
        behind = self._devices.next_behind()
        if behind is not None:
            runs.setdefault(behind, (None, now_ns))
        for device, tick, due_ns in self._devices.deadlines.due(now_ns):
            # What a device that is behind sent was more than can be folded at once: that is no lateness of the loop.
            since_ns = now_ns if self._devices.behind(device) else due_ns
            runs[device] = tick, min(since_ns, runs.get(device, (None, since_ns))[1])
        self._tasks += [Task(Run(device=d, tick=tick, most=_MOST_TICKS), d, since) for d, (tick, since) in runs.items()]
        return min((since_ns for _, since_ns in runs.values()), default=None)

    def do_now(self) -> None:
        """Do what was gathered before the round is over; what was fed is run, for a snapshot may be asked for next."""
        self.run_what_is_due(self._clock.monotonic_ns())
        self.do()

    def do(self) -> None:
        """Have the replica do what was gathered, and tell everybody what came of it."""
        tasks, self._tasks = self._tasks, []
        self._numbers.clear()
        for task, done in zip(tasks, self._replica.apply([task.step for task in tasks]), strict=True):
            if done.standing is not None:
                self._devices.stands(task.device, done.standing)
            if isinstance(task.step, Run):
                self._ran(task, task.step, done)
            elif isinstance(task.step, Feed) and isinstance(task.step.event, Scan):
                self._scans.add(task.step.number, task.step.event, task.item)
            else:
                self._entered(task, done)

    def finish(self, device: str, reason: str) -> None:
        """Settle all that is known of a device, and let go of it."""
        if device not in self._devices:
            return
        self.let_in(self._scans.drop(device, f"the device is gone: {reason}"))
        self.do()
        decision = Finish(device=device, reason=reason)
        (done,) = self._replica.apply([decision])
        self._ledger.decision(decision, device, 0)
        self._speaker.say(done.said, None)
        self._speaker.contest.finish(device)
        self._forget(device)

    def _entered(self, task: Task, done: Done) -> None:
        """An event is in its timeline, or never will be: say so."""
        outcome, why = task.answer
        if task.item is not None:
            self._outbox.answer(task.item, done.outcome or outcome, why)
        if done.outcome is not None and task.since_ns is not None:
            self._devices.heard(task.device, task.since_ns)

    def _ran(self, task: Task, run: Run, done: Done) -> None:
        """A device was run: note how far it has come, and say what it says."""
        standing = done.standing
        lost = standing is None and task.device in self._devices
        if lost:
            self._forget(task.device)
        self._devices.ran(task.device, standing)
        if done.spoke or lost:  # whoever repeats the run must lose the device there, too
            newest_ns = 0 if standing is None or standing.newest_ns is None else standing.newest_ns
            self._ledger.decision(run, task.device, newest_ns)
            self._speaker.say(done.said, task.since_ns)

    def _forget(self, device: str) -> None:
        self._devices.forget(device)
        self._hub.forget(device)


def _only_waits(step: Step) -> bool:
    """Tell whether a step changes nothing that a run could fold: a scan is located first, and truth is for nobody."""
    return isinstance(step, Feed) and isinstance(step.event, Scan | Truth)
