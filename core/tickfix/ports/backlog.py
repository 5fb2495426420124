"""What waits to be published: bounded, and published a chunk at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

from tickfix.ports.waking import Errands

_CHUNK: Final = 64
_WAITING: Final = 200_000


class Backlog:
    """Hands publications to the thread of the ports, so that incoming messages get their turns in between.

    Attributes:
        discarded: publications given up because too many waited; that happens only when the thread is stuck.
    """

    def __init__(self, errands: Errands) -> None:
        """Begin with nothing."""
        self._errands = errands
        self._lock = threading.Lock()
        self._waiting = 0
        self.discarded = 0

    def add(self, items: Sequence[Any], publish: Callable[[Sequence[Any]], None]) -> None:
        """Have ``publish`` called with all items, in order, on the thread of the ports."""
        with self._lock:
            taken = items[: _WAITING - self._waiting]
            self._waiting += len(taken)
            self.discarded += len(items) - len(taken)
        for begin in range(0, len(taken), _CHUNK):
            self._errands.add(partial(self._publish, publish, taken[begin : begin + _CHUNK]))

    def _publish(self, publish: Callable[[Sequence[Any]], None], chunk: Sequence[Any]) -> None:
        with self._lock:
            self._waiting -= len(chunk)
        publish(chunk)
