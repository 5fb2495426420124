"""A device's session with an engine: every message is numbered, kept until it is acknowledged, and counts once."""

from __future__ import annotations

import contextlib
import secrets
import time
from collections import Counter
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any, Final, Self

import zmq

from tickfix.client.connection import VERSION, ClientError, Keys, open_socket, packed, readable, unpacked
from tickfix.client.door import Door
from tickfix.client.outbox import Outbox

NOT_TAKEN: Final = frozenset({"busy", "throttled"})
"""Outcomes after which a message is sent again; every other one is final."""

_MESSAGE_BYTES: Final = 262_144
"""What an engine takes unless it says otherwise in its welcome; far beyond it, it hangs up."""


class OutboxFullError(ClientError):
    """More messages wait for their acknowledgement than may be kept; the new one was not taken."""


class Session:
    """Sends what one device says, and sends again what was not acknowledged.

    A message counts once: the engine knows it by ``session`` and number, however often it is sent. Nothing here
    waits but :meth:`flush`; acknowledgements are read, and what is due is sent again, whenever a method is called.

    Args:
        address: the engine's sensors port, tcp or ipc.
        device: name of the device.
        session: names this run of the device; a random one where not told. Whoever goes on with an old session goes
            on with its numbers: ``first_seq``.
        keys: CURVE keys, where the engine asks for them.
        keep_messages, keep_bytes: how much is kept that was not acknowledged.
        greets: say ``hello``, which makes this sender the voice of the device. A process that only adds fixes or truth
            to a device that speaks for itself does not.
        resend_s: how long to wait for an acknowledgement before sending again.
        on_outcome: called with (number, outcome, detail) of every message that is done with.
        on_drop: called with the number of the oldest message, which is dropped when too much is kept; without it
            the new message is refused with :class:`OutboxFullError`.
        clock: seconds, monotonic.

    Attributes:
        outcomes: how many messages ended how.
        sent, resent: messages that went out for the first time, and again.
        welcome: what the engine answered to ``hello``, None before.
        refused: why the engine refused a ``hello``, or messages it did not look into; empty after a ``welcome``.
        door: tells whether the engine lets this client in at all: ``door.shut`` and ``door.doubt`` say why not.
    """

    def __init__(
        self,
        address: str,
        device: str,
        *,
        session: str | None = None,
        first_seq: int = 1,
        keys: Keys | None = None,
        keep_messages: int = 20_000,
        keep_bytes: int = 64 * 2**20,
        greets: bool = True,
        resend_s: float = 2.0,
        on_outcome: Callable[[int, str, str], None] | None = None,
        on_drop: Callable[[int], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
        context: zmq.Context[zmq.Socket[bytes]] | None = None,
    ) -> None:
        """Connect; that nobody is there yet is no error.

        Raises:
            ClientError: for an address that cannot be.
        """
        self.device = device
        self.session = secrets.token_hex(8) if session is None else session
        self.outcomes: Counter[str] = Counter()
        self.sent = 0
        self.resent = 0
        self.welcome: dict[str, Any] | None = None
        self.refused = ""
        self._address = address
        self._next = first_seq
        self._highest_sent = first_seq - 1
        self._outbox = Outbox(keep_messages, keep_bytes, resend_s)
        self._on_outcome = on_outcome
        self._on_drop = on_drop
        self._clock = clock
        self._hello: dict[str, Any] = {"sensors": {}, "software": "tickfix.client", "clock": ""}
        self._greets = greets
        self._left = False
        self._greet = greets
        self._socket = open_socket(zmq.DEALER, keys, context)
        # Nothing waits in a queue of libzmq for a connection: what waits, waits in the outbox.
        self._socket.setsockopt(zmq.IMMEDIATE, 1)
        self.door = Door(self._socket, address, keys)

    @property
    def unacknowledged(self) -> int:
        """Number of messages whose fate is not known yet."""
        return len(self._outbox)

    def hello(self, sensors: Mapping[str, float], *, software: str = "tickfix.client", clock: str = "") -> None:
        """Tell what measures at which rate in Hz; said again by itself on every new connection.

        Without this call the session is opened with a ``hello`` that names no sensors.
        """
        self._hello = {"sensors": {k: float(v) for k, v in sensors.items()}, "software": software, "clock": clock}
        self._greet = True
        self._pump()

    def send(self, message: Mapping[str, Any]) -> int:
        """Send a message, a map with its ``type``; device, session and number are set here. Return its number.

        Raises:
            ClientError: for a message that is longer than the engine takes.
            OutboxFullError: see the class.
        """
        kind = str(message["type"])
        fields = {name: value for name, value in message.items() if name != "type"}
        head = {"v": VERSION, "type": kind, "device": self.device, "session": self.session}
        data = packed({**fields, **head, "seq": self._next, "ack": True})
        self._hear()
        most = (self.welcome or {}).get("limits", {}).get("message_bytes", _MESSAGE_BYTES)
        if len(data) > most:
            raise ClientError(f"{kind}: found {len(data)} bytes; expected at most {most} in one message")
        self._make_room(len(data))
        seq, self._next = self._next, self._next + 1
        self._left = False
        self._outbox.keep(seq, data)
        self._say()
        return seq

    def bye(self, timeout_s: float = 5.0) -> bool:
        """Tell that the device leaves, after all else was acknowledged; return whether it was heard in time.

        Where it was not, call again: goodbye is said once, until something else is sent.
        """
        before = self._clock()
        if not self.flush(timeout_s):
            return False
        if not self._left:
            self.send({"type": "bye"})
            self._left = True
        return self.flush(timeout_s - (self._clock() - before))

    def flush(self, timeout_s: float) -> bool:
        """Wait until everything is acknowledged, and return whether it is; what is due again is sent meanwhile."""
        deadline_s = self._clock() + timeout_s
        while True:
            self._pump()
            now_s = self._clock()
            due_s = self._outbox.next_due_s()
            if due_s is None or now_s >= deadline_s:
                return due_s is None
            # Due already and yet not sent: the socket does not take it, and only a look from time to time tells.
            wake_s = due_s if due_s > now_s else now_s + 0.05
            self.door.poller.poll(int(1000.0 * (min(wake_s, deadline_s) - now_s)) + 1)

    def close(self) -> int:
        """Close at once; return the number of messages whose fate stays unknown. :meth:`flush` first to have none."""
        self.door.close()
        return len(self._outbox)

    def __enter__(self) -> Self:
        """Return the session itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait up to five seconds for acknowledgements, unless an error leads out of the block, and close."""
        try:
            if kind is None:
                self.flush(5.0)
        finally:
            self.close()

    def _make_room(self, n_bytes: int) -> None:
        """Let the oldest messages go until one of this length can be kept, if they may."""
        while not self._outbox.fits(n_bytes):
            if self._on_drop is None or not self._outbox:
                raise OutboxFullError(
                    f"{self._address}: {len(self._outbox)} messages ({self._outbox.kept_bytes} bytes) wait for their "
                    f"acknowledgement, and {n_bytes} bytes more do not fit; is the engine running? "
                    "Send later, keep more, or say by on_drop that the oldest may go"
                )
            oldest = self._outbox.oldest()
            self._outbox.forget(oldest)
            self._on_drop(oldest)

    def _pump(self) -> None:
        self._hear()
        self._say()

    def _hear(self) -> None:
        """Read what has come."""
        if self.door.look():
            self._greet = self._greets
            self._outbox.all_due()
        while readable(self._socket):
            self._take(self._socket.recv_multipart()[-1])

    def _say(self) -> None:
        """Greet on a new connection, and send what is due."""
        if not self.door.connected:
            return
        with contextlib.suppress(zmq.Again):
            if self._greet:
                hello = {"v": VERSION, "type": "hello", "device": self.device, "session": self.session}
                self._socket.send(packed({**hello, **self._hello}), zmq.NOBLOCK)
                self._greet = False
            now_s = self._clock()
            for seq, data in self._outbox.due(now_s):
                self._socket.send(data, zmq.NOBLOCK)
                self._outbox.sent(seq, now_s)
                if seq > self._highest_sent:
                    self._highest_sent = seq
                    self.sent += 1
                else:
                    self.resent += 1

    def _take(self, data: bytes) -> None:
        message = unpacked(data)
        if message is None:
            return
        kind, seq, outcome = message.get("type"), message.get("seq"), str(message.get("outcome"))
        if kind == "welcome":
            self.welcome, self.refused = message, ""
            return
        if kind == "error" and seq == 0:
            self.refused = _reason(message)
        mine = message.get("session") == self.session and message.get("device") == self.device
        if kind not in {"ack", "error"} or not mine or not isinstance(seq, int) or seq not in self._outbox:
            return
        self.outcomes[outcome] += 1
        if outcome in NOT_TAKEN:
            self._outbox.refused_for_now(seq, self._clock())
            return
        self._outbox.forget(seq)
        if self._on_outcome is not None:
            self._on_outcome(seq, outcome, _reason(message))


def _reason(answer: Mapping[str, Any]) -> str:
    if answer["type"] == "ack":
        return str(answer.get("detail", ""))
    return f"{answer.get('field')}: found {answer.get('found')}; expected {answer.get('expected')}"
