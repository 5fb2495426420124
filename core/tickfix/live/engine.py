"""The round of a live engine.

Admit, feed, run, journal, publish. One round takes what waits in the hub, feeds it, runs every device it touched and
every one whose tick is due, commits the journal once, and only then publishes and acknowledges, so nobody hears what a
restart could not replay.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from tickfix.api import Event, PluginError, Scan, Truth
from tickfix.api.errors import PortError
from tickfix.journal import JournalError
from tickfix.live.engine_status import DurationHistogram
from tickfix.live.live_comparison import LiveComparison
from tickfix.live.localization import PendingScans, ScanDecision, ScanLocator
from tickfix.live.protocol import EngineError, Executor, FeedEvent, OverrunError, ReplicaStep, ReplicaStepResult
from tickfix.live.publisher import EstimatePublisher, PublishQueue, WriteAheadBuffer
from tickfix.live.scheduler import Deadlines, DeviceSchedule, OverloadDetector
from tickfix.live.serve_options import LiveSettings
from tickfix.ports import Clock, ControlCommand, Hub, InboundMessage
from tickfix.ports.inbound_queue import InboundItem
from tickfix.wire import Bye, Hello, ReplyOutcome, encode_event
from tickfix.wire.engine_messages import DropScan, FinishDevice, RunDevice, SelectPrimary

_MAX_TICKS_PER_RUN: Final = 100
"""A run closes so many ticks of a device at most: what one message made due is folded between the others' ticks."""


@dataclass(frozen=True, slots=True)
class RoundTask:
    """A step to be done, and whom it concerns.

    Attributes:
        step: what the replica is to do.
        device: whose.
        ready_ns: from when on it could be done, on our clock; None where nobody waited for it.
        item: the message that brought it, to be answered with what comes of it.
        answer: what is answered if the step itself has no outcome, and why.
    """

    step: ReplicaStep
    device: str
    ready_ns: int | None
    item: InboundMessage | None = None
    answer: tuple[ReplyOutcome, str] = (ReplyOutcome.ACCEPTED, "")


