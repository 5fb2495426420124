"""A device's session with an engine.

Every message is numbered, buffered until acknowledged, retransmitted, and counts once.
"""

from __future__ import annotations

import contextlib
import secrets
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Any, ClassVar, Final, Self

import zmq

from tickfix.client.connection import (
    VERSION,
    ClientError,
    HandshakeMonitor,
    Keys,
    has_message,
    open_client_socket,
    pack_message,
    unpack_message,
)

SEND_WINDOW: Final = 24
"""Messages that may be in flight.

An engine holds at least 32 answers for a connection that does not read at the moment, and those beyond are lost; so
that many messages, and a greeting, may wait for theirs. It is also far below the 4096 numbers that an engine remembers,
so that the engine can always classify a retransmission as new or duplicate.
"""

_BACKOFF_FACTOR: Final = 2.0
_MAX_BACKOFF: Final = 16.0


@dataclass(slots=True)
class _UnackedMessage:
    data: bytes
    due_s: float
    backoff: float = 1.0


class RetransmitBuffer:
    """Keeps numbered messages until they are acknowledged.

    Args:
        most_messages, most_bytes: how much is kept.
        resend_s: how long to wait for an acknowledgement; doubled with every try of a message, up to 16 times.
    """

    def __init__(self, most_messages: int, most_bytes: int, resend_s: float) -> None:
        """Begin empty."""
        self._entries: OrderedDict[int, _UnackedMessage] = OrderedDict()
        self._bytes = 0
        self._most_messages = most_messages
        self._most_bytes = most_bytes
        self._resend_s = resend_s

    def __len__(self) -> int:
        """Return the number of messages kept."""
        return len(self._entries)

    def __contains__(self, seq: int) -> bool:
        """Whether this number is not acknowledged yet."""
        return seq in self._entries

    @property
    def buffered_bytes(self) -> int:
        """Bytes kept."""
        return self._bytes

    def fits(self, n_bytes: int) -> bool:
        """Whether a message of this length can be kept beside the others."""
        return len(self._entries) < self._most_messages and self._bytes + n_bytes <= self._most_bytes

    def add(self, seq: int, data: bytes) -> None:
        """Keep a message; it is due immediately. Numbers come in ascending order."""
        self._entries[seq] = _UnackedMessage(data, 0.0)
        self._bytes += len(data)

    def forget(self, seq: int) -> bool:
        """Let go of a message; False when it was not kept."""
        entry = self._entries.pop(seq, None)
        if entry is None:
            return False
        self._bytes -= len(entry.data)
        return True

    def oldest(self) -> int:
        """Return the lowest number kept."""
        return next(iter(self._entries))

    def due(self, now_s: float) -> list[tuple[int, bytes]]:
        """Return what is to be sent now, lowest number first, of the window that begins at the oldest."""
        found = []
        if self._entries:
            end = self.oldest() + SEND_WINDOW
            for seq, entry in self._entries.items():
                if seq >= end:
                    break
                if entry.due_s <= now_s:
                    found.append((seq, entry.data))
        return found

    def next_due_s(self) -> float | None:
        """Return when something is due again, None where nothing is kept."""
        if not self._entries:
            return None
        end = self.oldest() + SEND_WINDOW
        return min(entry.due_s for seq, entry in self._entries.items() if seq < end)

    def sent(self, seq: int, now_s: float) -> None:
        """Record that a message was sent: it is due again after its backoff."""
        entry = self._entries[seq]
        entry.due_s = now_s + self._resend_s * entry.backoff
        entry.backoff = min(entry.backoff * _BACKOFF_FACTOR, _MAX_BACKOFF)

    def defer(self, seq: int, now_s: float) -> None:
        """Record that the engine was busy: the message is due again after the resend interval."""
        entry = self._entries.get(seq)
        if entry is not None:
            entry.due_s = now_s + self._resend_s

    def mark_all_due(self) -> None:
        """Make everything due: the connection is a new one, and what was under way on the old one may be lost."""
        for entry in self._entries.values():
            entry.due_s = 0.0
            entry.backoff = 1.0


RETRYABLE_OUTCOMES: Final = frozenset({"busy", "throttled"})
"""Outcomes after which a message is sent again; every other one is final."""

