"""The sockets of an engine: opened together, closed together, and each opened anew where that is the only way."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any, Final

import zmq

from tickfix.api.errors import PortError
from tickfix.ports.addresses import Address, parse_address, require_keys
from tickfix.ports.authentication import ENDPOINT
from tickfix.ports.keys import ENGINE, PORTS, read_pair
from tickfix.ports.settings import PortSettings
from tickfix.ports.sockets import bind, demand_keys, endpoint_of, open_router, open_socket, raise_file_limit

_QUEUED: Final = {"sensors": 256, "positions": 10_000, "control": 64, "follow": 20_000}
"""High-water marks, messages per peer. What a sensor sends beyond them waits in its own connection."""

_SUBSCRIPTION_BYTES: Final = 4_096
_REQUEST_BYTES: Final = 65_536
_TRIES: Final = 400
_TRY_S: Final = 0.005


class OpenPorts:
    """The sockets by port name, with ``doorkeeper`` for libzmq's questions where there are keys.

    Attributes:
        endpoints: where each port is, in full, once it is open.
    """

    def __init__(self, settings: PortSettings) -> None:
        """Check addresses and keys; nothing is opened yet.

        Raises:
            ConfigError: for an address that cannot be, or that others can reach while there are no keys.
            PortError: for keys that cannot be used.
        """
        self._settings = settings
        named = {name: getattr(settings, name) for name in PORTS}
        self._addresses = {name: parse_address(f"ports.{name}", text) for name, text in named.items() if text}
        if settings.keys is None:
            for name, address in self._addresses.items():
                require_keys(f"ports.{name}", address)
        self._engine = None if settings.keys is None else read_pair(settings.keys / f"{ENGINE}.key")
        self._context: zmq.Context[Any] | None = None
        self._sockets: dict[str, zmq.Socket[bytes]] = {}
        self.endpoints: dict[str, str] = {}

    def __getitem__(self, name: str) -> zmq.Socket[bytes]:
        """Return the socket of a port."""
        return self._sockets[name]

    def __contains__(self, name: str) -> bool:
        """Whether there is such a port."""
        return name in self._addresses

    def open(self) -> None:
        """Open and bind all; when one cannot be bound, none stays open.

        Raises:
            PortError: naming address and cause.
        """
        raise_file_limit()
        self._context = zmq.Context()
        try:
            if self._engine is not None:
                self._sockets["doorkeeper"] = self._context.socket(zmq.REP)
                self._sockets["doorkeeper"].setsockopt(zmq.LINGER, 0)
                self._sockets["doorkeeper"].bind(ENDPOINT)
            for name, address in self._addresses.items():
                self._sockets[name] = self._made(self._context, name)
                self.endpoints[name] = self._bind(name, address)
        except BaseException:
            self.close(0)
            raise

    def reopen(self, name: str) -> zmq.Socket[bytes]:
        """Close a port and open it again; return its new socket.

        libzmq cannot cut off one connection. This cuts off all; those that may come back do so by themselves.

        Raises:
            PortError: when the address cannot be had again.
        """
        assert self._context is not None  # noqa: S101 - for the type checker: the ports are open
        old = self._sockets[name]
        old.unbind(endpoint_of(old))
        old.close(0)
        self._sockets[name] = self._made(self._context, name)
        address = parse_address(f"ports.{name}", self.endpoints[name])
        for _ in range(_TRIES):
            # The old socket gives its address back on a thread of libzmq's, in a moment.
            with suppress(PortError):
                self._bind(name, address)
                return self._sockets[name]
            time.sleep(_TRY_S)
        self._bind(name, address)
        return self._sockets[name]

    def close(self, linger_ms: int) -> None:
        """Give the addresses back and close all, after ``linger_ms`` for what is on its way."""
        # The doorkeeper was there first and leaves last. Nothing is unbound beforehand: that ends connections at once,
        # with what they have not delivered. The addresses are free when the context has ended.
        for name, socket in reversed(self._sockets.items()):
            socket.close(linger_ms)
            address = self._addresses.get(name)
            if name in self.endpoints and address is not None and address.path is not None:
                address.path.unlink(missing_ok=True)
        self._sockets.clear()
        self.endpoints.clear()
        if self._context is not None:
            self._context.term()
            self._context = None

    def _made(self, context: zmq.Context[Any], name: str) -> zmq.Socket[bytes]:
        """Return the socket of a port, not yet bound."""
        # One frame may be twice as long as a message may be, so that the sender of the first too long one is told.
        frame_bytes = {"sensors": 2 * self._settings.message.message_bytes, "control": _REQUEST_BYTES}
        if name in frame_bytes:
            socket = open_router(context, queued=_QUEUED[name], frame_bytes=frame_bytes[name])
        else:
            socket = open_socket(context, zmq.XPUB, queued=_QUEUED[name], frame_bytes=_SUBSCRIPTION_BYTES)
        if self._engine is not None:
            demand_keys(socket, name, self._engine)
        return socket

    def _bind(self, name: str, address: Address) -> str:
        return bind(self._sockets[name], f"ports.{name}", address, private=self._engine is None)
