"""The two clocks that the ports read, and how they sleep; passed in so that tests can turn them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Clock:
    """Where the time comes from.

    Attributes:
        monotonic_ns: never goes back; durations and limits.
        wall_ns: ns since 1970; when something arrived, for people and journals.
        sleep: lets so many seconds pass.
    """

    monotonic_ns: Callable[[], int] = time.monotonic_ns
    wall_ns: Callable[[], int] = time.time_ns
    sleep: Callable[[float], None] = time.sleep
