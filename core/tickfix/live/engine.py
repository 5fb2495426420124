"""The live engine: one round, from top to bottom.

    admit    what the source received becomes steps, numbered and written to the journal's buffer
    feed     the steps are applied to the replica: events enter timelines
    run      devices that received data, have a backlog or reached a deadline are folded
    journal  decisions and estimates are written to the buffer; the round is committed
    publish  estimates and acknowledgements go out

Where steps come from is a matter of the :class:`EventSource`: sensors and the engine's own schedule
(:mod:`tickfix.live.sensor_source`), or the follow port of another engine (:mod:`tickfix.live.follower`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from prometheus_client import CollectorRegistry

from tickfix.api import Event, Truth
from tickfix.live.engine_status import LOOP_QUERIES, EngineStatus
from tickfix.live.metrics import DurationHistogram, EngineCollector
from tickfix.live.protocol import Executor, FeedEvent, OverrunError, ReplicaStep, ReplicaStepResult
from tickfix.live.publisher import EstimatePublisher, PublishQueue, WriteAheadBuffer
from tickfix.live.scheduler import Deadlines, DeviceSchedule, OverloadDetector
from tickfix.live.serve_options import LiveSettings
from tickfix.ports import Clock, ControlCommand, Hub, InboundMessage
from tickfix.wire import ReplyOutcome
from tickfix.wire.engine_messages import AdmitScan, DropScan, FinishDevice, RunDevice, SelectPrimary

_LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Task:
    """A step of the replica, and who waits for its result.

    Attributes:
        step: what the replica is to do.
        device: the device concerned.
        ready_ns: monotonic time from which on it could be done; None where nobody waited for it.
        item: the message that caused it, acknowledged with the outcome of the step.
        detail: explains the acknowledgement of a step without an outcome of its own.
    """

    step: ReplicaStep
    device: str
    ready_ns: int | None
    item: InboundMessage | None = None
    detail: str = ""


class EventSource(Protocol):
    """Where an engine's events and decisions come from.

    A source decides; the engine journals, applies and publishes. In each round the engine calls :meth:`receive`,
    :meth:`admit` for each item, :meth:`schedule` and :meth:`expired`, in this order.
    """

    def recover(self, engine: Engine) -> None:
        """Continue with the devices and pending scans that the engine's replica was restored with."""

    def receive(self, engine: Engine) -> Sequence[Any]:
        """Wait until something arrived or is due, a quarter of a second at most; return what arrived.

        Items are :class:`ControlCommand`, which the engine handles itself, or whatever :meth:`admit` takes.
        """

    def admit(self, item: Any, engine: Engine, now_ns: int) -> None:
        """Turn one item into steps of the engine, or answer it."""

    def refuse(self, item: Any, reason: str) -> None:
        """Answer an item that cannot be admitted now."""

    def schedule(self, engine: Engine, now_ns: int) -> int | None:
        """Add decisions that are due; return the monotonic time since which the oldest could be done, if any."""

    def on_result(self, task: Task, result: ReplicaStepResult, engine: Engine) -> None:
        """Take note of the result of a step; called in the order of the steps."""

    def before_finish(self, device: str, reason: str, engine: Engine) -> None:
        """Decide about everything of a device that is still pending, because the device will be finished."""

    def expired(self, engine: Engine, now_ns: int) -> Iterable[str]:
        """Return devices to be finished because they have been silent for too long."""

    def report(self) -> dict[str, Any]:
        """Return the source's part of the engine's report, as plain values."""

    def close(self) -> None:
        """Release threads and sockets."""


