"""What became of a message, and the message numbers per session by which duplicates are recognised.

Exactly one outcome each, so that messages in = sum of outcomes. What is remembered of each device is bounded. No device
is folded here, so whoever sees the same events and closures knows the same duplicates, in another process too."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum
from itertools import islice
from typing import Final

from tickfix.api.events import Event
from tickfix.kernel.snapshot import SessionSnapshot


class MessageOutcome(StrEnum):
    """What the kernel did with a message; what a port refuses never reaches it, see ``tickfix.wire.ReplyOutcome``."""

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


_WINDOW_LENGTH: Final = 4096
_WINDOW_MASK: Final = (1 << _WINDOW_LENGTH) - 1
_MAX_SEQ_JUMP: Final = 1_000_000


class SequenceWindow:
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
        if self._highest and seq > self._highest + _MAX_SEQ_JUMP:
            return True
        ahead = seq - self._highest
        if ahead > 0:
            # Bit k stands for the number k + 1 below the highest; those between are missing.
            passed = min(ahead, _WINDOW_LENGTH + 1)
            self._missing = (self._missing << passed | (1 << (passed - 1)) - 1) & _WINDOW_MASK
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
    def missing_count(self) -> int:
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


_MAX_SESSIONS: Final = 16
_SESSIONS_KEPT_ON_CLOSE: Final = 2
_MAX_CLOSED_DEVICES: Final = 16_384


class SessionRegistry:
    """Message numbers by device and session, and the devices that are retired."""

    def __init__(self) -> None:
        """Begin with nothing seen."""
        self._numbers: dict[str, dict[str, SequenceWindow]] = {}
        self._closed_devices: dict[str, int] = {}

    def enter(self, event: Event) -> tuple[bool, SequenceWindow | None]:
        """Take note of an event's number.

        Returns:
            Whether it comes for the first time, and the numbers of its session; None for an event without a number.
        """
        sessions = self._numbers.setdefault(event.device, {})
        if event.seq <= 0:
            return True, None
        numbers = sessions.get(event.session)
        if numbers is None:
            numbers = sessions[event.session] = SequenceWindow()
        if len(sessions) > _MAX_SESSIONS:
            del sessions[next(iter(sessions))]
        return numbers.is_new(event.seq), numbers

    def is_duplicate(self, event: Event) -> bool:
        """Tell whether the event would be a duplicate by its number, without taking note of it."""
        numbers = self._numbers.get(event.device, {}).get(event.session)
        return event.seq > 0 and numbers is not None and numbers.has_seen(event.seq)

    def begin(self, device: str) -> int:
        """A device is followed from now on; return the number of its first epoch."""
        return self._closed_devices.pop(device, 0)

    def close(self, device: str, number: int) -> list[str]:
        """A device is gone; its last two sessions are remembered, and which epoch would be its next.

        Returns:
            The devices that are forgotten for it, those that have been gone for longest.
        """
        self._closed_devices[device] = number
        sessions = self._numbers.get(device, {})
        for session in list(sessions)[:-_SESSIONS_KEPT_ON_CLOSE]:
            del sessions[session]
        forgotten = list(islice(self._closed_devices, max(0, len(self._closed_devices) - _MAX_CLOSED_DEVICES)))
        for oldest in forgotten:
            self.forget(oldest)
        return forgotten

    def forget(self, device: str) -> None:
        """Remember nothing of a device that is gone."""
        self._closed_devices.pop(device, None)
        self._numbers.pop(device, None)

    def missing_count(self, devices: Iterable[str]) -> int:
        """Return how many messages of these devices were passed over by later ones and have not come."""
        sessions = (self._numbers.get(device, {}) for device in devices)
        return sum(numbers.missing_count for found in sessions for numbers in found.values())

    @property
    def closed_devices(self) -> Mapping[str, int]:
        """The devices that are gone, in the order in which they went, with the number of their next epoch."""
        return self._closed_devices

    def snapshot(self) -> tuple[SessionSnapshot, ...]:
        """Return the numbers as values, device by device."""
        return tuple(
            SessionSnapshot(device, session, numbers.highest, numbers.gaps, numbers.reached)
            for device, sessions in self._numbers.items()
            for session, numbers in sessions.items()
        )

    def restore(self, sessions: Iterable[SessionSnapshot], closed_devices: Iterable[tuple[str, int]]) -> None:
        """Become what a snapshot says."""
        for seen in sessions:
            numbers = SequenceWindow(seen.highest, seen.gaps, seen.reached)
            self._numbers.setdefault(seen.device, {})[seen.session] = numbers
        self._closed_devices = dict(closed_devices)
