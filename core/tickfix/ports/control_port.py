"""The control port: answers queries at once where it can, and queues commands and the other queries for the loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any, Final

import zmq

from tickfix.ports.inbound_queue import ControlCommand, InboundQueue, RouterMessage, receive_message
from tickfix.ports.peers import Peer, PeerRegistry
from tickfix.ports.port_settings import Clock
from tickfix.wire import VERSION, ReplyOutcome, WireError
from tickfix.wire.engine_messages import (
    ControlReply,
    ControlRequest,
    ErrorReply,
    decode_request,
    encode_engine_message,
    error_reply,
)

LOOP_COMMANDS: Final = frozenset({"drain", "stop", "primary"})
"""Requests that the loop must carry out; all others are queries."""


class _AskLoop(Enum):
    ASK_LOOP = "ask the loop"


ASK_LOOP: Final = _AskLoop.ASK_LOOP
"""What ``describe`` returns for a query that only the loop can answer; it is queued like a command."""

_REQUESTS_PER_ROUND: Final = 16
_DROPS_BEFORE_PAUSE: Final = 8
_PAUSE_NS: Final = 2_000_000
_UNTHROTTLED_NS: Final = 1_000_000
_TIME_SHARE_DIVISOR: Final = 10

DescribeRequest = Callable[[str, Mapping[str, Any]], Any]
PostToThread = Callable[[Callable[[], None]], None]


class ControlPort:
    """Answers requests, each exactly once, and few enough at a time that the other ports go on.

    Attributes:
        requests, refused: how many came in, and how many were refused as throttled, unauthorised, malformed or unknown.
        replies_lost: answers that could not be delivered.
        paused_until_ns: the socket is not read before this instant of the monotonic clock.
    """

    def __init__(
        self,
        socket: zmq.Socket[bytes],
        *,
        peers: PeerRegistry,
        inbound_queue: InboundQueue,
        describe: DescribeRequest,
        post: PostToThread,
        clock: Clock,
    ) -> None:
        """Serve ``socket``, a bound ROUTER; ``post`` runs something on the thread that owns it."""
        self._socket = socket
        self._peers = peers
        self._inbound_queue = inbound_queue
        self._describe = describe
        self._post = post
        self._clock = clock
        self.requests = 0
        self.refused = 0
        self.replies_lost = 0
        self.paused_until_ns = 0

    def serve(self) -> None:
        """Answer what is there, at most a round of it, and a tenth of the port's time however much is asked."""
        started_ns, drops = self._clock.monotonic_ns(), 0
        for _ in range(_REQUESTS_PER_ROUND):
            received = receive_message(self._socket)
            if received is None:
                break
            drops += not self._answer(received)
            if drops >= _DROPS_BEFORE_PAUSE:
                self.paused_until_ns = self._clock.monotonic_ns() + _PAUSE_NS
                break
        ended_ns = self._clock.monotonic_ns()
        if ended_ns - started_ns > _UNTHROTTLED_NS:
            self.paused_until_ns = max(
                self.paused_until_ns, ended_ns + (_TIME_SHARE_DIVISOR - 1) * (ended_ns - started_ns)
            )

    def _answer(self, received: RouterMessage) -> bool:
        """Answer one request; return whether it was a good one."""
        now_ns = self._clock.monotonic_ns()
        peer = self._peers.identify(received.identity, delimited=received.delimited, now_ns=now_ns)
        self.requests += 1
        body = received.body or b""
        try:
            request = self._request(peer, received, now_ns)
        except WireError as problem:
            self.refused += 1
            self._send(peer, encode_engine_message(error_reply(problem, body)))
            return False
        reply = None if request.what in LOOP_COMMANDS else self._describe_reply(request)
        if reply is None:
            self._forward_to_loop(peer, request)
        else:
            self._send(peer, reply)
        return True

    def _request(self, peer: Peer, received: RouterMessage, now_ns: int) -> ControlRequest:
        if not peer.allowed:
            raise WireError("key", "one that was withdrawn", "a key on the allow-list", ReplyOutcome.UNAUTHORISED)
        if not peer.state.bucket.try_consume(received.n_bytes, now_ns):
            expected = f"at most {peer.state.limits.messages_per_s:g} requests/s"
            raise WireError("message", "too many requests", expected, ReplyOutcome.THROTTLED)
        if received.body is None:
            raise WireError("message", f"{received.frames} frames", "one frame, or an empty one and one")
        return decode_request(received.body)

    def _describe_reply(self, request: ControlRequest) -> bytes | None:
        """Return the reply to a query, None where the loop must answer it."""
        try:
            data = self._describe(request.what, request.args)
        except Exception as problem:  # noqa: BLE001 - a failed query is reported to its sender, and concerns nobody else
            return _encode_reply(request.what, ok=False, data=f"{type(problem).__name__}: {problem}")
        return None if data is ASK_LOOP else _encode_reply(request.what, ok=True, data=data)

    def _forward_to_loop(self, peer: Peer, request: ControlRequest) -> None:
        replied = False

        def reply(ok: bool, data: Any) -> None:  # noqa: FBT001 - the shape that Command names
            nonlocal replied
            if replied:
                return
            replied = True
            # Encoded on this port's thread: a list of ten thousand devices would hold up the loop.
            self._post(lambda: self._send(peer, _encode_reply(request.what, ok=ok, data=data)))

        if not self._inbound_queue.command(ControlCommand(request.what, request.args, reply)):
            busy = ErrorReply(
                v=VERSION,
                outcome=ReplyOutcome.BUSY,
                field="message",
                found="too many requests that wait for the loop",
                expected="the same request later",
            )
            self._send(peer, encode_engine_message(busy))

    def _send(self, peer: Peer, body: bytes) -> None:
        try:
            self._socket.send_multipart(peer.envelope(body), zmq.NOBLOCK)
        except zmq.ZMQError:
            self.replies_lost += 1


def _encode_reply(what: str, *, ok: bool, data: Any) -> bytes:
    """Encode a reply; data that MessagePack cannot hold make it a failed one."""
    try:
        return encode_engine_message(ControlReply(v=VERSION, what=what, ok=ok, data=data))
    except Exception as problem:  # noqa: BLE001 - see above
        reason = f"{type(problem).__name__}: {problem}"
        return encode_engine_message(ControlReply(v=VERSION, what=what, ok=False, data=reason))
