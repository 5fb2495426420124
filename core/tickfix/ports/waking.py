"""Wakes the thread that waits in a poll, from any other thread."""

from __future__ import annotations

import socket
from collections import deque
from collections.abc import Callable
from contextlib import suppress

_READ_BYTES = 4_096


class Errands:
    """Things that other threads want done by the one that owns the sockets.

    Attributes:
        wake: to be polled by the owner; readable when there are errands.
    """

    def __init__(self) -> None:
        """Begin with none."""
        self.wake, self._waker = socket.socketpair()
        self.wake.settimeout(0.0)
        self._waker.settimeout(0.0)
        self._errands: deque[Callable[[], None]] = deque()
        self._ringing = False

    def __len__(self) -> int:
        """Return how many wait."""
        return len(self._errands)

    def add(self, errand: Callable[[], None]) -> None:
        """Have ``errand`` run by the owner; from any thread."""
        self._errands.append(errand)
        if not self._ringing:
            self._ringing = True
            # A full buffer is a bell that rings already; a closed one has nobody left to wake.
            with suppress(OSError):
                self._waker.send(b"\0")

    def run(self, most: int) -> None:
        """Run at most ``most`` errands, in the order in which they were added."""
        # The flag goes down first: whoever adds from here on rings again.
        self._ringing = False
        with suppress(BlockingIOError):
            self.wake.recv(_READ_BYTES)
        for _ in range(min(most, len(self._errands))):
            self._errands.popleft()()

    def close(self) -> None:
        """Free the descriptors."""
        self.wake.close()
        self._waker.close()
