"""What became of a message: exactly one outcome each, so that messages in = sum of outcomes."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from typing import Final


class Outcome(StrEnum):
    """The answer to a message."""

    ACCEPTED = "accepted"
    """In the timeline, or held until the clock it shows is confirmed."""
    LATE = "late"
    """In the timeline, behind a tick that was closed already: the past is revised."""
    STALE = "stale"
    """Beyond the horizon: not used."""
    DUPLICATE = "duplicate"
    """Seen before."""
    MALFORMED = "malformed"
    """Nothing in it can be used."""
    UNAUTHORISED = "unauthorised"
    BUSY = "busy"
    THROTTLED = "throttled"
    UNKNOWN = "unknown"


_REMEMBERED: Final = 4096
_LEAP: Final = 1_000_000


class Sequence:
    """Recognises duplicates among a session's numbered messages, in whatever order they come.

    It remembers which numbers below the highest are missing; a number that is neither missing nor new was seen before.
    Numbers more than 4096 below the highest count as seen. A session may start anywhere, but a number that later
    leaps by over a million is not believed: it counts as new and changes nothing, for else all after it would count as
    seen.

    Attributes:
        reached: the highest number of a message that took the device's clock further. What has a lower one was sent
            before, however late it comes.
    """

    __slots__ = ("_highest", "_missing", "reached")

    def __init__(self, highest: int = 0, missing: Iterable[int] = (), reached: int = 0) -> None:
        """Begin with what was seen."""
        self._highest = highest
        self.reached = reached
        self._missing: dict[int, None] = dict.fromkeys(missing)

    def is_new(self, seq: int) -> bool:
        """Take note of ``seq``, counted from 1, and tell whether it comes for the first time."""
        if self._highest and seq > self._highest + _LEAP:
            return True
        if seq > self._highest:
            self._missing.update(dict.fromkeys(range(max(self._highest + 1, seq - _REMEMBERED), seq)))
            self._highest = seq
            while len(self._missing) > _REMEMBERED:
                del self._missing[next(iter(self._missing))]
            return True
        return self._missing.pop(seq, seq) is None

    def has_seen(self, seq: int) -> bool:
        """Tell whether ``seq`` would count as seen, without taking note of it."""
        return seq <= self._highest and seq not in self._missing

    @property
    def highest(self) -> int:
        """The highest number seen."""
        return self._highest

    @property
    def gaps(self) -> int:
        """How many of the last numbers below the highest have not come."""
        return len(self._missing)

    @property
    def missing(self) -> tuple[int, ...]:
        """The numbers that are missing among the last ones."""
        return tuple(self._missing)
