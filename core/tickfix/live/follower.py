"""A second engine that folds the events and decisions of a first one, with pipelines of its own.

It may hang or die without the first one noticing: all that joins them is a subscription, which drops what a slow
follower does not take. What is missed is counted, and the devices concerned go on as after any loss of messages.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final

import msgspec
import zmq

from tickfix.api import Scan, Truth
from tickfix.client import Keys
from tickfix.client.connection import connect_socket, open_client_socket
from tickfix.live.engine import handle_command
from tickfix.live.engine_status import DurationHistogram
from tickfix.live.protocol import Executor, FeedEvent, ReplicaStep
from tickfix.live.publisher import EstimatePublisher, PublishQueue, WriteAheadBuffer
from tickfix.live.serve_options import LiveSettings
from tickfix.ports import Clock, Hub
from tickfix.wire import FollowEnvelope, WireError, decode_event
from tickfix.wire.engine_messages import AdmitScan, DropScan, FinishDevice, RunDevice, decode_decision

_IDLE_MS: Final = 200
_MAX_RECORDS_PER_ROUND: Final = 2_000


@dataclass(frozen=True, slots=True)
class Leader:
    """The engine to follow: address of its follow port, and keys where it asks for them."""

    address: str
    keys: Keys | None = None


class Follower:
    """Runs until it is told to stop.

    Args:
        leader: the engine to follow.
        replica: begun, or restored.
        hub: its own; nothing comes in by its sensors port.
        names: of the pipelines, in their order.
        after_round: called after each round, at least four times a second.
        log: told, in a sentence, what an operator must know.
    """

    def __init__(
        self,
        leader: Leader,
        replica: Executor,
        hub: Hub,
        write_ahead: WriteAheadBuffer,
        settings: LiveSettings,
        *,
        site: str,
        names: Sequence[str],
        clock: Clock | None = None,
        after_round: Callable[[Follower], None] = lambda _: None,
        log: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Connect; that nobody is there yet is no error."""
        self._address = leader.address
        self._replica = replica
        self._hub = hub
        self._write_ahead = write_ahead
        self._names = tuple(names)
        self._clock = Clock() if clock is None else clock
        self._after_round = after_round
        self._log = log
        self._publish_queue = PublishQueue(hub, write_ahead, ack_on_disk=False, log=log)
        self._publisher = EstimatePublisher(
            replica, write_ahead, self._publish_queue, settings, site=site, names=names, clock=self._clock
        )
        self._own_numbers: dict[int, tuple[int, str]] = {}
        self._steps: list[tuple[ReplicaStep, str]] = []
        self._run = ""
        self._seq = 0
        self._stopping = False
        self.counts: Counter[str] = Counter()
        self.work = DurationHistogram()
        hub.reject_all_messages("this engine follows another one; send to that")
        self._socket = open_client_socket(zmq.SUB, leader.keys, None)
        self._socket.setsockopt(zmq.RCVHWM, 100_000)
        for kind in (b"event", b"decision"):
            self._socket.subscribe(kind)
        connect_socket(self._socket, leader.address)

    def serve(self) -> None:
        """Run until told to stop, by :meth:`stop` or over the control port."""
        try:
            while not self._stopping:
                self._round()
        finally:
            self._socket.close()

    def stop(self) -> None:
        """Stop after this round; from any thread."""
        self._stopping = True

    def recover(self) -> None:
        """Take over what the replica was restored with; what came meanwhile was missed."""

    def report(self) -> dict[str, Any]:
        """Return what an operator wants to know, as plain values."""
        counters = self._replica.counters()
        return {
            "leader_address": self._address,
            "leader_run": self._run,
            "devices": counters.devices,
            "ticks": self._publisher.ticks,
            "tick_latency_ms": self._publisher.latency.summary(),
            "round_duration_ms": self.work.summary(),
            "measurements": counters.measurements,
            "failures": counters.failures,
            "journal": self._write_ahead.status(),
            "overload": self._publish_queue.journal_full or None,
            "primary": self._publisher.primary,
            "comparison": self._publisher.comparison.report(),
            "replication": dict(self.counts),
        }

    def devices(self, most: int) -> tuple[dict[str, Any], ...]:
        """Return how far each device has come, ``most`` of them."""
        return tuple(
            {"device": device, "epoch": s.epoch, "newest_ns": s.newest_ns, "next_tick": s.next_tick}
            for device, s in islice(self._replica.progress_by_device().items(), most)
        )

    def _round(self) -> None:
        ready = self._socket.poll(_IDLE_MS)
        started_ns = self._clock.monotonic_ns()
        for item in self._hub.take(0.0):
            stops = handle_command(item, self._hub, self._replica, self._write_ahead, self._names, self._drain)
            self._stopping = self._stopping or stops
        taken = 0
        with suppress(zmq.Again):
            while (
                ready and taken < _MAX_RECORDS_PER_ROUND and not self._publish_queue.journal_full and not self._stopping
            ):
                self._receive(self._socket.recv_multipart(zmq.NOBLOCK), started_ns)
                taken += 1
        self._apply_steps(started_ns)
        self._publish_queue.flush(self._replica.snapshot, started_ns)
        if taken:
            self.work.add((self._clock.monotonic_ns() - started_ns) * 1e-6)
        self._after_round(self)

    def _receive(self, frames: list[bytes], now_ns: int) -> None:
        try:
            kind, envelope, body = frames
            head = msgspec.msgpack.decode(envelope, type=FollowEnvelope)
            self._check_sequence(head)
            if kind == b"event":
                self._event(head.number, body, now_ns)
            else:
                self._decide(body, now_ns)
            self.counts["records"] += 1
        except (ValueError, WireError, msgspec.MsgspecError) as error:
            self.counts["malformed"] += 1
            self._log(f"{self._address}: a record that cannot be used: {error}")

    def _check_sequence(self, head: FollowEnvelope) -> None:
        if head.run != self._run:
            if self._run:
                self._log(f"{self._address}: the engine restarted as {head.run}")
            self._run, self._own_numbers = head.run, {}
        elif head.seq > self._seq + 1:
            self.counts["missed"] += head.seq - self._seq - 1
            self._log(f"{self._address}: missed {head.seq - self._seq - 1} records")
        self._seq = head.seq

    def _event(self, number: int, body: bytes, now_ns: int) -> None:
        event = decode_event(body)
        self._apply_pending_runs(now_ns)
        own = self._write_ahead.event(event, body)
        if isinstance(event, Truth):
            self._publisher.comparison.truth(event)
        elif isinstance(event, Scan):
            self._own_numbers[number] = own, event.device
        self._steps.append((FeedEvent(own, event, body), event.device))

    def _decide(self, body: bytes, now_ns: int) -> None:
        """Do what the first engine decided; its numbers of records are not ours."""
        decision = decode_decision(body)
        if isinstance(decision, RunDevice | FinishDevice):
            self._steps.append((decision, decision.device))
        elif isinstance(decision, AdmitScan | DropScan):
            number, device = self._own_numbers.pop(decision.number, (0, ""))
            if not number:
                self.counts["orphaned_decisions"] += 1
                return
            self._apply_pending_runs(now_ns)
            decision = msgspec.structs.replace(decision, number=number)
            self._write_ahead.decision(decision, device, 0)
            self._steps.append((decision, device))

    def _apply_pending_runs(self, now_ns: int) -> None:
        """Do what says something first: what it says stands in the journal before what comes after it."""
        if self._steps and isinstance(self._steps[-1][0], RunDevice | FinishDevice):
            self._apply_steps(now_ns)

    def _apply_steps(self, now_ns: int) -> None:
        steps, self._steps = self._steps, []
        for (step, device), result in zip(steps, self._replica.apply([step for step, _ in steps]), strict=True):
            if isinstance(step, RunDevice | FinishDevice):
                self._write_ahead.decision(step, device, 0)
                self._publisher.publish(result.estimates, now_ns)
            if isinstance(step, FinishDevice):
                self._publisher.comparison.finish(device)
            if isinstance(step, RunDevice | FinishDevice) and result.progress is None:
                self._hub.forget(device)

    def _drain(self) -> None:
        """Settle all that was followed; what the first engine goes on to say is not for this one any more."""
        now_ns = self._clock.monotonic_ns()
        self._apply_steps(now_ns)
        self._steps = [
            (FinishDevice(device=each, reason="drained"), each) for each in self._replica.progress_by_device()
        ]
        self._apply_steps(now_ns)
