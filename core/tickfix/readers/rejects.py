"""The account of what a reader could not use: counted by reason, the first few described."""

from __future__ import annotations

from collections import Counter
from typing import Final

DESCRIBED: Final = 20
"""How many problems are described; all are counted."""


class Rejects:
    """Counts what is rejected while one file is read."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._problems: list[str] = []

    def add(self, reason: str, line: int, found: object) -> None:
        """Count one rejection at ``line`` (from 1), where ``found`` stood: bytes of the file, or a description."""
        self._counts[reason] += 1
        if len(self._problems) < DESCRIBED:
            text = repr(found.decode("utf-8", "replace")) if isinstance(found, bytes) else str(found)
            self._problems.append(f"line {line}: {reason}: found {text if len(text) <= 120 else text[:117] + '…'}")

    @property
    def counts(self) -> dict[str, int]:
        """Rejections by reason, reasons in alphabetical order."""
        return dict(sorted(self._counts.items()))

    @property
    def problems(self) -> tuple[str, ...]:
        """The first few, in the order they were met."""
        return tuple(self._problems)
