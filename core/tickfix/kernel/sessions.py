"""Which devices there were, and the message numbers seen in their sessions: what is remembered of each is bounded.

No device is folded here, so whoever sees the same events and ends knows the same duplicates, in another process too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice
from typing import Final

from tickfix.api.events import Event
from tickfix.kernel.intake import Sequence
from tickfix.kernel.snapshot import SessionSnapshot

_SESSIONS: Final = 16
_SESSIONS_OF_RETIRED: Final = 2
_RETIRED: Final = 16_384


class Sessions:
    """Message numbers by device and session, and the devices that are retired."""

    def __init__(self) -> None:
        """Begin with nothing seen."""
        self._numbers: dict[str, dict[str, Sequence]] = {}
        self._retired: dict[str, int] = {}

    def enter(self, event: Event) -> tuple[bool, Sequence | None]:
        """Take note of an event's number.

        Returns:
            Whether it comes for the first time, and the numbers of its session; None for an event without a number.
        """
        sessions = self._numbers.setdefault(event.device, {})
        if event.seq <= 0:
            return True, None
        numbers = sessions.get(event.session)
        if numbers is None:
            numbers = sessions[event.session] = Sequence()
        if len(sessions) > _SESSIONS:
            del sessions[next(iter(sessions))]
        return numbers.is_new(event.seq), numbers

    def repeats(self, event: Event) -> bool:
        """Tell whether the event would be a duplicate by its number, without taking note of it."""
        numbers = self._numbers.get(event.device, {}).get(event.session)
        return event.seq > 0 and numbers is not None and numbers.has_seen(event.seq)

    def begin(self, device: str) -> int:
        """A device is followed from now on; return the number of its first epoch."""
        return self._retired.pop(device, 0)

    def retire(self, device: str, number: int) -> list[str]:
        """A device is gone; its last two sessions are remembered, and which epoch would be its next.

        Returns:
            The devices that are forgotten for it, those that have been gone for longest.
        """
        self._retired[device] = number
        sessions = self._numbers.get(device, {})
        for session in list(sessions)[:-_SESSIONS_OF_RETIRED]:
            del sessions[session]
        forgotten = list(islice(self._retired, max(0, len(self._retired) - _RETIRED)))
        for oldest in forgotten:
            self.forget(oldest)
        return forgotten

    def forget(self, device: str) -> None:
        """Remember nothing of a device that is gone."""
        self._retired.pop(device, None)
        self._numbers.pop(device, None)

    def lacking(self, devices: Iterable[str]) -> int:
        """Return how many messages of these devices were passed over by later ones and have not come."""
        sessions = (self._numbers.get(device, {}) for device in devices)
        return sum(numbers.lacking for found in sessions for numbers in found.values())

    @property
    def retired(self) -> Mapping[str, int]:
        """The devices that are gone, in the order in which they went, with the number of their next epoch."""
        return self._retired

    def snapshot(self) -> tuple[SessionSnapshot, ...]:
        """Return the numbers as values, device by device."""
        return tuple(
            SessionSnapshot(device, session, numbers.highest, numbers.gaps, numbers.reached)
            for device, sessions in self._numbers.items()
            for session, numbers in sessions.items()
        )

    def restore(self, sessions: Iterable[SessionSnapshot], retired: Iterable[tuple[str, int]]) -> None:
        """Become what a snapshot says."""
        for seen in sessions:
            numbers = Sequence(seen.highest, seen.gaps, seen.reached)
            self._numbers.setdefault(seen.device, {})[seen.session] = numbers
        self._retired = dict(retired)
