"""What an engine has to say waits here until the journal has it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from tickfix.drivers.live.ledger import Ledger
from tickfix.journal import JournalFull
from tickfix.kernel import Outcome
from tickfix.ports import Hub, Incoming, Said

_RETRY_NS: Final = 1_000_000_000


class Outbox:
    """Publishes and acknowledges after each commit; when the disk is full it waits, and nothing new is let in.

    Args:
        on_disk: acknowledgements wait for the disk, not only for the commit.
        tell: told, in a sentence, what an operator must know.
    """

    def __init__(self, hub: Hub, ledger: Ledger, *, on_disk: bool, tell: Callable[[str], None]) -> None:
        """Begin with nothing to say."""
        self._hub = hub
        self._ledger = ledger
        self._on_disk = on_disk
        self._tell = tell
        self._said: list[Said] = []
        self._answers: list[tuple[Incoming, Outcome, str]] = []
        self._tried_ns = 0
        self.full = ""

    def say(self, said: Said) -> None:
        """Publish this after the next commit."""
        self._said.append(said)

    def answer(self, item: Incoming, outcome: Outcome, detail: str = "") -> None:
        """Acknowledge this after the next commit."""
        self._answers.append((item, outcome, detail))

    def flush(self, snapshot: Callable[[], bytes], now_ns: int) -> None:
        """Commit, then say what waits.

        Args:
            snapshot: makes the first record of a new segment, where the journal wants one.
            now_ns: monotonic.

        Raises:
            JournalError: when the journal cannot be written for another reason than a full disk.
        """
        if self.full and now_ns - self._tried_ns < _RETRY_NS:
            return
        self._tried_ns = now_ns
        try:
            number = self._ledger.commit()
            self._ledger.cut(snapshot)
        except JournalFull as error:
            if not self.full:
                self._tell(f"{error}. Intake has stopped; it goes on by itself when there is room.")
            self.full = f"the journal is full: {error}"
            self._hub.refuse_all(self.full)
            return
        if self.full:
            self.full = ""
            self._hub.refuse_all(None)
            self._tell("there is room for the journal again: intake goes on")
        said, self._said = self._said, []
        answers, self._answers = self._answers, []
        if said:
            self._hub.publish(said)
        if answers and self._on_disk:
            self._ledger.when_durable(number, lambda: self._acknowledge(answers))
        elif answers:
            self._acknowledge(answers)

    def _acknowledge(self, answers: Sequence[tuple[Incoming, Outcome, str]]) -> None:
        for item, outcome, detail in answers:
            self._hub.answer(item, outcome, detail)
