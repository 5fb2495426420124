"""The sensors port: decodes and admits each inbound message, queues it for the engine, or replies with the error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import zmq

from tickfix.api import Event, Source
from tickfix.ports.inbound_queue import InboundMessage, InboundQueue, IntakeCounters, RouterMessage, receive_message
from tickfix.ports.peers import AdmissionRefusal, DeviceSessions, Peer, PeerRegistry
from tickfix.ports.port_settings import Clock, PortSettings
from tickfix.wire import (
    VERSION,
    Bye,
    DeviceMessage,
    Hello,
    ReplyOutcome,
    WireError,
    check_received_event,
    decode_message,
    message_to_event,
    unknown_fields,
)
from tickfix.wire.engine_messages import AckReply, ErrorReply, WelcomeReply, encode_engine_message, error_reply
from tickfix.wire.sensor_messages import FixMessage, TruthMessage

_SEND_LAST: Final = int(zmq.NOBLOCK)
_SEND_MORE: Final = int(zmq.NOBLOCK | zmq.SNDMORE)
_MESSAGES_PER_ROUND: Final = 64
_DROPS_BEFORE_PAUSE: Final = 32
_PAUSE_NS: Final = 2_000_000
_THROTTLE_NOTICE_INTERVAL_NS: Final = 1_000_000_000
_ACK_OUTCOMES: Final = frozenset({ReplyOutcome.ACCEPTED, ReplyOutcome.LATE, ReplyOutcome.STALE, ReplyOutcome.DUPLICATE})
"""Outcomes that an ``ack`` carries, if one was requested; the others are always reported by an ``error``."""


@dataclass(slots=True)
class AdmissionPolicy:
    """Whether the loop accepts new work: None accepts it, a reason answers it with ``busy``."""

    new_devices: str | None = None
    all_messages: str | None = None


class SensorsPort:
    """Reads the socket a few messages at a time, fairly between connections (libzmq takes them in turn).

    Messages of a peer over its limits are dropped before decoding. Drops also slow the reading down, a little for each,
    so that a flood backs up in its sender's own connection rather than eat the processor; the other connections' turns
    come all the same.

    Attributes:
        replies_lost: answers that could not be delivered, because the peer left or does not read.
        paused_until_ns: the socket is not read before this instant of the monotonic clock.
    """

    def __init__(
        self,
        socket: zmq.Socket[bytes],
        settings: PortSettings,
        *,
        run: str,
        site: str,
        peers: PeerRegistry,
        intake: IntakeCounters,
        inbound_queue: InboundQueue,
        clock: Clock,
        sources: Mapping[str, Source],
    ) -> None:
        """Serve ``socket``, a bound ROUTER."""
        self._sources = sources
        self._socket = socket
        self._settings = settings
        self._peers = peers
        self._intake = intake
        self._inbound_queue = inbound_queue
        self._clock = clock
        limits = {name: getattr(settings.message, name) for name in settings.message.__slots__}
        self._welcome = encode_engine_message(WelcomeReply(v=VERSION, run=run, site=site, limits=limits))
        self.device_sessions = DeviceSessions(
            settings.devices, int(settings.takeover_s * 1e9), int(settings.idle_s * 1e9)
        )
        self.admission = AdmissionPolicy()
        self.replies_lost = 0
        self.paused_until_ns = 0

    def serve(self) -> bool:
        """Judge what is there, at most a round of it; return whether there may be more to judge now."""
        drops = 0
        for _ in range(_MESSAGES_PER_ROUND):
            received = receive_message(self._socket)
            if received is None:
                return False
            drops += self._receive(received) is ReplyOutcome.THROTTLED
            if drops >= _DROPS_BEFORE_PAUSE:
                self.paused_until_ns = self._clock.monotonic_ns() + _PAUSE_NS
                return False
        return True

    def send(self, peer: Peer, body: bytes) -> None:
        """Send an answer; a peer that left, or does not read, goes without."""
        *identity, last = peer.envelope(body)
        try:
            for frame in identity:
                self._socket.send(frame, _SEND_MORE)
            self._socket.send(last, _SEND_LAST)
        except zmq.ZMQError:
            self.replies_lost += 1

    def replies_for(self, incoming: InboundMessage, outcome: ReplyOutcome, detail: str) -> tuple[bytes, ...]:
        """Return what is sent to the peer once the loop has settled a message; pure, for any thread."""
        message = incoming.event
        if outcome not in _ACK_OUTCOMES:
            return (
                encode_engine_message(
                    ErrorReply(
                        v=VERSION,
                        outcome=outcome,
                        field="message",
                        found=detail or "a message that cannot be used",
                        expected="see docs/wire-protocol.md",
                        device=message.device,
                        session=message.session,
                        seq=message.seq,
                    )
                ),
            )
        replies: list[bytes] = []
        if isinstance(message, Hello):
            replies.append(self._welcome)
        # REQ takes one answer, no less and no more.
        if (incoming.wants_ack and not (replies and incoming.peer.delimited)) or (
            incoming.peer.delimited and not replies
        ):
            replies.append(
                encode_engine_message(
                    AckReply(
                        v=VERSION,
                        device=message.device,
                        session=message.session,
                        seq=message.seq,
                        outcome=outcome,
                        detail=detail,
                    )
                )
            )
        return tuple(replies)

    def _receive(self, received: RouterMessage) -> ReplyOutcome | None:
        """Count the message, and settle it unless it is handed to the loop."""
        now_ns = self._clock.monotonic_ns()
        peer = self._peers.identify(received.identity, delimited=received.delimited, now_ns=now_ns)
        self._intake.receive(peer.state, received.n_bytes)
        body = received.body or b""
        try:
            error = self._admit_message(peer, received, now_ns)
        except WireError as problem:
            error = error_reply(problem, body)
        except Exception as problem:  # noqa: BLE001 - whatever a stranger sends, the port goes on and its books balance
            error = error_reply(WireError("message", type(problem).__name__, "a message that can be understood"), body)
        if error is None:
            return None
        self._intake.count_outcome(peer.state, error.outcome)
        if error.outcome is not ReplyOutcome.THROTTLED or peer.delimited or self._throttle_notice_due(peer, now_ns):
            self.send(peer, encode_engine_message(error))
        return error.outcome

    def _admit_message(self, peer: Peer, received: RouterMessage, now_ns: int) -> ErrorReply | None:
        """Hand the message to the loop, or return the error that explains why not."""
        if not peer.allowed:
            found = f"the key of {peer.name!r}, withdrawn"
            return _undecoded_error(ReplyOutcome.UNAUTHORISED, "key", found, "a key on the allow-list")
        limits = peer.state.limits
        if not peer.state.bucket.try_consume(received.n_bytes, now_ns):
            expected = f"at most {limits.messages_per_s:g} messages/s and {limits.bytes_per_s:g} bytes/s"
            return _undecoded_error(ReplyOutcome.THROTTLED, "message", "too many messages or bytes", expected)
        if received.body is None:
            raise WireError("message", f"{received.frames} frames", "one frame, or an empty one and one")
        body = received.body
        message = decode_message(body, self._settings.message)
        refusal = self._check_permission(peer, message)
        if refusal is None:
            event: Event | Hello | Bye
            if isinstance(message, Hello | Bye):
                event = message
            else:
                event = message_to_event(message, self._clock.wall_ns())
                check_received_event(event, self._sources)
            refusal = self._claim_device(peer, message, now_ns)
        if refusal is None:
            incoming = InboundMessage(event, peer, message.ack, now_ns, len(body))
            if self._inbound_queue.try_put(incoming):
                self._count_unknown(body)
                return None
            refusal = AdmissionRefusal(
                ReplyOutcome.BUSY, "message", "more than the engine can take in now", "the same message later"
            )
        return error_reply(WireError(refusal.field, refusal.found, refusal.expected, refusal.outcome), body)

    def _check_permission(self, peer: Peer, message: DeviceMessage) -> AdmissionRefusal | None:
        """Return why this message is rejected whatever it contains."""
        grant = peer.state.grant
        if grant is not None and not grant.allows_device(message.device):
            expected = f"one of {', '.join(grant.devices) or 'none'}, bound to the key of {grant.name!r}"
            return AdmissionRefusal(ReplyOutcome.UNAUTHORISED, "device", repr(message.device), expected)
        if self.admission.all_messages is not None:
            return AdmissionRefusal(ReplyOutcome.BUSY, "message", self.admission.all_messages, "the same message later")
        if self.admission.new_devices is not None and message.device not in self.device_sessions:
            return AdmissionRefusal(
                ReplyOutcome.BUSY, "device", f"a new device: {self.admission.new_devices}", "the same message later"
            )
        return None

    def _claim_device(self, peer: Peer, message: DeviceMessage, now_ns: int) -> AdmissionRefusal | None:
        return self.device_sessions.admit(
            message.device,
            message.session,
            peer.name,
            limit=peer.state.limits.devices,
            now_ns=now_ns,
            hello=isinstance(message, Hello),
            sensor=not isinstance(message, FixMessage | TruthMessage),
        )

    def _count_unknown(self, body: bytes) -> None:
        if unknown := unknown_fields(body):
            self._intake.count_unknown("fields", len(unknown))

    def _throttle_notice_due(self, peer: Peer, now_ns: int) -> bool:
        """Whether the last notice of throttling to the peer is over a second old."""
        due = now_ns - peer.state.throttle_notice_ns >= _THROTTLE_NOTICE_INTERVAL_NS
        if due:
            peer.state.throttle_notice_ns = now_ns
        return due


def _undecoded_error(outcome: ReplyOutcome, field: str, found: str, expected: str) -> ErrorReply:
    """Return an error about a message that was not decoded."""
    return ErrorReply(v=VERSION, outcome=outcome, field=field, found=found, expected=expected)