class RoundTasks:
    """The tasks of a round, in their order."""

    def __init__(
        self,
        replica: Executor,
        devices: DeviceSchedule,
        scans: PendingScans,
        write_ahead: WriteAheadBuffer,
        publisher: EstimatePublisher,
        publish_queue: PublishQueue,
        hub: Hub,
        clock: Clock,
    ) -> None:
        """Begin with nothing to do."""
        self._replica = replica
        self._devices = devices
        self._scans = scans
        self._write_ahead = write_ahead
        self._publisher = publisher
        self._publish_queue = publish_queue
        self._hub = hub
        self._clock = clock
        self._tasks: list[RoundTask] = []
        self._numbers: set[tuple[str, str, int]] = set()

    def feed(self, feed: FeedEvent, item: InboundMessage) -> None:
        """Have the event that a message brought fed."""
        event = feed.event
        self._numbers.add((event.device, event.session, event.seq))
        self._tasks.append(RoundTask(feed, event.device, item.received_ns, item))

    def is_pending(self, event: Event) -> bool:
        """Tell whether an event with this number waits to be fed."""
        return (event.device, event.session, event.seq) in self._numbers

    def admit_scans(self, decisions: Sequence[ScanDecision]) -> None:
        """Have the scans folded that are located by now, and those given up that will not be."""
        for found in decisions:
            decision, scan, item = found.decision, found.scan, found.item
            self._write_ahead.decision(decision, scan.device, scan.t_ns)
            ready_ns = self._clock.monotonic_ns() if item is None else item.received_ns
            why = decision.reason if isinstance(decision, DropScan) else ""
            self._tasks.append(RoundTask(decision, scan.device, ready_ns, item, (ReplyOutcome.ACCEPTED, why)))

    def schedule_due_runs(self, now_ns: int) -> int | None:
        """Have the devices run that something came from, and whose tick is due; return since when the first was."""
        runs: dict[str, tuple[int | None, int]] = {}
        for task in self._tasks:
            if task.ready_ns is not None and not isinstance(task.step, DropScan) and not _needs_no_run(task.step):
                ready_ns = runs.get(task.device, (None, task.ready_ns))[1]
                runs[task.device] = None, min(ready_ns, task.ready_ns)
        # One of those who are behind at a time, so that the others wait for no more than that.
        backlog = self._devices.next_with_backlog()
        if backlog is not None:
            runs.setdefault(backlog, (None, now_ns))
        for device, tick, due_ns in self._devices.deadlines.due(now_ns):
            # What a device that is behind sent was more than can be folded at once: that is no lateness of the loop.
            ready_ns = now_ns if self._devices.backlog(device) else due_ns
            runs[device] = tick, min(ready_ns, runs.get(device, (None, ready_ns))[1])
        self._tasks += [
            RoundTask(RunDevice(device=d, tick=tick, most=_MAX_TICKS_PER_RUN), d, since)
            for d, (tick, since) in runs.items()
        ]
        return min((ready_ns for _, ready_ns in runs.values()), default=None)

    def execute_now(self) -> None:
        """Do what was gathered before the round is over; what was fed is run, for a snapshot may be asked for next."""
        self.schedule_due_runs(self._clock.monotonic_ns())
        self.execute()

    def execute(self) -> None:
        """Have the replica do what was gathered, and tell everybody what came of it."""
        tasks, self._tasks = self._tasks, []
        self._numbers.clear()
        for task, result in zip(tasks, self._replica.apply([task.step for task in tasks]), strict=True):
            if result.progress is not None:
                self._devices.update(task.device, result.progress)
            if isinstance(task.step, RunDevice):
                self._publish_run(task, task.step, result)
            elif isinstance(task.step, FeedEvent) and isinstance(task.step.event, Scan):
                self._scans.add(task.step.number, task.step.event, task.item)
            else:
                self._acknowledge_event(task, result)

    def finish(self, device: str, reason: str) -> None:
        """Settle all that is known of a device, and let go of it."""
        if device not in self._devices:
            return
        self.admit_scans(self._scans.drop(device, f"the device is gone: {reason}"))
        self.execute()
        decision = FinishDevice(device=device, reason=reason)
        (result,) = self._replica.apply([decision])
        self._write_ahead.decision(decision, device, 0)
        self._publisher.publish(result.estimates, None)
        self._publisher.comparison.finish(device)
        self._forget(device)

    def _acknowledge_event(self, task: RoundTask, result: ReplicaStepResult) -> None:
        """An event is in its timeline, or never will be: say so."""
        outcome, why = task.answer
        if task.item is not None:
            self._publish_queue.answer(
                task.item, outcome if result.outcome is None else ReplyOutcome(result.outcome), why
            )
        if result.outcome is not None and task.ready_ns is not None:
            self._devices.observe(task.device, task.ready_ns)

    def _publish_run(self, task: RoundTask, run: RunDevice, result: ReplicaStepResult) -> None:
        """A device was run: note how far it has come, and say what it says."""
        progress = result.progress
        lost = progress is None and task.device in self._devices
        if lost:
            self._forget(task.device)
        self._devices.record_run(task.device, progress)
        if result.must_journal or lost:  # whoever repeats the run must lose the device there, too
            newest_ns = 0 if progress is None or progress.newest_ns is None else progress.newest_ns
            self._write_ahead.decision(run, task.device, newest_ns)
            self._publisher.publish(result.estimates, task.ready_ns)

    def _forget(self, device: str) -> None:
        self._devices.forget(device)
        self._hub.forget(device)


def _needs_no_run(step: ReplicaStep) -> bool:
    """Tell whether a step changes nothing that a run could fold: a scan is located first, and truth is for nobody."""
    return isinstance(step, FeedEvent) and isinstance(step.event, Scan | Truth)


_MAX_BACKLOG_TICKS: Final = 3_000
"""Ticks of a device that wait to be folded, when its further messages are answered ``busy``."""


