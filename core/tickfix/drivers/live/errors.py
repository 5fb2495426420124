"""What can go wrong with an engine as a whole."""

from __future__ import annotations

from tickfix.api import TickfixError


class EngineError(TickfixError):
    """An engine that cannot begin or go on."""


class WorkerError(EngineError):
    """A worker process of an engine is gone, and with it what it had folded; the journal has all of it.

    Attributes:
        signal: that ended it, 0 if none did.
    """

    def __init__(self, text: str, signal: int = 0) -> None:
        """Say how it ended."""
        super().__init__(text)
        self.signal = signal


class OverrunError(EngineError):
    """An engine that was told to end when it falls behind, and did."""
