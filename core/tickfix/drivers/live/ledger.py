"""What the loop writes down, in the order in which it happened: to the journal, and to engines that follow."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tickfix.api import Event
from tickfix.drivers.live.saying import Saying
from tickfix.journal import JournalCrowded, JournalWriter, Kind
from tickfix.ports import Hub
from tickfix.wire.decisions import Decision, encode_decision

_ROUNDS: Final = 200
"""Rounds until a segment that could not be begun is tried again."""


class Ledger:
    """Numbers and keeps events, decisions and estimates; nothing is said to anyone before :meth:`commit`.

    Args:
        journal: None keeps nothing, and only numbers.
        hub: through which others follow.

    Attributes:
        problem: why a new segment that is due could not be begun; empty when all is well.
    """

    def __init__(self, journal: JournalWriter | None, hub: Hub) -> None:
        """Begin where the journal does."""
        self._journal = journal
        self._hub = hub
        self._number = 0
        self._followed: list[tuple[bytes, int, bytes]] = []
        self._put_off = 0
        self.problem = ""

    def event(self, event: Event, body: bytes) -> int:
        """Write down an event, whose canonical bytes are ``body``, and return its number."""
        number = self._append(Kind.EVENT, event.device, event.t_ns, body)
        self._followed.append((b"event", number, body))
        return number

    def decision(self, decision: Decision, device: str, t_ns: int) -> None:
        """Write down a decision about a device."""
        payload = encode_decision(decision)
        number = self._append(Kind.DECISION, device, t_ns, payload)
        self._followed.append((b"decision", number, payload))

    def estimate(self, said: Saying) -> None:
        """Write down an estimate."""
        kind = Kind.REVISION if said.revision else Kind.ESTIMATE
        self._append(kind, said.device, said.t_ns, said.body)

    def commit(self) -> int:
        """Make what was written down survive this process, show it to those who follow, and return the last number.

        Raises:
            JournalFull: when there is no room; what was written down waits for the next try.
            JournalError: when the journal cannot be written.
        """
        if self._journal is not None:
            self._journal.commit()
        followed, self._followed = self._followed, []
        if followed:
            self._hub.follow(followed)
        return self._number

    def cut(self, snapshot: Callable[[], bytes]) -> None:
        """Begin a new segment where the journal wants one; without a snapshot the old one goes on.

        Raises:
            JournalFull, JournalError: when the new segment cannot be written.
        """
        if self._journal is None or not self._journal.wants_segment():
            return
        if self._put_off > 0:
            self._put_off -= 1
            return
        try:
            kept = snapshot()
        except Exception as error:  # noqa: BLE001 - the loop must not end for want of a shorter way to resume
            self._put_off = _ROUNDS
            self.problem = f"no snapshot could be made, so no new segment: {type(error).__name__}: {error}"
            return
        try:
            self._journal.new_segment(kept)
        except JournalCrowded as error:
            # Connections have taken all file descriptors; what is open goes on until they are gone.
            self._put_off = _ROUNDS
            self.problem = str(error)
            return
        self.problem = ""

    def when_durable(self, number: int, then: Callable[[], None]) -> None:
        """Have ``then`` called once every record up to ``number`` is on the disk; at once without a journal."""
        if self._journal is None:
            then()
        else:
            self._journal.when_durable(number, then)

    @property
    def is_dirty(self) -> bool:
        """Something was written down since the last commit."""
        return bool(self._followed) or (self._journal is not None and self._journal.pending > 0)

    def status(self) -> dict[str, int | str]:
        """Return what an operator wants to know of the journal; empty without one."""
        if self._journal is None:
            return {}
        return {
            "segment": str(self._journal.path),
            "records": self._journal.next_number - 1,
            "durable": self._journal.durable,
            "pending": self._journal.pending,
            **({"problem": self.problem} if self.problem else {}),
        }

    def close(self) -> None:
        """Commit and close the journal."""
        if self._journal is not None:
            self._journal.close()

    def _append(self, kind: Kind, device: str, t_ns: int, payload: bytes) -> int:
        if self._journal is None:
            self._number += 1
        else:
            self._number = self._journal.append(kind, device, t_ns, payload)
        return self._number
