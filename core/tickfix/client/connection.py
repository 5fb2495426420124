"""What sensor, listener and control share: keys, sockets, and messages as maps."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgpack
import zmq

VERSION: Final = 1
"""The protocol version spoken here."""


_OPTIONS: Final[dict[int, int]] = {
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


class ShutOutError(ClientError):
    """The engine does not let this client in; the message says why, and what to do."""


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


def open_socket(kind: int, keys: Keys | None, context: zmq.Context[zmq.Socket[bytes]] | None) -> zmq.Socket[bytes]:
    """Return a socket that speaks CURVE where there are keys, and never keeps a process from ending."""
    socket = (context or zmq.Context.instance()).socket(kind)
    socket.linger = 0
    for option, value in _OPTIONS.items():
        socket.setsockopt(option, value)
    if keys is not None:
        socket.curve_publickey = keys.public.encode()
        socket.curve_secretkey = keys.secret.encode()
        socket.curve_serverkey = keys.engine.encode()
    return socket


def connect(socket: zmq.Socket[bytes], address: str) -> None:
    """Connect, now or as soon as there is someone; a socket that cannot is closed.

    Raises:
        ClientError: for an address that cannot be.
    """
    try:
        socket.connect(address)
    except zmq.ZMQError as error:
        socket.close()
        raise ClientError(f"address: found {address!r} ({error}); expected one such as tcp://127.0.0.1:5571") from error


def readable(socket: zmq.Socket[bytes]) -> bool:
    """Whether a message is there. Cheaper than a poll, and asked all the time."""
    return bool(int(socket.get(zmq.EVENTS)) & zmq.POLLIN)


def packed(message: dict[str, Any]) -> bytes:
    """Return a message's bytes."""
    data: bytes = msgpack.packb(message, use_bin_type=True)
    return data


def unpacked(data: bytes) -> dict[str, Any] | None:
    """Return a message as a map, or None for anything else: a client passes over what it does not understand."""
    try:
        message = msgpack.unpackb(data, raw=False)
    except (ValueError, msgpack.UnpackException):
        return None
    return message if isinstance(message, dict) else None
