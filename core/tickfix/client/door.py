"""Whether an engine lets a client in: what libzmq notes about the handshakes of a socket."""

from __future__ import annotations

from typing import Final

import zmq
from zmq.utils.monitor import parse_monitor_message

from tickfix.client.connection import ClientError, Keys, ShutOutError, connect, readable

_EVENTS: Final = (
    zmq.EVENT_HANDSHAKE_SUCCEEDED
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_DISCONNECTED
)
_DOUBTFUL: Final = 3
"""Handshakes broken off in a row that are no accident any more."""


class Door:
    """Connects one socket, and watches what becomes of it.

    Args:
        socket: of a client, with all that has to be set before it connects.
        address: of the engine's port.
        keys: that the client has, None for none.

    Attributes:
        monitor: to be polled beside the socket; when it is readable, :meth:`look`.
        poller: waits for a message on the socket, or for news on the monitor.
        connected: a connection stands.
        shut: why the engine does not let this client in, whatever it tries, and what to do; else empty.
        doubt: why that may be so; else empty.
    """

    def __init__(self, socket: zmq.Socket[bytes], address: str, keys: Keys | None) -> None:
        """Begin to watch, and connect; that nobody is there yet is no error.

        Raises:
            ClientError: for an address that cannot be.
        """
        self._socket = socket
        self._address = address
        self._keys = keys
        self._broken_off = 0
        self.connected = False
        self.shut = ""
        self.doubt = ""
        self.monitor = socket.get_monitor_socket(_EVENTS)
        self.monitor.linger = 0
        self.poller = zmq.Poller()
        self.poller.register(socket, zmq.POLLIN)
        self.poller.register(self.monitor, zmq.POLLIN)
        try:
            connect(socket, address)
        except ClientError:
            self.monitor.close()
            raise

    def look(self) -> bool:
        """Read what was noted; return whether a connection was made since."""
        made = False
        while readable(self.monitor):
            noted = parse_monitor_message(self.monitor.recv_multipart())
            event, value = noted["event"], noted["value"]
            self.connected = event == zmq.EVENT_HANDSHAKE_SUCCEEDED
            if self.connected:
                made, self._broken_off, self.shut, self.doubt = True, 0, "", ""
            elif event == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
                self.shut = (
                    "the engine does not let this key in here; put it on the engine's allow-list for this port "
                    "(`tickfix keys allow`, or `tickfix keys new` with --port), then start again"
                )
            elif event == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL:
                self._mismatch(value)
            elif event == zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL:
                self._broken_off += 1
                if self._broken_off >= _DOUBTFUL and self._keys is not None:
                    self.doubt = "every handshake is broken off; is engine.pub the public key of this very engine?"
        return made

    def check(self) -> None:
        """Raise where the engine does not let this client in, as far as :meth:`look` has seen.

        Raises:
            ShutOutError: saying why, and what to do.
        """
        if self.shut:
            raise ShutOutError(f"{self._address}: {self.shut}")

    def close(self) -> None:
        """Stop watching, and close the socket; once more does nothing."""
        if not self._socket.closed:
            self._socket.disable_monitor()
            self.monitor.close()
            self._socket.close()

    def _mismatch(self, value: int) -> None:
        if value != zmq.PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH:
            return
        if self._keys is None:
            self.shut = (
                "the engine asks for a key, and none was given; whoever runs it makes one with `tickfix keys new`; "
                "then start again with it (--key NAME.key, engine.pub beside it)"
            )
        else:
            self.shut = "a key was given, and the engine there asks for none; start again without it"
