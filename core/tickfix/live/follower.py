"""The source of an engine that follows another one: the leader's events and decisions, from its follow port.

The engine folds them with pipelines of its own. It may hang or die without the leader noticing, because all that joins
them is a subscription, which drops what a slow follower does not take. Missed records are counted, and the devices
concerned go on as after any loss of messages.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import zmq

from tickfix.api import Scan
from tickfix.client import Keys
from tickfix.client.connection import connect_socket, open_client_socket
from tickfix.live.engine import Engine, Task
from tickfix.live.protocol import ReplicaStepResult
from tickfix.ports import Hub, InboundMessage
from tickfix.ports.inbound_queue import InboundItem
from tickfix.wire import FollowEnvelope, ReplyOutcome, WireError, decode_event
from tickfix.wire.engine_messages import AdmitScan, DropScan, FinishDevice, RunDevice, decode_decision

_LOGGER = logging.getLogger(__name__)

_IDLE_MS: Final = 200
_MAX_RECORDS_PER_ROUND: Final = 2_000


@dataclass(frozen=True, slots=True)
class Leader:
    """The engine to follow: address of its follow port, and keys if it requires them."""

    address: str
    keys: Keys | None = None


FollowFrames = list[bytes]
"""Kind, envelope and body of one record."""


class FollowSource:
    """Records of a leader's journal.

    Args:
        leader: the engine to follow.
        hub: the follower's own ports; its sensors port refuses everything.
    """

    def __init__(self, leader: Leader, hub: Hub) -> None:
        """Connect; a leader that is not there yet is no error."""
        self._address = leader.address
        self._hub = hub
        self._own_numbers: dict[int, tuple[int, str]] = {}
        self._run = ""
        self._seq = 0
        self.counts: Counter[str] = Counter()
        hub.reject_all_messages("this engine follows another one; send to that")
        self._socket = open_client_socket(zmq.SUB, leader.keys, None)
        self._socket.setsockopt(zmq.RCVHWM, 100_000)
        for kind in (b"event", b"decision"):
            self._socket.subscribe(kind)
        connect_socket(self._socket, leader.address)

    def recover(self, engine: Engine) -> None:
        """Do nothing: records that the leader published in the meantime are missed."""

    def receive(self, engine: Engine) -> Sequence[InboundItem | FollowFrames]:
        """Wait for records; commands come first, and no records while the journal is full."""
        ready = self._socket.poll(_IDLE_MS)
        items: list[InboundItem | FollowFrames] = [*self._hub.take(0.0)]
        if ready and not engine.refusal:
            items.extend(self._records())
        return items

    def admit(self, item: InboundMessage | FollowFrames, engine: Engine, now_ns: int) -> None:
        """Take in a record; one that cannot be decoded is counted and logged."""
        if isinstance(item, InboundMessage):
            self.refuse(item, "this engine takes nothing in")
            return
        try:
            kind, envelope, body = item
            head = msgspec.msgpack.decode(envelope, type=FollowEnvelope)
            self._check_sequence(head)
            if kind == b"event":
                self._admit_event(head.number, body, engine, now_ns)
            else:
                self._admit_decision(body, engine, now_ns)
            self.counts["records"] += 1
        except (ValueError, WireError, msgspec.MsgspecError) as error:
            self.counts["malformed"] += 1
            _LOGGER.warning(
                "%s: a record that cannot be used: %s", self._address, error, extra={"code": "record_malformed"}
            )

    def refuse(self, item: InboundMessage | FollowFrames, reason: str) -> None:
        """Answer a message ``busy``; a record of the leader is dropped."""
        if isinstance(item, InboundMessage):
            self._hub.answer(item, ReplyOutcome.BUSY, reason)

    def schedule(self, engine: Engine, now_ns: int) -> int | None:
        """Decide nothing: all decisions are the leader's."""
        del engine, now_ns
        return None

    def on_result(self, task: Task, result: ReplicaStepResult, engine: Engine) -> None:
        """Do nothing: the leader locates scans and schedules devices."""

    def before_finish(self, device: str, reason: str, engine: Engine) -> None:
        """Do nothing: a scan whose decision has not arrived is not fed."""

    def expired(self, engine: Engine, now_ns: int) -> Iterable[str]:
        """Return nothing: the leader decides which devices have expired."""
        del engine, now_ns
        return ()

    def report(self) -> dict[str, Any]:
        """Return the leader's address and run, and counters of records."""
        return {
            "leader_address": self._address,
            "leader_run": self._run,
            "replication": dict(self.counts),
        }

    def close(self) -> None:
        """Disconnect from the leader."""
        self._socket.close()

    def _records(self) -> Iterator[FollowFrames]:
        with suppress(zmq.Again):
            for _ in range(_MAX_RECORDS_PER_ROUND):
                yield self._socket.recv_multipart(zmq.NOBLOCK)

    def _check_sequence(self, head: FollowEnvelope) -> None:
        if head.run != self._run:
            if self._run:
                _LOGGER.info(
                    "%s: the engine restarted as %s", self._address, head.run, extra={"code": "leader_restarted"}
                )
            self._run, self._own_numbers = head.run, {}
        elif head.seq > self._seq + 1:
            self.counts["missed"] += head.seq - self._seq - 1
            _LOGGER.warning(
                "%s: missed %d records", self._address, head.seq - self._seq - 1, extra={"code": "records_missed"}
            )
        self._seq = head.seq

    def _admit_event(self, number: int, body: bytes, engine: Engine, now_ns: int) -> None:
        event = decode_event(body)
        own = engine.feed(event, body, now_ns)
        if isinstance(event, Scan):
            self._own_numbers[number] = own, event.device

    def _admit_decision(self, body: bytes, engine: Engine, now_ns: int) -> None:
        decision = decode_decision(body)
        if isinstance(decision, RunDevice | FinishDevice):
            engine.run(decision, now_ns)
        elif isinstance(decision, AdmitScan | DropScan):
            # A decision names its scan by the number of the scan's record in the leader's journal, which is another
            # number in ours. The scan is unknown if this follower connected after the leader had received it.
            number, device = self._own_numbers.pop(decision.number, (0, ""))
            if not number:
                self.counts["orphaned_decisions"] += 1
                return
            engine.decide_scan(msgspec.structs.replace(decision, number=number), device, 0, now_ns)
