"""What can go wrong with an engine as a whole."""

from __future__ import annotations

from tickfix.api import TickfixError


class EngineError(TickfixError):
    """An engine that cannot begin or go on."""


class WorkerError(EngineError):
    """A worker process of an engine is gone, and with it what it had folded; the journal has all of it."""
