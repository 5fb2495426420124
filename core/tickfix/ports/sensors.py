"""The sensors port: judges every message once, hands on what is let in, and tells the others why not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import zmq

from tickfix.api import Event
from tickfix.kernel import Outcome
from tickfix.ports.clock import Clock
from tickfix.ports.devices import Refusal, Speakers
from tickfix.ports.envelopes import Letter, receive
from tickfix.ports.intake import Inbox, Incoming, Intake
from tickfix.ports.peers import Peer, Peers
from tickfix.ports.settings import PortSettings
from tickfix.wire import (
    VERSION,
    Bye,
    Hello,
    Message,
    WireError,
    check_sent,
    decode_message,
    to_event,
    unknown_fields,
    unknown_sensors,
)
from tickfix.wire.messages import Fix, Motion, Truth
from tickfix.wire.replies import Ack, Error, Welcome, encode, error_for

_LAST: Final = int(zmq.NOBLOCK)
_MORE: Final = int(zmq.NOBLOCK | zmq.SNDMORE)
_ROUND: Final = 64
_DROPS: Final = 32
_PAUSE_NS: Final = 2_000_000
_TELL_NS: Final = 1_000_000_000
_USED: Final = frozenset({Outcome.ACCEPTED, Outcome.LATE, Outcome.STALE, Outcome.DUPLICATE})
"""Outcomes that an ``ack`` carries, where one was asked for; the others are told by an ``error``, asked for or not."""


@dataclass(slots=True)
class Doors:
    """What the loop says about new work: None lets it in, a reason answers it with ``busy``."""

    new_devices: str | None = None
    everything: str | None = None


class Sensors:
    """Reads the socket a few messages at a time, fairly between connections (libzmq takes them in turn).

    Whoever is over its limits is dropped before decoding. Drops also slow the reading down, a little for each, so that
    a flood backs up in its sender's own connection rather than eat the processor; the other connections' turns come
    all the same.

    Attributes:
        lost: answers that could not be delivered, because the peer left or does not read.
        closed_until_ns: the socket is not read before this instant of the monotonic clock.
    """

    def __init__(
        self,
        socket: zmq.Socket[bytes],
        settings: PortSettings,
        *,
        run: str,
        site: str,
        peers: Peers,
        intake: Intake,
        inbox: Inbox,
        clock: Clock,
    ) -> None:
        """Serve ``socket``, a bound ROUTER."""
        self._socket = socket
        self._settings = settings
        self._peers = peers
        self._intake = intake
        self._inbox = inbox
        self._clock = clock
        limits = {name: getattr(settings.message, name) for name in settings.message.__slots__}
        self._welcome = encode(Welcome(v=VERSION, run=run, site=site, limits=limits))
        self.speakers = Speakers(settings.devices, int(settings.takeover_s * 1e9), int(settings.idle_s * 1e9))
        self.doors = Doors()
        self.lost = 0
        self.closed_until_ns = 0

    def serve(self) -> bool:
        """Judge what is there, at most a round of it; return whether there may be more to judge now."""
        drops = 0
        for _ in range(_ROUND):
            letter = receive(self._socket)
            if letter is None:
                return False
            drops += self._judge(letter) is Outcome.THROTTLED
            if drops >= _DROPS:
                self.closed_until_ns = self._clock.monotonic_ns() + _PAUSE_NS
                return False
        return True

    def send(self, peer: Peer, body: bytes) -> None:
        """Send an answer; a peer that left, or does not read, goes without."""
        *head, last = peer.envelope(body)
        try:
            for frame in head:
                self._socket.send(frame, _MORE)
            self._socket.send(last, _LAST)
        except zmq.ZMQError:
            self.lost += 1

    def answer_for(self, incoming: Incoming, outcome: Outcome, detail: str) -> tuple[bytes, ...]:
        """Return what is sent to the peer once the loop has settled a message; pure, for any thread."""
        message = incoming.event
        if outcome not in _USED:
            return (
                encode(
                    Error(
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
        answers: list[bytes] = []
        if isinstance(message, Hello):
            answers.append(self._welcome)
        # REQ takes one answer, no less and no more.
        if (incoming.wants_ack and not (answers and incoming.peer.delimited)) or (
            incoming.peer.delimited and not answers
        ):
            answers.append(
                encode(
                    Ack(
                        v=VERSION,
                        device=message.device,
                        session=message.session,
                        seq=message.seq,
                        outcome=outcome,
                        detail=detail,
                    )
                )
            )
        return tuple(answers)

    def _judge(self, letter: Letter) -> Outcome | None:
        """Count the message, and settle it unless it is handed to the loop."""
        now_ns = self._clock.monotonic_ns()
        peer = self._peers.of(letter.head, delimited=letter.delimited, now_ns=now_ns)
        self._intake.receive(peer.account, letter.n_bytes)
        body = letter.body or b""
        try:
            error = self._let_in(peer, letter, now_ns)
        except WireError as problem:
            error = error_for(problem, body)
        except Exception as problem:  # noqa: BLE001 - whatever a stranger sends, the port goes on and its books balance
            error = error_for(WireError("message", type(problem).__name__, "a message that can be understood"), body)
        if error is None:
            return None
        self._intake.settle(peer.account, error.outcome)
        if error.outcome is not Outcome.THROTTLED or peer.delimited or self._is_news(peer, now_ns):
            self.send(peer, encode(error))
        return error.outcome

    def _let_in(self, peer: Peer, letter: Letter, now_ns: int) -> Error | None:
        """Hand the message to the loop, or return the error that says why not."""
        if not peer.allowed:
            found = f"the key of {peer.name!r}, withdrawn"
            return _plain(Outcome.UNAUTHORISED, "key", found, "a key on the allow-list")
        limits = peer.account.limits
        if not peer.account.allowance.admits(letter.n_bytes, now_ns):
            expected = f"at most {limits.messages_per_s:g} messages/s and {limits.bytes_per_s:g} bytes/s"
            return _plain(Outcome.THROTTLED, "message", "too many messages or bytes", expected)
        if letter.body is None:
            raise WireError("message", f"{letter.frames} frames", "one frame, or an empty one and one")
        body = letter.body
        message = decode_message(body, self._settings.message)
        refusal = self._refusal(peer, message)
        if refusal is None:
            event: Event | Hello | Bye
            if isinstance(message, Hello | Bye):
                event = message
            else:
                event = to_event(message, self._clock.wall_ns())
                check_sent(event)
            refusal = self._admit(peer, message, now_ns)
        if refusal is None:
            incoming = Incoming(event, peer, message.ack, now_ns, len(body))
            if self._inbox.offer(incoming):
                self._tolerate(message, body)
                return None
            refusal = Refusal(Outcome.BUSY, "message", "more than the engine can take in now", "the same message later")
        return error_for(WireError(refusal.field, refusal.found, refusal.expected, refusal.outcome), body)

    def _refusal(self, peer: Peer, message: Message) -> Refusal | None:
        """Say why this message may not be looked at, however good it is."""
        grant = peer.account.grant
        if grant is not None and not grant.speaks_for(message.device):
            expected = f"one of {', '.join(grant.devices) or 'none'}, bound to the key of {grant.name!r}"
            return Refusal(Outcome.UNAUTHORISED, "device", repr(message.device), expected)
        if self.doors.everything is not None:
            return Refusal(Outcome.BUSY, "message", self.doors.everything, "the same message later")
        if self.doors.new_devices is not None and message.device not in self.speakers:
            return Refusal(Outcome.BUSY, "device", f"a new device: {self.doors.new_devices}", "the same message later")
        return None

    def _admit(self, peer: Peer, message: Message, now_ns: int) -> Refusal | None:
        return self.speakers.admit(
            message.device,
            message.session,
            peer.name,
            limit=peer.account.limits.devices,
            now_ns=now_ns,
            hello=isinstance(message, Hello),
            sensor=not isinstance(message, Fix | Truth),
        )

    def _tolerate(self, message: Message, body: bytes) -> None:
        if unknown := unknown_fields(body):
            self._intake.tolerate("fields", len(unknown))
        if isinstance(message, Motion) and (sensors := unknown_sensors(message)):
            self._intake.tolerate("sensors", len(sensors))

    def _is_news(self, peer: Peer, now_ns: int) -> bool:
        """Whether the peer was not told for a second that it is throttled."""
        news = now_ns - peer.account.told_ns >= _TELL_NS
        if news:
            peer.account.told_ns = now_ns
        return news


def _plain(outcome: Outcome, field: str, found: str, expected: str) -> Error:
    """Return an error about a message that was not decoded."""
    return Error(v=VERSION, outcome=outcome, field=field, found=found, expected=expected)
