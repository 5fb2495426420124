"""What this package offers to tickfix: the entry point in pyproject.toml names this module."""

from __future__ import annotations

from tickfix.api import hookimpl
from tickfix_alpha_beta.alpha_beta import AlphaBeta

TICKFIX_API = 1


@hookimpl
def tickfix_register() -> list[type]:
    """Offer the filter."""
    return [AlphaBeta]
