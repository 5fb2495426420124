"""The source of an engine that takes in sensors: admits their messages and decides when devices are run.

Decisions are what the events do not determine: which scan is admitted when it has been located, which device is run up
to which tick, which device has expired. They depend on time, so the journal has each of them.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable, Sequence
from typing import Any, Final

from tickfix.api import Event, PluginError, Scan, Truth
from tickfix.api.errors import PortError
from tickfix.journal import JournalError
from tickfix.live.engine import Engine, Task
from tickfix.live.localization import PendingScans, ScanDecision, ScanLocator
from tickfix.live.protocol import EngineError, FeedEvent, ReplicaStep, ReplicaStepResult
from tickfix.live.serve_options import LiveSettings
from tickfix.ports import Clock, Hub, InboundMessage
from tickfix.ports.inbound_queue import InboundItem
from tickfix.wire import Bye, Hello, ReplyOutcome, encode_event
from tickfix.wire.engine_messages import DropScan, RunDevice

_LOGGER = logging.getLogger(__name__)

_IDLE_S: Final = 0.25
_MAX_MESSAGES_PER_ROUND: Final = 2_000
_EXPIRY_CHECK_NS: Final = 1_000_000_000
_MAX_BACKLOG_TICKS: Final = 3_000
"""Further messages of a device are answered ``busy`` while more of its ticks than this wait to be folded."""

_MAX_TICKS_PER_RUN: Final = 100
"""A run closes at most so many ticks of a device; a longer backlog is folded in several rounds, between other devices'
ticks."""


class SensorSource:
    """Messages from the hub, and the engine's own decisions.

    Args:
        hub: receives messages.
        scan_locator: locates scans beside the loop, and wakes the hub when one is done.
        settings: the table ``[live]``.
        clock: monotonic.

    Attributes:
        deferred: messages answered ``busy`` because data that their device sent before has to be folded first.
        errors: messages that could not be admitted.
    """

    def __init__(
        self,
        hub: Hub,
        scan_locator: ScanLocator,
        settings: LiveSettings,
        *,
        clock: Clock | None = None,
    ) -> None:
        """Begin with nothing received."""
        self._hub = hub
        self._scans = PendingScans(scan_locator)
        self._round_spacing_ns = round(settings.round_ms * 1e6)
        self._expire_ns = round(settings.expire_s * 1e9)
        self._clock = Clock() if clock is None else clock
        self._round_ns = 0
        self._expiry_checked_ns = 0
        self.deferred = 0
        self.errors = 0

    def recover(self, engine: Engine) -> None:
        """Take every device as heard now, and have the scans located that were pending in the journal."""
        now_ns = self._clock.monotonic_ns()
        for device in engine.schedule:
            engine.schedule.observe(device, now_ns)
        self._scans.recover(engine.replica.waiting)

    def receive(self, engine: Engine) -> Sequence[InboundItem]:
        """Wait for messages or the next deadline, and until ``round_ms`` have passed since the last round began."""
        items = self._hub.take(self._wait_s(engine), _MAX_MESSAGES_PER_ROUND)
        # Rounds that began with every message would fold one device each. Waiting a little gathers devices that are due
        # at about the same time, whose filters then step as one batch.
        early_ns = self._round_ns + self._round_spacing_ns - self._clock.monotonic_ns()
        if early_ns > 0:
            time.sleep(early_ns * 1e-9)
            items += self._hub.take(0.0, _MAX_MESSAGES_PER_ROUND - len(items))
        self._round_ns = self._clock.monotonic_ns()
        return items

    def admit(self, item: InboundMessage, engine: Engine, now_ns: int) -> None:
        """Admit a message; an unforeseen error costs this message only, and is answered as ``malformed``."""
        del now_ns
        try:
            self._admit(item, engine)
        except (JournalError, PortError, EngineError, PluginError):
            raise
        except Exception as error:  # noqa: BLE001 - see above
            self.errors += 1
            _LOGGER.error(  # noqa: TRY400 - a sender can cause these at will: one line each
                "a message of %r could not be taken in: %s: %s",
                item.event.device,
                type(error).__name__,
                error,
                extra={"code": "message_failed", "device": item.event.device},
            )
            self._hub.answer(item, ReplyOutcome.MALFORMED, f"{type(error).__name__}: {error}")

    def refuse(self, item: InboundMessage, reason: str) -> None:
        """Answer ``busy``: the sender tries again later."""
        self._hub.answer(item, ReplyOutcome.BUSY, reason)

    def schedule(self, engine: Engine, now_ns: int) -> int | None:
        """Decide about scans that are located by now, and run every device that received data or is due.

        Returns:
            The monotonic time since which the oldest of these runs could be done; None where there are none.
        """
        self._decide_scans(engine, self._scans.decisions())
        # By device: the tick to close up to, None for as far as its data goes, and since when it could be run.
        runs: dict[str, tuple[int | None, int]] = {}
        for task in engine.tasks:
            if task.ready_ns is not None and not _needs_no_run(task.step):
                ready_ns = runs.get(task.device, (None, task.ready_ns))[1]
                runs[task.device] = None, min(ready_ns, task.ready_ns)
        # One device with a backlog per round, so that other devices never wait for more than one partial run.
        backlog = engine.schedule.next_with_backlog()
        if backlog is not None:
            runs.setdefault(backlog, (None, now_ns))
        # A deadline overrides "as far as the data goes": it closes ticks whose data did not arrive in time. If that
        # data arrives later, the ticks are revised.
        for device, tick, due_ns in engine.schedule.deadlines.due(now_ns):
            # A backlog means that the device sent more than can be folded in one run: the loop itself is not late.
            ready_ns = now_ns if engine.schedule.backlog(device) else due_ns
            runs[device] = tick, min(ready_ns, runs.get(device, (None, ready_ns))[1])
        for device, (up_to_tick, since_ns) in runs.items():
            engine.run(RunDevice(device=device, tick=up_to_tick, most=_MAX_TICKS_PER_RUN), since_ns)
        return min((ready_ns for _, ready_ns in runs.values()), default=None)

    def on_result(self, task: Task, result: ReplicaStepResult, engine: Engine) -> None:
        """Have a scan located that was fed; update the device's deadline after anything else that entered its ticks."""
        if isinstance(task.step, FeedEvent) and isinstance(task.step.event, Scan):
            self._scans.add(task.step.number, task.step.event, task.item)
        elif result.outcome is not None and task.ready_ns is not None:
            engine.schedule.observe(task.device, task.ready_ns)

    def before_finish(self, device: str, reason: str, engine: Engine) -> None:
        """Drop the scans of the device that are not located yet."""
        self._decide_scans(engine, self._scans.drop(device, f"the device is gone: {reason}"))

    def expired(self, engine: Engine, now_ns: int) -> Iterable[str]:
        """Return devices that have sent nothing for ``expire_s``; looked for once a second."""
        if now_ns - self._expiry_checked_ns < _EXPIRY_CHECK_NS:
            return ()
        self._expiry_checked_ns = now_ns
        return engine.schedule.deadlines.idle(now_ns - self._expire_ns)

    def report(self) -> dict[str, Any]:
        """Return counters of scans and messages."""
        return {
            "scans": {"in_flight": self._scans.in_flight, "timed_out": self._scans.timed_out},
            "deferred": self.deferred,
            "errors": self.errors,
        }

    def close(self) -> None:
        """Stop locating scans."""
        self._scans.stop()

    def _wait_s(self, engine: Engine) -> float:
        if engine.journal_full:
            return _IDLE_S
        if engine.schedule.has_backlog:
            return 0.0
        next_ns = engine.schedule.deadlines.next_ns()
        if next_ns is None:
            return _IDLE_S
        return min(_IDLE_S, max(0.0, (next_ns - self._clock.monotonic_ns()) * 1e-9))

    def _admit(self, item: InboundMessage, engine: Engine) -> None:
        event = item.event
        if isinstance(event, Hello):
            engine.answer(item, ReplyOutcome.ACCEPTED)
        elif isinstance(event, Bye):
            self._finish(event, item, engine)
        elif event.seq > 0 and (self._scans.is_in_flight(event) or engine.is_duplicate(event)):
            engine.answer(item, ReplyOutcome.DUPLICATE)
        elif reason := self._deferral_reason(event, engine):
            self._defer(item, reason)
        else:
            engine.feed(event, encode_event(event), item.received_ns, item)

    def _finish(self, bye: Bye, item: InboundMessage, engine: Engine) -> None:
        engine.execute_now()
        if backlog := engine.schedule.backlog(bye.device):
            self._defer(item, _backlog_message(backlog))
            return
        engine.finish(bye.device, "bye")
        engine.answer(item, ReplyOutcome.ACCEPTED)

    def _defer(self, item: InboundMessage, reason: str) -> None:
        self.deferred += 1
        self._hub.answer(item, ReplyOutcome.BUSY, reason)

    def _deferral_reason(self, event: Event, engine: Engine) -> str:
        backlog = engine.schedule.backlog(event.device)
        if backlog > _MAX_BACKLOG_TICKS:
            return _backlog_message(backlog)
        return self._scans.deferral_reason(event.device) if isinstance(event, Scan) else ""

    def _decide_scans(self, engine: Engine, decisions: Sequence[ScanDecision]) -> None:
        for found in decisions:
            # After a restart nobody waits for the answer, and the time of arrival is not known any more.
            ready_ns = self._clock.monotonic_ns() if found.item is None else found.item.received_ns
            engine.decide_scan(found.decision, found.scan.device, found.scan.t_ns, ready_ns, found.item)


def _needs_no_run(step: ReplicaStep) -> bool:
    """Tell whether a step leaves nothing to fold: a scan is located first, and truth enters no track."""
    return isinstance(step, DropScan) or (isinstance(step, FeedEvent) and isinstance(step.event, Scan | Truth))


def _backlog_message(ticks: int) -> str:
    return f"{ticks} ticks of this device wait to be folded"
