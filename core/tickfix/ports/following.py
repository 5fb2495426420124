"""The follow port: accepted events and decisions, the very bytes of the journal, for engines that follow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, TypeAlias

import zmq

from tickfix.ports.publishing import Publisher
from tickfix.wire import VERSION
from tickfix.wire.replies import FollowEnvelope, encode

Record: TypeAlias = tuple[bytes, int, bytes]
"""Kind (``b"event"`` or ``b"decision"``), number in the journal, bytes."""

KINDS: Final = (b"event", b"decision")


class Following:
    """Publishes records; an engine that falls behind sees by ``seq`` that it missed some, and nobody waits for it."""

    def __init__(self, socket: zmq.Socket[bytes], *, run: str) -> None:
        """Serve ``socket``, a bound XPUB."""
        self.publisher = Publisher(socket)
        self._run = run
        self._seq = 0

    def publish(self, records: Sequence[Record]) -> None:
        """Send records in this order."""
        self.serve()
        for kind, number, body in records:
            self._seq += 1
            envelope = FollowEnvelope(v=VERSION, run=self._run, number=number, seq=self._seq)
            self.publisher.send((kind, encode(envelope), body))

    def serve(self) -> None:
        """Drop what subscribers say: there are no last values here."""
        self.publisher.subscriptions()
