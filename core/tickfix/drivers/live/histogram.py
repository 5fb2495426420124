"""Durations as a histogram of fixed size: quantiles of months of ticks in a few hundred numbers."""

from __future__ import annotations

import math
from typing import Final

_PER_DECADE: Final = 40
_SMALLEST_MS: Final = 1e-3
_BUCKETS: Final = 11 * _PER_DECADE + 2


class Histogram:
    """Counts durations in buckets that grow by 6 %, from a microsecond to a day; quantiles are as exact as that."""

    __slots__ = ("_buckets", "count", "max_ms")

    def __init__(self) -> None:
        """Begin empty."""
        self._buckets = [0] * _BUCKETS
        self.count = 0
        self.max_ms = 0.0

    def add(self, ms: float) -> None:
        """Count a duration; one below zero counts as zero."""
        place = 0 if ms < _SMALLEST_MS else 1 + int(math.log10(ms / _SMALLEST_MS) * _PER_DECADE)
        self._buckets[min(place, _BUCKETS - 1)] += 1
        self.count += 1
        self.max_ms = max(self.max_ms, ms)

    def quantile_ms(self, q: float) -> float:
        """Return the upper end of the bucket in which the quantile lies, at most the greatest; 0 when empty."""
        wanted, seen = q * self.count, 0
        for place, n in enumerate(self._buckets):
            seen += n
            if n and seen >= wanted and place == _BUCKETS - 1:
                return self.max_ms
            if n and seen >= wanted:
                return min(self.max_ms, _SMALLEST_MS * 10 ** (place / _PER_DECADE))
        return 0.0

    def summary(self) -> dict[str, float]:
        """Return p50, p99 and max in milliseconds, and the count."""
        return {
            "p50": self.quantile_ms(0.5),
            "p99": self.quantile_ms(0.99),
            "max": self.max_ms,
            "count": self.count,
        }