class EventAdmission:
    """Judges one message after the other.

    Args:
        tasks: of the round, to which is added what was let in.
        comparison: is told the truth.
        log: told, in a sentence, what an operator must know.

    Attributes:
        deferred: messages that were answered ``busy``, since what their device sent before has to be folded first.
        errors: messages that could not be taken in.
    """

    def __init__(
        self,
        replica: Executor,
        devices: DeviceSchedule,
        scans: PendingScans,
        tasks: RoundTasks,
        write_ahead: WriteAheadBuffer,
        publish_queue: PublishQueue,
        hub: Hub,
        *,
        comparison: LiveComparison,
        log: Callable[[str], None],
    ) -> None:
        """Begin with nothing taken in."""
        self._replica = replica
        self._devices = devices
        self._scans = scans
        self._tasks = tasks
        self._write_ahead = write_ahead
        self._publish_queue = publish_queue
        self._hub = hub
        self._comparison = comparison
        self._log = log
        self.deferred = 0
        self.errors = 0

    def take(self, item: InboundMessage) -> None:
        """Take a message in; whatever is wrong with it, it costs nobody else anything."""
        try:
            self._take(item)
        except (JournalError, PortError, EngineError, PluginError):
            raise
        except Exception as error:  # noqa: BLE001 - see above
            self.errors += 1
            self._log(f"a message of {item.event.device!r} could not be taken in: {type(error).__name__}: {error}")
            self._hub.answer(item, ReplyOutcome.MALFORMED, f"{type(error).__name__}: {error}")

    def _take(self, item: InboundMessage) -> None:
        event = item.event
        if isinstance(event, Hello):
            self._publish_queue.answer(item, ReplyOutcome.ACCEPTED)
        elif isinstance(event, Bye):
            self._finish_device(event, item)
        elif event.seq > 0 and self._is_duplicate(event):
            self._publish_queue.answer(item, ReplyOutcome.DUPLICATE)
        elif why := self._deferral_reason(event):
            self._defer(item, why)
        else:
            self._admit(event, item)

    def _admit(self, event: Event, item: InboundMessage) -> None:
        if isinstance(event, Truth):
            self._comparison.truth(event)
        body = encode_event(event)
        self._tasks.feed(FeedEvent(self._write_ahead.event(event, body), event, body), item)

    def _finish_device(self, bye: Bye, item: InboundMessage) -> None:
        self._tasks.execute_now()
        if backlog := self._devices.backlog(bye.device):
            self._defer(item, _backlog_message(backlog))
            return
        self._tasks.finish(bye.device, "bye")
        self._publish_queue.answer(item, ReplyOutcome.ACCEPTED)

    def _defer(self, item: InboundMessage, why: str) -> None:
        self.deferred += 1
        self._hub.answer(item, ReplyOutcome.BUSY, why)

    def _is_duplicate(self, event: Event) -> bool:
        """Tell whether a message with this number came before: it waits, is gathered, or was fed."""
        return self._tasks.is_pending(event) or self._scans.is_in_flight(event) or self._replica.is_duplicate(event)

    def _deferral_reason(self, event: Event) -> str:
        """Say why a device's message has to wait for what it sent before, if so."""
        backlog = self._devices.backlog(event.device)
        if backlog > _MAX_BACKLOG_TICKS:
            return _backlog_message(backlog)
        return self._scans.deferral_reason(event.device) if isinstance(event, Scan) else ""


def _backlog_message(ticks: int) -> str:
    return f"{ticks} ticks of this device wait to be folded"


def handle_command(
    command: InboundItem,
    hub: Hub,
    replica: Executor,
    write_ahead: WriteAheadBuffer,
    names: Sequence[str],
    drain: Callable[[], None],
) -> bool:
    """Do what the control port was told; return whether the engine is to stop.

    Args:
        command: what else came in is refused: nobody is there to take it.
        drain: settles all that is known of every device.
    """
    if not isinstance(command, ControlCommand):
        hub.answer(command, ReplyOutcome.BUSY, "this engine takes nothing in")
        return False
    if command.what == "stop":
        command.reply(*_succeeded("stopping"))
        return True
    if command.what == "drain":
        hub.reject_all_messages("the engine is being drained")
        drain()
        command.reply(*_succeeded("drained: every track is settled; stopping"))
        return True
    name = command.args.get("pipeline")
    if command.what != "primary":
        command.reply(*_rejected(f"what: found {command.what!r}, expected drain, stop or primary"))
    elif name not in names:
        command.reply(*_rejected(f"pipeline: found {name!r}, expected one of {', '.join(names)}"))
    else:
        decision = SelectPrimary(pipeline=str(name))
        write_ahead.decision(decision, "", 0)
        replica.apply([decision])
        command.reply(*_succeeded(f"{name} is published from now on"))
    return False


