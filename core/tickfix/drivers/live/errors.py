"""What can go wrong with an engine as a whole."""

from __future__ import annotations

from tickfix.api import TickfixError


class EngineError(TickfixError):
    """An engine that cannot begin or go on."""


class OverrunError(EngineError):
    """An engine that was told to end when it falls behind, and did."""