class Engine:
    """Runs rounds until it is stopped.

    Args:
        source: where events and decisions come from.
        replica: executes the steps; new, or restored.
        hub: the engine's ports.
        write_ahead: the journal's buffer.
        settings: the table ``[live]``.
        site: its name.
        names: of the pipelines, in their order.
        clock: monotonic.
        status: answers queries; learns after each round, at least four times a second, that the loop is alive.
        beat: called after each round, as a sign of life.
        on_overrun: called with ``active``, ``lag_s`` and ``devices`` when the loop falls behind, and when it keeps up
            again.

    Attributes:
        schedule: the devices, their progress, deadlines and backlogs.
        metrics: counters and durations for Prometheus; to be collected on the thread that runs :meth:`serve`.
    """

    def __init__(
        self,
        source: EventSource,
        replica: Executor,
        hub: Hub,
        write_ahead: WriteAheadBuffer,
        settings: LiveSettings,
        *,
        site: str,
        names: Sequence[str],
        clock: Clock | None = None,
        status: EngineStatus | None = None,
        beat: Callable[[], None] = lambda: None,
        on_overrun: Callable[..., None] = lambda **_: None,
    ) -> None:
        """Prepare the loop; :meth:`serve` runs it."""
        self._source = source
        self._replica = replica
        self._hub = hub
        self._write_ahead = write_ahead
        self._settings = settings
        self._names = tuple(names)
        self._clock = Clock() if clock is None else clock
        self._status = EngineStatus({}, clock) if status is None else status
        self._beat = beat
        self._on_overrun = on_overrun
        self._overload = OverloadDetector(settings.overload_s)
        self.schedule = DeviceSchedule(Deadlines(round(settings.grace_ms * 1e6), round(settings.coast_s * 1e9)))
        self._publish_queue = PublishQueue(hub, write_ahead, ack_on_disk=settings.durability == "ack")
        self._publisher = EstimatePublisher(
            replica, write_ahead, self._publish_queue, settings, site=site, names=names, clock=self._clock
        )
        self._tasks: list[Task] = []
        self._pending_numbers: set[tuple[str, str, int]] = set()
        self._stopping = False
        self._drained = ""
        self._rounds = 0
        self._expired = 0
        self._round_duration = DurationHistogram()
        self.metrics = CollectorRegistry()
        self.metrics.register(
            EngineCollector(
                self.report, {"tick_latency": self._publisher.latency, "round_duration": self._round_duration}
            )
        )

    def serve(self) -> None:
        """Run until stopped by :meth:`stop` or over the control port.

        Raises:
            OverrunError: when the loop falls behind and the overrun policy is ``fail``.
            JournalError: when the journal cannot be written for another reason than a full disk.
        """
        try:
            while not self._stopping:
                self._round(self._source.receive(self))
        finally:
            self._source.close()

    def _round(self, items: Sequence[Any]) -> None:
        started_ns = self._clock.monotonic_ns()
        self._rounds += 1

        # Admit. Events get their numbers and enter the journal's buffer in the order of arrival, which is thereby the
        # order in which any replay applies them.
        for item in items:
            if isinstance(item, ControlCommand):
                self._handle_command(item)
            elif reason := self.refusal:
                self._source.refuse(item, reason)
            else:
                self._source.admit(item, self, started_ns)

        # Feed and run. Deadlines are judged by the time at which the round started, not by the present time: whatever
        # arrived before it has been admitted above, so no tick closes without data that was already here. While the
        # journal is full nothing may change, since a restart could not reproduce it.
        oldest_ns, worked = None, False
        if not self.journal_full:
            oldest_ns = self._source.schedule(self, started_ns)
            worked = bool(self._tasks)
            self.execute()
            for device in self._source.expired(self, started_ns):
                self._expired += 1
                self.finish(device, "silent")

        # Journal, then publish. One commit for the whole round. It precedes every publication and acknowledgement of
        # the round: a listener must not receive an estimate, nor a sender drop a message, that a crash in the next
        # instant would lose. When the disk is full the commit is retried, and everything that waits for it waits too.
        self._publish_queue.flush(self._replica.snapshot, started_ns)

        now_ns = self._clock.monotonic_ns()
        if worked:
            self._round_duration.add((now_ns - started_ns) * 1e-6)
        self._check_overload(0 if oldest_ns is None else now_ns - oldest_ns, now_ns)
        self._status.round_ended(self)
        self._beat()

    def feed(self, event: Event, body: bytes, ready_ns: int | None, item: InboundMessage | None = None) -> int:
        """Journal an event, whose canonical bytes are ``body``, have it fed, and return its number."""
        self._execute_pending_runs()
        if isinstance(event, Truth):
            self._publisher.comparison.truth(event)
        number = self._write_ahead.event(event, body)
        self._pending_numbers.add((event.device, event.session, event.seq))
        self._tasks.append(Task(FeedEvent(number, event, body), event.device, ready_ns, item))
        return number

    def decide_scan(
        self,
        decision: AdmitScan | DropScan,
        device: str,
        t_ns: int,
        ready_ns: int | None,
        item: InboundMessage | None = None,
    ) -> None:
        """Journal the decision about a scan that waits, and have it carried out."""
        self._execute_pending_runs()
        self._write_ahead.decision(decision, device, t_ns)
        detail = decision.reason if isinstance(decision, DropScan) else ""
        self._tasks.append(Task(decision, device, ready_ns, item, detail))

    def run(self, decision: RunDevice | FinishDevice, ready_ns: int | None) -> None:
        """Have a device run, or settled; this is journaled with its results, once they are known."""
        self._tasks.append(Task(decision, decision.device, ready_ns))

    def finish(self, device: str, reason: str) -> None:
        """Settle everything known of a device and forget it."""
        if device not in self.schedule:
            return
        self._source.before_finish(device, reason, self)
        self.execute()
        self.run(FinishDevice(device=device, reason=reason), None)
        self.execute()

    def execute(self) -> None:
        """Apply the steps gathered so far; journal their results and queue what is to be published."""
        tasks, self._tasks = self._tasks, []
        self._pending_numbers.clear()
        for task, result in zip(tasks, self._replica.apply([task.step for task in tasks]), strict=True):
            if result.progress is not None:
                self.schedule.update(task.device, result.progress)
            if isinstance(task.step, RunDevice):
                self._publish_run(task, task.step, result)
            elif isinstance(task.step, FinishDevice):
                self._publish_finish(task, task.step, result)
            elif task.item is not None and not (isinstance(task.step, FeedEvent) and result.outcome is None):
                # A scan that was fed has no outcome yet: it is acknowledged when the decision about it is carried out.
                outcome = ReplyOutcome.ACCEPTED if result.outcome is None else ReplyOutcome(result.outcome)
                self._publish_queue.answer(task.item, outcome, task.detail)
            self._source.on_result(task, result, self)

    def execute_now(self) -> None:
        """Apply what was gathered and run the devices concerned, before the round is over.

        A command may take a snapshot, and a snapshot is possible only when every device was run since it was fed.
        """
        self._source.schedule(self, self._clock.monotonic_ns())
        self.execute()

    @property
    def tasks(self) -> Sequence[Task]:
        """The steps gathered and not yet applied."""
        return self._tasks

    def is_duplicate(self, event: Event) -> bool:
        """Tell whether a message with this number is gathered in this round, or was fed before."""
        number = (event.device, event.session, event.seq)
        return number in self._pending_numbers or self._replica.is_duplicate(event)

    def answer(self, item: InboundMessage, outcome: ReplyOutcome) -> None:
        """Acknowledge a message after the next commit."""
        self._publish_queue.answer(item, outcome)

    def recover(self) -> None:
        """Continue with what the replica was restored with: its devices, and the scans that wait to be located."""
        for device, progress in self._replica.progress_by_device().items():
            self.schedule.update(device, progress)
        self._source.recover(self)

    def stop(self) -> None:
        """Stop after this round; from any thread."""
        self._stopping = True
        self._hub.wake()

    def drain(self) -> None:
        """Settle everything known of every device."""
        self.execute()
        for device in self.schedule:
            self.finish(device, "drained")
        self._publish_queue.flush(self._replica.snapshot, self._clock.monotonic_ns())

    @property
    def replica(self) -> Executor:
        """The executor of the steps."""
        return self._replica

    @property
    def journal_full(self) -> str:
        """Why the journal cannot grow; empty when it can."""
        return self._publish_queue.journal_full

    @property
    def refusal(self) -> str:
        """Why nothing is admitted now; empty when all is well."""
        return self.journal_full or self._drained

    @property
    def overload(self) -> str | None:
        """Why new devices are refused, None when all is well."""
        if self.journal_full:
            return self.journal_full
        return f"more than {self._settings.overload_s:g} s behind" if self._overload.active else None

    @property
    def primary(self) -> str:
        """The pipeline that is published."""
        return self._publisher.primary

    def report(self) -> dict[str, Any]:
        """Return counters and durations as plain values."""
        counters = self._replica.counters()
        return {
            "devices": counters.devices,
            "ticks": self._publisher.ticks,
            "tick_latency_ms": self._publisher.latency.summary(),
            "round_duration_ms": self._round_duration.summary(),
            "measurements": counters.measurements,
            "missing_messages": counters.missing,
            "failures": counters.failures,
            "journal": self._write_ahead.status(),
            "overload": self.overload,
            "comparison": self._publisher.comparison.report(),
            "primary": self.primary,
            "rounds": self._rounds,
            "suppressed": self._publisher.suppressed,
            "overloads": self._overload.episodes,
            "expired_devices": self._expired,
            **self._source.report(),
        }

    def devices(self, most: int) -> tuple[dict[str, Any], ...]:
        """Return how far each device has come, at most ``most`` of them."""
        return self.schedule.rows(most)

    def _execute_pending_runs(self) -> None:
        """Apply runs that were gathered, before anything else enters the journal.

        A run is journaled with its estimates when it is applied, an event when it is admitted. If an event were
        admitted while a run waits, the journal would have them in the wrong order. That happens only where both come
        from another engine's journal: an engine's own runs are gathered after all events of the round.
        """
        if self._tasks and isinstance(self._tasks[-1].step, RunDevice | FinishDevice):
            self.execute()

    def _publish_run(self, task: Task, run: RunDevice, result: ReplicaStepResult) -> None:
        progress = result.progress
        quarantined = progress is None and task.device in self.schedule
        if quarantined:
            self._forget(task.device)
        self.schedule.record_run(task.device, progress)
        # A run without estimates that settled nothing changes nothing that another run would not: it is not journaled,
        # unless the device was quarantined in it, because a replay must lose the device at the same place.
        if result.must_journal or quarantined:
            newest_ns = 0 if progress is None or progress.newest_ns is None else progress.newest_ns
            self._write_ahead.decision(run, task.device, newest_ns)
            self._publisher.publish(result.estimates, task.ready_ns)

    def _publish_finish(self, task: Task, finish: FinishDevice, result: ReplicaStepResult) -> None:
        self._write_ahead.decision(finish, task.device, 0)
        self._publisher.publish(result.estimates, task.ready_ns)
        self._publisher.comparison.finish(task.device)
        self._forget(task.device)

    def _forget(self, device: str) -> None:
        self.schedule.forget(device)
        self._hub.forget(device)

    def _handle_command(self, command: ControlCommand) -> None:
        if command.what in LOOP_QUERIES:
            command.reply(*_succeeded(self._status.answer(command.what, self)))
            return
        if not self.journal_full:
            self.execute_now()
        if command.what == "stop":
            self._stopping = True
            command.reply(*_succeeded("stopping"))
        elif command.what == "drain":
            self._drained = "the engine is being drained"
            self._hub.reject_all_messages(self._drained)
            self.drain()
            self._stopping = True
            command.reply(*_succeeded("drained: every track is settled; stopping"))
        elif command.what != "primary":
            command.reply(*_rejected(f"what: found {command.what!r}, expected drain, stop or primary"))
        elif (name := command.args.get("pipeline")) not in self._names:
            command.reply(*_rejected(f"pipeline: found {name!r}, expected one of {', '.join(self._names)}"))
        else:
            decision = SelectPrimary(pipeline=str(name))
            self._write_ahead.decision(decision, "", 0)
            self._replica.apply([decision])
            command.reply(*_succeeded(f"{name} is published from now on"))

    def _check_overload(self, lag_ns: int, now_ns: int) -> None:
        if not self._overload.update(lag_ns, now_ns):
            return
        n = len(self.schedule.deadlines.devices)
        self._on_overrun(active=self._overload.active, lag_s=lag_ns * 1e-9, devices=n)
        if not self._overload.active:
            self._hub.reject_new_devices(None)
            _LOGGER.info("the loop keeps up again: new devices are let in", extra={"code": "overload_ended"})
            return
        message = f"overload: the loop is {lag_ns * 1e-9:.1f} s behind with {n} devices"
        if self._settings.overrun == "fail":
            raise OverrunError(f"{message}, and overrun = 'fail'")
        self._hub.reject_new_devices(f"the engine is {self.overload}")
        _LOGGER.warning("%s; new devices are refused until it keeps up", message, extra={"code": "overload"})


def _succeeded(data: Any) -> tuple[bool, Any]:
    return True, data


def _rejected(reason: str) -> tuple[bool, str]:
    return False, reason
