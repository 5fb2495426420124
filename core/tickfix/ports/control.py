"""The control port: answers from snapshots at once, and hands orders to the loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import zmq

from tickfix.kernel import Outcome
from tickfix.ports.clock import Clock
from tickfix.ports.envelopes import Letter, receive
from tickfix.ports.intake import Command, Inbox
from tickfix.ports.peers import Peer, Peers
from tickfix.wire import VERSION, WireError
from tickfix.wire.replies import Error, Reply, Request, decode_request, encode, error_for

ORDERS: Final = frozenset({"drain", "stop", "primary"})
"""Requests that the loop must carry out; all others are answered by the port itself."""

_ROUND: Final = 16
_DROPS: Final = 8
_PAUSE_NS: Final = 2_000_000
_FREE_NS: Final = 1_000_000
_SHARE: Final = 10

Describe = Callable[[str, Mapping[str, Any]], Any]
Post = Callable[[Callable[[], None]], None]


class Control:
    """Answers requests, each exactly once, and few enough at a time that the other ports go on.

    Attributes:
        requests, refused: how many came in, and how many were refused as throttled, unauthorised, malformed or unknown.
        lost: answers that could not be delivered.
        closed_until_ns: the socket is not read before this instant of the monotonic clock.
    """

    def __init__(
        self,
        socket: zmq.Socket[bytes],
        *,
        peers: Peers,
        inbox: Inbox,
        describe: Describe,
        post: Post,
        clock: Clock,
    ) -> None:
        """Serve ``socket``, a bound ROUTER; ``post`` runs something on the thread that owns it."""
        self._socket = socket
        self._peers = peers
        self._inbox = inbox
        self._describe = describe
        self._post = post
        self._clock = clock
        self.requests = 0
        self.refused = 0
        self.lost = 0
        self.closed_until_ns = 0

    def serve(self) -> None:
        """Answer what is there, at most a round of it, and a tenth of the port's time however much is asked."""
        began_ns, drops = self._clock.monotonic_ns(), 0
        for _ in range(_ROUND):
            letter = receive(self._socket)
            if letter is None:
                break
            drops += not self._answer(letter)
            if drops >= _DROPS:
                self.closed_until_ns = self._clock.monotonic_ns() + _PAUSE_NS
                break
        ended_ns = self._clock.monotonic_ns()
        if ended_ns - began_ns > _FREE_NS:
            self.closed_until_ns = max(self.closed_until_ns, ended_ns + (_SHARE - 1) * (ended_ns - began_ns))

    def _answer(self, letter: Letter) -> bool:
        """Answer one request; return whether it was a good one."""
        now_ns = self._clock.monotonic_ns()
        peer = self._peers.of(letter.head, delimited=letter.delimited, now_ns=now_ns)
        self.requests += 1
        body = letter.body or b""
        try:
            request = self._request(peer, letter, now_ns)
        except WireError as problem:
            self.refused += 1
            self._send(peer, encode(error_for(problem, body)))
            return False
        if request.what in ORDERS:
            self._order(peer, request)
        else:
            self._send(peer, self._described(request))
        return True

    def _request(self, peer: Peer, letter: Letter, now_ns: int) -> Request:
        if not peer.allowed:
            raise WireError("key", "one that was withdrawn", "a key on the allow-list", Outcome.UNAUTHORISED)
        if not peer.account.allowance.admits(letter.n_bytes, now_ns):
            expected = f"at most {peer.account.limits.messages_per_s:g} requests/s"
            raise WireError("message", "too many requests", expected, Outcome.THROTTLED)
        if letter.body is None:
            raise WireError("message", f"{letter.frames} frames", "one frame, or an empty one and one")
        return decode_request(letter.body)

    def _described(self, request: Request) -> bytes:
        try:
            data = self._describe(request.what, request.args)
            return encode(Reply(v=VERSION, what=request.what, ok=True, data=data))
        except Exception as problem:  # noqa: BLE001 - an answer that fails is told to who asked, and harms nobody else
            reason = f"{type(problem).__name__}: {problem}"
            return encode(Reply(v=VERSION, what=request.what, ok=False, data=reason))

    def _order(self, peer: Peer, request: Request) -> None:
        told = False

        def reply(ok: bool, data: Any) -> None:  # noqa: FBT001 - the shape that Command names
            nonlocal told
            if told:
                return
            told = True
            answer = encode(Reply(v=VERSION, what=request.what, ok=ok, data=data))
            self._post(lambda: self._send(peer, answer))

        if not self._inbox.command(Command(request.what, request.args, reply)):
            busy = Error(
                v=VERSION,
                outcome=Outcome.BUSY,
                field="message",
                found="too many orders that wait for the loop",
                expected="the same request later",
            )
            self._send(peer, encode(busy))

    def _send(self, peer: Peer, body: bytes) -> None:
        try:
            self._socket.send_multipart(peer.envelope(body), zmq.NOBLOCK)
        except zmq.ZMQError:
            self.lost += 1
