"""Takes messages off a ROUTER: one body each, from DEALER and REQ alike, however many frames a hostile peer sends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import zmq

_KEPT: Final = 3


@dataclass(frozen=True, slots=True)
class Letter:
    """One message as it came.

    Attributes:
        head: the routing id, with what libzmq knows about the connection.
        body: its one body; None when there were more frames than that, or none.
        delimited: an empty frame stood before the body.
        frames: how many frames there were, without the routing id.
        n_bytes: of those frames together.
    """

    head: zmq.Frame
    body: bytes | None
    delimited: bool
    frames: int
    n_bytes: int


def receive(socket: zmq.Socket[bytes]) -> Letter | None:
    """Return the next message, or None when there is none now.

    Frames beyond those that a message may have are dropped as they are read, never kept.
    """
    try:
        head = socket.recv(zmq.NOBLOCK, copy=False)
    except zmq.Again:
        return None
    kept: list[bytes] = []
    count = n_bytes = 0
    more = head.more
    while more:
        # The parts of a message arrive together, so that this never waits.
        frame = socket.recv(copy=False)
        more = frame.more
        count += 1
        n_bytes += len(frame)
        if count < _KEPT:
            kept.append(frame.bytes)
    delimited = count > 0 and kept[0] == b""
    if delimited and count == 2:
        return Letter(head, kept[1], delimited=True, frames=count, n_bytes=n_bytes)
    if count == 1:
        # A lone empty frame is a body, and no message.
        return Letter(head, kept[0], delimited=False, frames=count, n_bytes=n_bytes)
    return Letter(head, None, delimited=delimited, frames=count, n_bytes=n_bytes)
