"""What is compared: a figure of many errors, computed for many weightings of them at once.

A bootstrap replicate counts some chains several times and others never; a permutation takes some chains' errors from
one pipeline and some from the other. Both are weights on the errors, so each quantity is written once, for weights.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tickfix.api import Floats, Ints

_BLOCK = 4_000_000

Counts: TypeAlias = NDArray[np.integer[Any]]


class Quantity(Protocol):
    """A figure of errors, metres."""

    def of(self, errors_m: Floats, chain: Ints, weights: Counts) -> Floats:
        """Return the figure for each of r weightings.

        Args:
            errors_m: (n,).
            chain: (n,) numbers of the chains, below c.
            weights: (r, c) how often the errors of a chain count; in each row some do.

        Returns:
            (r,) metres.
        """
        ...


@dataclass(frozen=True, slots=True)
class Power:
    """The root of the mean of a power of the errors: the mean for 1, the root mean square for 2."""

    exponent: int

    def of(self, errors_m: Floats, chain: Ints, weights: Counts) -> Floats:
        """Return (Σ w eᵖ / Σ w)^(1/p) by sums over chains."""
        chains = weights.shape[1]
        sums = np.bincount(chain, weights=errors_m**self.exponent, minlength=chains)
        sizes = np.bincount(chain, minlength=chains)
        # Only matrices of floats are multiplied by BLAS; sizes stay exact.
        totals = weights.astype(np.float64) @ np.stack([sums, sizes], axis=1)
        mean: Floats = totals[:, 0] / totals[:, 1]
        return mean if self.exponent == 1 else mean ** (1.0 / self.exponent)


@dataclass(frozen=True, slots=True)
class Quantile:
    """A percentile, interpolated as in :class:`~tickfix.evaluation.figures.Figures`."""

    percent: float

    def of(self, errors_m: Floats, chain: Ints, weights: Counts) -> Floats:
        """Return the value at index q·(Σw − 1) of the sorted errors, each repeated as often as it counts."""
        order = np.argsort(errors_m, kind="stable")
        ordered, chain = errors_m[order], chain[order]
        rows = max(1, _BLOCK // max(1, len(order)))
        blocks = [self._block(ordered, weights[i : i + rows][:, chain]) for i in range(0, len(weights), rows)]
        return np.concatenate(blocks)

    def _block(self, ordered: Floats, weights: Counts) -> Floats:
        reached = np.cumsum(weights, axis=1, dtype=np.int32)
        index = self.percent / 100.0 * (reached[:, -1] - 1)
        low = np.floor(index)
        below = ordered[np.argmax(reached > low[:, np.newaxis], axis=1)]
        above = ordered[np.argmax(reached > np.ceil(index)[:, np.newaxis], axis=1)]
        return np.asarray(below + (above - below) * (index - low))


QUANTITIES: Final[Mapping[str, Quantity]] = MappingProxyType(
    {
        "mean": Power(1),
        "median": Quantile(50),
        "p75": Quantile(75),
        "p90": Quantile(90),
        "p95": Quantile(95),
        "rmse": Power(2),
    }
)
"""By the names under which comparisons report them."""