def _succeeded(what: str) -> tuple[bool, str]:
    return True, what


def _rejected(why: str) -> tuple[bool, str]:
    return False, why


_IDLE_S: Final = 0.25
_MAX_MESSAGES_PER_ROUND: Final = 2_000
_EXPIRY_CHECK_NS: Final = 1_000_000_000


class Engine:
    """Runs until it is told to stop.

    Args:
        replica: begun, or restored.
        scan_locator: locates scans beside the loop, and wakes the hub when one is done.
        names: of the pipelines, in their order.
        after_round: called with the engine after each round, at least four times a second.
        log: told, in a sentence, what an operator must know.
    """

    def __init__(
        self,
        replica: Executor,
        scan_locator: ScanLocator,
        hub: Hub,
        write_ahead: WriteAheadBuffer,
        settings: LiveSettings,
        *,
        site: str,
        names: Sequence[str],
        clock: Clock | None = None,
        after_round: Callable[[Engine], None] = lambda _: None,
        log: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Prepare the loop; :meth:`serve` runs it."""
        self._replica = replica
        self._hub = hub
        self._write_ahead = write_ahead
        self._settings = settings
        self._names = tuple(names)
        self._clock = Clock() if clock is None else clock
        self._after_round = after_round
        self._log = log
        self._overload = OverloadDetector(settings.overload_s)
        self._devices = DeviceSchedule(Deadlines(round(settings.grace_ms * 1e6), round(settings.coast_s * 1e9)))
        self._scans = PendingScans(scan_locator)
        self._publish_queue = publish_queue = PublishQueue(
            hub, write_ahead, ack_on_disk=settings.durability == "ack", log=log
        )
        self._publisher = publisher = EstimatePublisher(
            replica, write_ahead, publish_queue, settings, site=site, names=names, clock=self._clock
        )
        self._tasks = RoundTasks(
            replica, self._devices, self._scans, write_ahead, publisher, publish_queue, hub, self._clock
        )
        self._admission = EventAdmission(
            replica,
            self._devices,
            self._scans,
            self._tasks,
            write_ahead,
            publish_queue,
            hub,
            comparison=publisher.comparison,
            log=log,
        )
        self._stopping = False
        self._expiry_checked_ns = 0
        self._round_ns = 0
        self._rounds = 0
        self._expired = 0
        self._work = DurationHistogram()

    @property
    def overload(self) -> str | None:
        """Why new devices are refused, None when all is well."""
        if self._publish_queue.journal_full:
            return self._publish_queue.journal_full
        return f"more than {self._settings.overload_s:g} s behind" if self._overload.active else None

    def report(self) -> dict[str, Any]:
        """Return what an operator wants to know, as plain values."""
        counters = self._replica.counters()
        return {
            "devices": counters.devices,
            "ticks": self._publisher.ticks,
            "tick_latency_ms": self._publisher.latency.summary(),
            "round_duration_ms": self._work.summary(),
            "measurements": counters.measurements,
            "missing_messages": counters.missing,
            "failures": counters.failures,
            "journal": self._write_ahead.status(),
            "overload": self.overload,
            "comparison": self._publisher.comparison.report(),
            "primary": self._publisher.primary,
            "scans": {"in_flight": self._scans.in_flight, "timed_out": self._scans.timed_out},
            "rounds": self._rounds,
            "deferred": self._admission.deferred,
            "errors": self._admission.errors,
            "suppressed": self._publisher.suppressed,
            "overloads": self._overload.episodes,
            "expired_devices": self._expired,
        }

    def devices(self, most: int) -> tuple[dict[str, Any], ...]:
        """Return how far each device has come, ``most`` of them."""
        return self._devices.rows(most)

    def recover(self) -> None:
        """Take over what the replica was restored with: its devices and the scans that wait to be located."""
        self._devices.recover(self._replica.progress_by_device(), self._clock.monotonic_ns())
        self._scans.recover(self._replica.waiting)

    def serve(self) -> None:
        """Run until told to stop, by :meth:`stop` or over the control port.

        Raises:
            OverrunError: when it falls behind and the overrun policy is ``fail``.
            JournalError: when the journal cannot be written for another reason than a full disk.
        """
        try:
            while not self._stopping:
                self._round(self._collect())
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
        self._publish_queue.flush(self._replica.snapshot, self._clock.monotonic_ns())

    def _collect(self) -> list[InboundItem]:
        """Wait until something is there or due, and until the last round is long enough ago."""
        items = self._hub.take(self._wait_s(), _MAX_MESSAGES_PER_ROUND)
        early_ns = self._round_ns + round(self._settings.round_ms * 1e6) - self._clock.monotonic_ns()
        if early_ns > 0:
            time.sleep(early_ns * 1e-9)
            items += self._hub.take(0.0, _MAX_MESSAGES_PER_ROUND - len(items))
        return items

    def _wait_s(self) -> float:
        if self._devices.has_backlog and not self._publish_queue.journal_full:
            return 0.0
        next_ns = None if self._publish_queue.journal_full else self._devices.deadlines.next_ns()
        if next_ns is None:
            return _IDLE_S
        return min(_IDLE_S, max(0.0, (next_ns - self._clock.monotonic_ns()) * 1e-9))

    def _round(self, items: Sequence[InboundItem]) -> None:
        started_ns = self._round_ns = self._clock.monotonic_ns()
        self._rounds += 1
        for item in items:
            if isinstance(item, ControlCommand):
                if not self._publish_queue.journal_full:
                    self._tasks.execute_now()
                stops = handle_command(item, self._hub, self._replica, self._write_ahead, self._names, self.drain)
                self._stopping = self._stopping or stops
            elif self._publish_queue.journal_full:
                self._hub.answer(item, ReplyOutcome.BUSY, self._publish_queue.journal_full)
            else:
                self._admission.take(item)
        oldest_ns = None
        if not self._publish_queue.journal_full:
            self._tasks.admit_scans(self._scans.decisions())
            oldest_ns = self._tasks.schedule_due_runs(started_ns)
            self._tasks.execute()
            self._expire(started_ns)
        self._publish_queue.flush(self._replica.snapshot, started_ns)
        now_ns = self._clock.monotonic_ns()
        if oldest_ns is not None:
            self._work.add((now_ns - started_ns) * 1e-6)
        self._check_overload(0 if oldest_ns is None else now_ns - oldest_ns, now_ns)
        self._after_round(self)

    def _expire(self, now_ns: int) -> None:
        if now_ns - self._expiry_checked_ns < _EXPIRY_CHECK_NS:
            return
        self._expiry_checked_ns = now_ns
        for device in self._devices.deadlines.idle(now_ns - round(self._settings.expire_s * 1e9)):
            self._expired += 1
            self._tasks.finish(device, "silent")

    def _check_overload(self, lag_ns: int, now_ns: int) -> None:
        if not self._overload.update(lag_ns, now_ns):
            return
        if not self._overload.active:
            self._hub.reject_new_devices(None)
            self._log("the loop keeps up again: new devices are let in")
            return
        n = len(self._devices.deadlines.devices)
        message = f"overload: the loop is {lag_ns * 1e-9:.1f} s behind with {n} devices"
        if self._settings.overrun == "fail":
            raise OverrunError(f"{message}, and overrun = 'fail'")
        self._hub.reject_new_devices(f"the engine is {self.overload}")
        self._log(f"{message}; new devices are refused until it keeps up")
