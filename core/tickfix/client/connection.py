"""Shared by sensor, listener and control: keys, sockets, the handshake monitor, and packing of messages."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Final

import msgpack
import zmq
from zmq.utils.monitor import parse_monitor_message

VERSION: Final = 1
"""The protocol version spoken here."""


_SOCKET_OPTIONS: Final[dict[int, int]] = {
    zmq.RECONNECT_IVL: 100,
    zmq.RECONNECT_IVL_MAX: 5_000,
    # No ZMTP heartbeats: where one cuts a connection whose queue is full, what was under way to the old connection
    # reaches the new one and aborts the process, `Assertion failed: _input_stopped` (libzmq issues 3937 and 4767, open
    # in 4.3.5). A listener that is slow for six seconds is all it takes. TCP notices instead: by asking, and by what
    # nobody acknowledges.
    zmq.TCP_KEEPALIVE: 1,
    zmq.TCP_KEEPALIVE_IDLE: 10,
    zmq.TCP_KEEPALIVE_INTVL: 5,
    zmq.TCP_KEEPALIVE_CNT: 3,
    zmq.TCP_MAXRT: 25_000,
}


class ClientError(Exception):
    """Root of the errors of this package."""

    kind: ClassVar[str] = "client"


class AccessDeniedError(ClientError):
    """The engine refuses this client; the message gives the reason and the remedy."""

    kind: ClassVar[str] = "access_denied"


@dataclass(frozen=True, slots=True)
class Keys:
    """CURVE keys, each 40 characters of Z85.

    Attributes:
        public, secret: this client's own pair.
        engine: the engine's public key.
    """

    public: str
    secret: str = field(repr=False)
    engine: str

    @staticmethod
    def read(own: str | Path, engine: str | Path) -> Keys:
        """Read the own ``NAME.key`` and the engine's ``engine.pub``, as ``tickfix keys`` makes them.

        Raises:
            ClientError: when a file cannot be read or holds no such key.
        """
        tables = []
        for file in (Path(own), Path(engine)):
            try:
                tables.append(tomllib.loads(file.read_text("utf-8")))
            except (OSError, ValueError) as error:
                raise ClientError(f"{file}: cannot be read: {error}") from error
        mine, theirs = tables
        for path, table, name in ((own, mine, "public"), (own, mine, "secret"), (engine, theirs, "public")):
            if not isinstance(table.get(name), str) or len(table[name]) != 40:
                raise ClientError(f"{path}: found no {name} key; expected {name} = 40 characters")
        return Keys(mine["public"], mine["secret"], theirs["public"])


def open_client_socket(
    kind: int, keys: Keys | None, context: zmq.Context[zmq.Socket[bytes]] | None
) -> zmq.Socket[bytes]:
    """Return a socket that speaks CURVE where there are keys, and never keeps a process from ending."""
    socket = (context or zmq.Context.instance()).socket(kind)
    socket.linger = 0
    for option, value in _SOCKET_OPTIONS.items():
        socket.setsockopt(option, value)
    if keys is not None:
        socket.curve_publickey = keys.public.encode()
        socket.curve_secretkey = keys.secret.encode()
        socket.curve_serverkey = keys.engine.encode()
    return socket


def connect_socket(socket: zmq.Socket[bytes], address: str) -> None:
    """Connect, now or as soon as there is someone; a socket that cannot is closed.

    Raises:
        ClientError: for an address that cannot be.
    """
    try:
        socket.connect(address)
    except zmq.ZMQError as error:
        socket.close()
        raise ClientError(f"address: found {address!r} ({error}); expected one such as tcp://127.0.0.1:5571") from error


def has_message(socket: zmq.Socket[bytes]) -> bool:
    """Whether a message is there. Cheaper than a poll, and asked all the time."""
    return bool(int(socket.get(zmq.EVENTS)) & zmq.POLLIN)


def pack_message(message: dict[str, Any]) -> bytes:
    """Return a message's bytes."""
    data: bytes = msgpack.packb(message, use_bin_type=True)
    return data


