"""What became of a message: exactly one outcome each, so that messages in = sum of outcomes."""

from __future__ import annotations

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
_ALL: Final = (1 << _REMEMBERED) - 1
_LEAP: Final = 1_000_000


class Sequence:
    """Recognises duplicates among a session's numbered messages, in whatever order they come.

    It remembers which of the 4096 numbers below the highest are missing, a bit for each; a number that is neither
    missing nor new was seen before, and so, it is assumed, were all below those. A session may start anywhere, but a
    number that later leaps by over a million is not believed: it counts as new and changes nothing, for else all after
    it would count as seen.

    Attributes:
        reached: the highest number of a message that took the device's clock further. What has a lower one was sent
            before, however late it comes.
    """

    __slots__ = ("_highest", "_missing", "reached")

    def __init__(self, highest: int = 0, gaps: bytes = b"", reached: int = 0) -> None:
        """Begin with what was seen, see :attr:`gaps`."""
        self._highest = highest
        self._missing = int.from_bytes(gaps, "little")
        self.reached = reached

    def is_new(self, seq: int) -> bool:
        """Take note of ``seq``, counted from 1, and tell whether it comes for the first time."""
        if self._highest and seq > self._highest + _LEAP:
            return True
        ahead = seq - self._highest
        if ahead > 0:
            # Bit k stands for the number k + 1 below the highest; those between are missing.
            passed = min(ahead, _REMEMBERED + 1)
            self._missing = (self._missing << passed | (1 << (passed - 1)) - 1) & _ALL
            self._highest = seq
            return True
        if self.has_seen(seq):
            return False
        self._missing ^= 1 << (-ahead - 1)
        return True

    def has_seen(self, seq: int) -> bool:
        """Tell whether ``seq`` would count as seen, without taking note of it."""
        below = self._highest - seq
        return below == 0 or (below > 0 and not self._missing >> (below - 1) & 1)

    @property
    def highest(self) -> int:
        """The highest number seen."""
        return self._highest

    @property
    def lacking(self) -> int:
        """How many of the last numbers below the highest have not come."""
        return self._missing.bit_count()

    @property
    def missing(self) -> tuple[int, ...]:
        """The numbers that are missing among the last ones."""
        bits = self._missing
        return tuple(self._highest - k - 1 for k in reversed(range(bits.bit_length())) if bits >> k & 1)

    @property
    def gaps(self) -> bytes:
        """The same as bits, little-endian: bit k is set when the number k + 1 below the highest is missing."""
        return self._missing.to_bytes((self._missing.bit_length() + 7) // 8, "little")
