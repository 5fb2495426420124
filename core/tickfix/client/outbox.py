"""Messages that were not acknowledged yet: what to send now, what again, and when it is too much. Pure, no sockets."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

WINDOW: Final = 24
"""Numbers that may be under way at once.

An engine holds at least 32 answers for a connection that does not read at the moment, and those beyond are lost; so
that many messages, and a greeting, may wait for theirs. It is also far below the 4096 numbers that an engine remembers,
so that whatever is sent again is known as new or as a duplicate, never too old to tell.
"""

_PATIENCE_FACTOR: Final = 2.0
_MOST_PATIENCE: Final = 16.0


@dataclass(slots=True)
class _Kept:
    data: bytes
    due_s: float
    patience: float = 1.0


class Outbox:
    """Keeps numbered messages until they are acknowledged.

    Args:
        most_messages, most_bytes: how much is kept.
        resend_s: how long to wait for an acknowledgement; doubled with every try of a message, up to 16 times.
    """

    def __init__(self, most_messages: int, most_bytes: int, resend_s: float) -> None:
        """Begin empty."""
        self._kept: OrderedDict[int, _Kept] = OrderedDict()
        self._bytes = 0
        self._most_messages = most_messages
        self._most_bytes = most_bytes
        self._resend_s = resend_s

    def __len__(self) -> int:
        """Return the number of messages kept."""
        return len(self._kept)

    def __contains__(self, seq: int) -> bool:
        """Whether this number is not acknowledged yet."""
        return seq in self._kept

    @property
    def kept_bytes(self) -> int:
        """Bytes kept."""
        return self._bytes

    def fits(self, n_bytes: int) -> bool:
        """Whether a message of this length can be kept beside the others."""
        return len(self._kept) < self._most_messages and self._bytes + n_bytes <= self._most_bytes

    def keep(self, seq: int, data: bytes) -> None:
        """Keep a message; it is due at once. Numbers come in ascending order."""
        self._kept[seq] = _Kept(data, 0.0)
        self._bytes += len(data)

    def forget(self, seq: int) -> bool:
        """Let go of a message; False when it was not kept."""
        kept = self._kept.pop(seq, None)
        if kept is None:
            return False
        self._bytes -= len(kept.data)
        return True

    def oldest(self) -> int:
        """Return the lowest number kept."""
        return next(iter(self._kept))

    def due(self, now_s: float) -> list[tuple[int, bytes]]:
        """Return what is to be sent now, lowest number first, of the window that begins at the oldest."""
        found = []
        if self._kept:
            end = self.oldest() + WINDOW
            for seq, kept in self._kept.items():
                if seq >= end:
                    break
                if kept.due_s <= now_s:
                    found.append((seq, kept.data))
        return found

    def next_due_s(self) -> float | None:
        """Return when something is due again, None where nothing is kept."""
        if not self._kept:
            return None
        end = self.oldest() + WINDOW
        return min(kept.due_s for seq, kept in self._kept.items() if seq < end)

    def sent(self, seq: int, now_s: float) -> None:
        """Take note that a message went out: it is due again when its patience is over."""
        kept = self._kept[seq]
        kept.due_s = now_s + self._resend_s * kept.patience
        kept.patience = min(kept.patience * _PATIENCE_FACTOR, _MOST_PATIENCE)

    def refused_for_now(self, seq: int, now_s: float) -> None:
        """Take note that the engine was busy: this message waits its turn."""
        kept = self._kept.get(seq)
        if kept is not None:
            kept.due_s = now_s + self._resend_s

    def all_due(self) -> None:
        """Make everything due: the connection is a new one, and what was under way on the old one may be lost."""
        for kept in self._kept.values():
            kept.due_s = 0.0
            kept.patience = 1.0