def unpack_message(data: bytes) -> dict[str, Any] | None:
    """Return a message as a map, or None for anything else: a client passes over what it does not understand."""
    try:
        message = msgpack.unpackb(data, raw=False)
    except (ValueError, msgpack.UnpackException):
        return None
    return message if isinstance(message, dict) else None


_HANDSHAKE_EVENTS: Final = (
    zmq.EVENT_HANDSHAKE_SUCCEEDED
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_DISCONNECTED
)
_SUSPICIOUS_FAILURES: Final = 3
"""Handshakes broken off in a row that are no accident any more."""


class HandshakeMonitor:
    """Connects one socket, and watches what becomes of it.

    Args:
        socket: of a client, with all that has to be set before it connects.
        address: of the engine's port.
        keys: that the client has, None for none.

    Attributes:
        monitor: to be polled beside the socket; when it is readable, :meth:`read_events`.
        poller: waits for a message on the socket, or for news on the monitor.
        connected: a connection stands.
        denied_reason: why the engine does not let this client in, whatever it tries, and what to do; else empty.
        suspected_cause: why that may be so; else empty.
    """

    def __init__(self, socket: zmq.Socket[bytes], address: str, keys: Keys | None) -> None:
        """Start the monitor and connect; the engine need not be running yet.

        Raises:
            ClientError: for an address that cannot be.
        """
        self._socket = socket
        self._address = address
        self._keys = keys
        self._failed_handshakes = 0
        self.connected = False
        self.denied_reason = ""
        self.suspected_cause = ""
        self.monitor = socket.get_monitor_socket(_HANDSHAKE_EVENTS)
        self.monitor.linger = 0
        self.poller = zmq.Poller()
        self.poller.register(socket, zmq.POLLIN)
        self.poller.register(self.monitor, zmq.POLLIN)
        try:
            connect_socket(socket, address)
        except ClientError:
            self.monitor.close()
            raise

    def read_events(self) -> bool:
        """Read what was noted; return whether a connection was made since."""
        reconnected = False
        while has_message(self.monitor):
            report = parse_monitor_message(self.monitor.recv_multipart())
            event, value = report["event"], report["value"]
            self.connected = event == zmq.EVENT_HANDSHAKE_SUCCEEDED
            if self.connected:
                reconnected, self._failed_handshakes, self.denied_reason, self.suspected_cause = True, 0, "", ""
            elif event == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
                self.denied_reason = (
                    "the engine does not let this key in here; put it on the engine's allow-list for this port "
                    "(`tickfix keys allow`, or `tickfix keys new` with --port), then start again"
                )
            elif event == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL:
                self._on_protocol_error(value)
            elif event == zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL:
                self._failed_handshakes += 1
                if self._failed_handshakes >= _SUSPICIOUS_FAILURES and self._keys is not None:
                    self.suspected_cause = (
                        "every handshake is broken off; is engine.pub the public key of this very engine?"
                    )
        return reconnected

    def raise_if_denied(self) -> None:
        """Raise where the engine does not let this client in, as far as :meth:`read_events` has seen.

        Raises:
            AccessDeniedError: with the reason and the remedy.
        """
        if self.denied_reason:
            raise AccessDeniedError(f"{self._address}: {self.denied_reason}")

    def close(self) -> None:
        """Stop watching, and close the socket; once more does nothing."""
        if not self._socket.closed:
            self._socket.disable_monitor()
            self.monitor.close()
            self._socket.close()

    def _on_protocol_error(self, value: int) -> None:
        if value != zmq.PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH:
            return
        if self._keys is None:
            self.denied_reason = (
                "the engine requires a key, and none was given; its operator creates one with `tickfix keys new`; "
                "then start again with it (--key NAME.key, engine.pub beside it)"
            )
        else:
            self.denied_reason = "a key was given, and the engine there asks for none; start again without it"
