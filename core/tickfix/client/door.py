"""Whether an engine lets a client in: what libzmq notes about the handshakes of a socket."""

from __future__ import annotations

from typing import Final

import zmq
from zmq.utils.monitor import parse_monitor_message

from tickfix.client.connection import Keys, readable

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
    """Watches one socket, from before it connects.

    Args:
        socket: of a client.
        keys: that it has, None for none.

    Attributes:
        monitor: to be polled beside the socket; when it is readable, :meth:`look`.
        connected: a connection stands.
        shut: why the engine does not let this client in, whatever it tries, and what to do; else empty.
        doubt: why that may be so; else empty.
    """

    def __init__(self, socket: zmq.Socket[bytes], keys: Keys | None) -> None:
        """Begin to watch."""
        self._socket = socket
        self._keys = keys
        self._broken_off = 0
        self.connected = False
        self.shut = ""
        self.doubt = ""
        self.monitor = socket.get_monitor_socket(_EVENTS)
        self.monitor.linger = 0

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

    def close(self) -> None:
        """Stop watching; before the socket is closed."""
        self._socket.disable_monitor()
        self.monitor.close()

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