_DEFAULT_MESSAGE_BYTES: Final = 262_144
"""Default limit of an engine; its welcome may name another. Far beyond its limit it closes the connection."""


class BufferFullError(ClientError):
    """More messages wait for their acknowledgement than may be kept; the new one was not taken."""

    kind: ClassVar[str] = "buffer_full"


class Session:
    """Sends the messages of one device, and retransmits what was not acknowledged.

    A message counts once: the engine knows it by ``session`` and number, however often it is sent. Nothing here
    waits but :meth:`flush`; acknowledgements are read, and what is due is sent again, whenever a method is called.

    Args:
        address: the engine's sensors port, tcp or ipc.
        device: name of the device.
        session: names this run of the device; random by default. A client that continues an old session must also
            continue its numbers: ``first_seq``.
        keys: CURVE keys, where the engine asks for them.
        buffer_messages, buffer_bytes: how much is kept that was not acknowledged.
        send_hello: send ``hello``, which binds the device to this sender. Leave it out in a process that only adds
            fixes or truth to a device that sends for itself.
        resend_s: how long to wait for an acknowledgement before sending again.
        on_outcome: called with (number, outcome, detail) of every message that is done with.
        on_drop: called with the number of the oldest message, which is dropped when too much is kept; without it
            the new message is refused with :class:`BufferFullError`.
        clock: seconds, monotonic.

    Attributes:
        outcomes: how many messages ended how.
        sent, resent: messages that went out for the first time, and again.
        welcome: what the engine answered to ``hello``, None before.
        refused: why the engine refused a ``hello``, or messages it did not look into; empty after a ``welcome``.
        handshake: monitors whether the engine admits this client: ``handshake.shut`` and ``handshake.doubt`` give the
            reason if not.
    """

    def __init__(
        self,
        address: str,
        device: str,
        *,
        session: str | None = None,
        first_seq: int = 1,
        keys: Keys | None = None,
        buffer_messages: int = 20_000,
        buffer_bytes: int = 64 * 2**20,
        send_hello: bool = True,
        resend_s: float = 2.0,
        on_outcome: Callable[[int, str, str], None] | None = None,
        on_drop: Callable[[int], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
        context: zmq.Context[zmq.Socket[bytes]] | None = None,
    ) -> None:
        """Connect; the engine need not be running yet.

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
        self._buffer = RetransmitBuffer(buffer_messages, buffer_bytes, resend_s)
        self._on_outcome = on_outcome
        self._on_drop = on_drop
        self._clock = clock
        self._hello: dict[str, Any] = {"sensors": {}, "software": "tickfix.client", "clock": ""}
        self._send_hello = send_hello
        self._bye_sent = False
        self._hello_due = send_hello
        self._socket = open_client_socket(zmq.DEALER, keys, context)
        # Without a connection libzmq queues nothing: messages wait in the retransmit buffer.
        self._socket.setsockopt(zmq.IMMEDIATE, 1)
        self.handshake = HandshakeMonitor(self._socket, address, keys)

    @property
    def unacknowledged(self) -> int:
        """Number of messages whose fate is not known yet."""
        return len(self._buffer)

    def hello(self, sensors: Mapping[str, float], *, software: str = "tickfix.client", clock: str = "") -> None:
        """Send the sensors with their rates in Hz; it is sent again on every new connection.

        Without this call the session is opened with a ``hello`` that names no sensors.
        """
        self._hello = {"sensors": {k: float(v) for k, v in sensors.items()}, "software": software, "clock": clock}
        self._hello_due = True
        self._service()

    def send(self, message: Mapping[str, Any]) -> int:
        """Send a message, a map with its ``type``; device, session and number are set here. Return its number.

        Raises:
            ClientError: for a message that is longer than the engine takes.
            BufferFullError: see the class.
        """
        kind = str(message["type"])
        fields = {name: value for name, value in message.items() if name != "type"}
        head = {"v": VERSION, "type": kind, "device": self.device, "session": self.session}
        data = pack_message({**fields, **head, "seq": self._next, "ack": True})
        self._receive()
        most = (self.welcome or {}).get("limits", {}).get("message_bytes", _DEFAULT_MESSAGE_BYTES)
        if len(data) > most:
            raise ClientError(f"{kind}: found {len(data)} bytes; expected at most {most} in one message")
        self._make_room(len(data))
        seq, self._next = self._next, self._next + 1
        self._bye_sent = False
        self._buffer.add(seq, data)
        self._send_due()
        return seq

    def bye(self, timeout_s: float = 5.0) -> bool:
        """Send ``bye`` after everything else was acknowledged; return whether it was acknowledged in time.

        If it was not, call again: ``bye`` is sent once, until something else is sent.
        """
        before = self._clock()
        if not self.flush(timeout_s):
            return False
        if not self._bye_sent:
            self.send({"type": "bye"})
            self._bye_sent = True
        return self.flush(timeout_s - (self._clock() - before))

    def flush(self, timeout_s: float) -> bool:
        """Wait until everything is acknowledged, and return whether it is; what is due again is sent meanwhile."""
        deadline_s = self._clock() + timeout_s
        while True:
            self._service()
            now_s = self._clock()
            due_s = self._buffer.next_due_s()
            if due_s is None or now_s >= deadline_s:
                return due_s is None
            # Due already and yet not sent: the socket would block, so try again after a short poll.
            wake_s = due_s if due_s > now_s else now_s + 0.05
            self.handshake.poller.poll(int(1000.0 * (min(wake_s, deadline_s) - now_s)) + 1)

    def close(self) -> int:
        """Close without waiting; return the number of unacknowledged messages. See :meth:`flush`."""
        self.handshake.close()
        return len(self._buffer)

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
        while not self._buffer.fits(n_bytes):
            if self._on_drop is None or not self._buffer:
                raise BufferFullError(
                    f"{self._address}: {len(self._buffer)} messages ({self._buffer.buffered_bytes} bytes) wait for "
                    f"their acknowledgement, and {n_bytes} bytes more do not fit; is the engine running? "
                    "Send later, raise the limit, or pass on_drop to drop the oldest"
                )
            oldest = self._buffer.oldest()
            self._buffer.forget(oldest)
            self._on_drop(oldest)

    def _service(self) -> None:
        self._receive()
        self._send_due()

    def _receive(self) -> None:
        """Read what has come."""
        if self.handshake.read_events():
            self._hello_due = self._send_hello
            self._buffer.mark_all_due()
        while has_message(self._socket):
            self._handle_reply(self._socket.recv_multipart()[-1])

    def _send_due(self) -> None:
        """Greet on a new connection, and send what is due."""
        if not self.handshake.connected:
            return
        with contextlib.suppress(zmq.Again):
            if self._hello_due:
                hello = {"v": VERSION, "type": "hello", "device": self.device, "session": self.session}
                self._socket.send(pack_message({**hello, **self._hello}), zmq.NOBLOCK)
                self._hello_due = False
            now_s = self._clock()
            for seq, data in self._buffer.due(now_s):
                self._socket.send(data, zmq.NOBLOCK)
                self._buffer.sent(seq, now_s)
                if seq > self._highest_sent:
                    self._highest_sent = seq
                    self.sent += 1
                else:
                    self.resent += 1

    def _handle_reply(self, data: bytes) -> None:
        message = unpack_message(data)
        if message is None:
            return
        kind, seq, outcome = message.get("type"), message.get("seq"), str(message.get("outcome"))
        if kind == "welcome":
            self.welcome, self.refused = message, ""
            return
        if kind == "error" and seq == 0:
            self.refused = _reply_reason(message)
        mine = message.get("session") == self.session and message.get("device") == self.device
        if kind not in {"ack", "error"} or not mine or not isinstance(seq, int) or seq not in self._buffer:
            return
        self.outcomes[outcome] += 1
        if outcome in RETRYABLE_OUTCOMES:
            self._buffer.defer(seq, self._clock())
            return
        self._buffer.forget(seq)
        if self._on_outcome is not None:
            self._on_outcome(seq, outcome, _reply_reason(message))


def _reply_reason(answer: Mapping[str, Any]) -> str:
    if answer["type"] == "ack":
        return str(answer.get("detail", ""))
    return f"{answer.get('field')}: found {answer.get('found')}; expected {answer.get('expected')}"
