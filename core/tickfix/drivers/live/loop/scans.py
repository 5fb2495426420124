"""Scans on their way through being located: each device's one after the other, since each stands in the next window."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from tickfix.api import Event, Scan
from tickfix.drivers.live.locating import Located
from tickfix.ports import Incoming
from tickfix.wire.decisions import Drop, Fold

_MOST_OF_DEVICE: Final = 256
_MOST: Final = 4_096


class Locating(Protocol):
    """Whoever locates scans beside the loop."""

    def ask(self, number: int, scan: Scan) -> None:
        """Begin to locate the scan of record ``number``."""

    def done(self) -> Sequence[Located]:
        """Return what was located or given up since the last call."""

    @property
    def waiting(self) -> int:
        """How many scans are neither."""

    def stop(self) -> None:
        """Let go of what is not done."""


@dataclass(frozen=True, slots=True)
class Decided:
    """What is to become of a scan; ``item`` is the message that brought it, None where nobody waits for an answer."""

    decision: Fold | Drop
    scan: Scan
    item: Incoming | None


class Scans:
    """Remembers the scans that wait for a decision, and asks for those whose turn it is to be located.

    Attributes:
        given_up: scans that could not be located in time.
    """

    def __init__(self, locating: Locating) -> None:
        """Begin with none."""
        self._locating = locating
        self._waiting: dict[int, tuple[Scan, Incoming | None]] = {}
        self._queues: dict[str, deque[int]] = {}
        self._in_flight: set[tuple[str, str, int]] = set()
        self.given_up = 0

    def adopt(self, waiting: Mapping[int, Scan]) -> None:
        """Take over scans that wait since before this process began, by the numbers of their records."""
        for number, scan in waiting.items():
            self.add(number, scan, None)

    def add(self, number: int, scan: Scan, item: Incoming | None) -> None:
        """Have the scan of record ``number`` located."""
        self._waiting[number] = scan, item
        self._in_flight.add((scan.device, scan.session, scan.seq))
        queue = self._queues.setdefault(scan.device, deque())
        queue.append(number)
        if len(queue) == 1:
            self._locating.ask(number, scan)

    def why_not(self, device: str) -> str:
        """Say why no more scans of a device can wait now, if so."""
        waiting = len(self._queues.get(device, ()))
        if waiting >= _MOST_OF_DEVICE or len(self._waiting) >= _MOST:
            return f"{waiting} scans of this device, {len(self._waiting)} in all wait to be located"
        return ""

    def is_in_flight(self, event: Event) -> bool:
        """Tell whether a scan with this number waits."""
        return event.seq > 0 and (event.device, event.session, event.seq) in self._in_flight

    def decided(self) -> list[Decided]:
        """Return those that are located by now, and those that will not be; the next ones get their turns."""
        found = []
        for located in self._locating.done():
            if located.number not in self._waiting:
                continue  # its device is gone
            number, why = located.number, located.reason
            self.given_up += bool(why)
            found.append(self._decide(number, Drop(number=number, reason=why) if why else Fold(number=number)))
            self._next(located.device)
        return found

    def drop(self, device: str, reason: str) -> list[Decided]:
        """Give up all scans of a device that is gone."""
        return [
            self._decide(number, Drop(number=number, reason=reason)) for number in self._queues.pop(device, deque())
        ]

    @property
    def being_located(self) -> int:
        """How many are being located."""
        return self._locating.waiting

    def stop(self) -> None:
        """Ask no more."""
        self._locating.stop()

    def _decide(self, number: int, decision: Fold | Drop) -> Decided:
        scan, item = self._waiting.pop(number)
        self._in_flight.discard((scan.device, scan.session, scan.seq))
        return Decided(decision, scan, item)

    def _next(self, device: str) -> None:
        queue = self._queues[device]
        queue.popleft()
        if queue:
            self._locating.ask(queue[0], self._waiting[queue[0]][0])
        else:
            del self._queues[device]
