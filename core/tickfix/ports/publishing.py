"""Sends to whoever listens, and never waits for any of them."""

from __future__ import annotations

from typing import Final, cast

import zmq

_LAST: Final = int(zmq.NOBLOCK)
_MORE: Final = int(zmq.NOBLOCK | zmq.SNDMORE)
"""Plain numbers: joining flags for every frame takes longer than handing the frame over."""

_EVENTS: Final = int(zmq.EVENTS)
_POLLIN: Final = int(zmq.POLLIN)
_AT_ONCE: Final = 1_000
_PREFIXES: Final = 32
_EVERYTHING: Final = (b"",)


class Publisher:
    """An XPUB socket that drops for slow listeners only, and counts how often that began.

    libzmq drops for a listener whose queue is full without a word. Asked not to drop, it refuses a message once some
    queue has filled up; sent again with leave to drop, the message reaches everyone else. From then on that listener is
    left out, unseen, until it has read enough. So ``stalls`` counts how often a listener fell behind, not how many
    messages it missed: those it sees itself, by their sequence.

    What nobody has ever subscribed to is not handed to libzmq: that would be three frames for nothing, and with each of
    them the interpreter's lock may change hands. Subscriptions count from the next call of :meth:`subscriptions` on.
    That listeners leave is not looked at, since libzmq also passes on what one unsubscribes from and never had.

    Attributes:
        sent: messages published, whether or not somebody listens.
        sent_bytes: their bodies' bytes.
        stalls: how often a listener's queue was found full.
    """

    def __init__(self, socket: zmq.Socket[bytes]) -> None:
        """Publish on ``socket``, a bound XPUB."""
        self.use(socket)
        self.sent = 0
        self.sent_bytes = 0
        self.stalls = 0

    def use(self, socket: zmq.Socket[bytes]) -> None:
        """Publish on this socket from now on."""
        self._socket = socket
        self._prefixes: tuple[bytes, ...] = ()
        socket.setsockopt(zmq.XPUB_VERBOSE, 1)
        socket.setsockopt(zmq.XPUB_NODROP, 1)

    def send(self, frames: tuple[bytes, bytes, bytes]) -> None:
        """Publish one message: topic, envelope, body."""
        if frames[0].startswith(self._prefixes):
            try:
                self._send(frames)
            except zmq.Again:
                self.stalls += 1
                self._socket.setsockopt(zmq.XPUB_NODROP, 0)
                self._send(frames)
                self._socket.setsockopt(zmq.XPUB_NODROP, 1)
        self.sent += 1
        self.sent_bytes += len(frames[-1])

    def _send(self, frames: tuple[bytes, bytes, bytes]) -> None:
        topic, envelope, body = frames
        send = self._socket.send
        send(topic, _MORE)
        send(envelope, _MORE)
        send(body, _LAST)

    def subscriptions(self) -> set[bytes]:
        """Return the topics that listeners have subscribed to since the last call; to be called before :meth:`send`."""
        topics: set[bytes] = set()
        if not cast(int, self._socket.getsockopt(_EVENTS)) & _POLLIN:
            return topics
        for _ in range(_AT_ONCE):
            try:
                frame = self._socket.recv(_LAST)
            except zmq.Again:
                break
            if frame[:1] == b"\x01":
                topics.add(frame[1:])
        else:
            # Some may be unread.
            self._prefixes = _EVERYTHING
        self._subscribed(topics)
        return topics

    def _subscribed(self, topics: set[bytes]) -> None:
        prefixes = topics.union(self._prefixes)
        self._prefixes = tuple(prefixes) if len(prefixes) <= _PREFIXES else _EVERYTHING
