"""Taking over from an engine that is just ending."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, TypeVar

from tickfix.api.errors import PortError
from tickfix.journal import JournalLocked

_PATIENCE_S: Final = 3.0

T = TypeVar("T")


def patiently(attempt: Callable[[], T]) -> T:
    """Try for a while: the process that held ports and journal may be dying just now."""
    until = time.monotonic() + _PATIENCE_S
    while True:
        try:
            return attempt()
        except (PortError, JournalLocked):
            if time.monotonic() > until:
                raise
            time.sleep(0.05)
