"""Statistics of paired errors of two pipelines.

Bootstrap intervals, permutation test, Holm correction, and power, all over chains of walks. docs/compare.md explains
the choices.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from types import MappingProxyType
from typing import Any, Final, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tickfix.api import Bools, Floats, Ints, Rng, frozen


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PairedErrors:
    """The errors of two pipelines at n samples.

    Samples of one walk depend on each other, and so do walks that followed each other without a break. The unit that
    the bootstrap draws and the permutation test swaps is therefore the chain of walks.

    Attributes:
        baseline_m, pipeline_m: (n,) float64, errors, all finite.
        walk, chain: (n,) int64, numbers of the walk and of its chain, consecutive from 0.
    """

    baseline_m: Floats
    pipeline_m: Floats
    walk: Ints
    chain: Ints

    def __post_init__(self) -> None:
        """Freeze the arrays.

        Raises:
            ValueError: when lengths differ or an error is not finite.
        """
        for name in ("baseline_m", "pipeline_m"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        for name in ("walk", "chain"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.int64))
        lengths = {len(self.baseline_m), len(self.pipeline_m), len(self.walk), len(self.chain)}
        if len(lengths) > 1:
            raise ValueError(f"found {sorted(lengths)} values, expected as many of each")
        if not (np.isfinite(self.baseline_m).all() and np.isfinite(self.pipeline_m).all()):
            raise ValueError("found an error that is not finite; compare only where both pipelines have an estimate")

    def __len__(self) -> int:
        """Return n."""
        return len(self.baseline_m)

    @property
    def walks(self) -> int:
        """Number of walks."""
        return int(self.walk.max()) + 1 if len(self) else 0

    @property
    def chains(self) -> int:
        """Number of chains."""
        return int(self.chain.max()) + 1 if len(self) else 0

    @property
    def identical(self) -> bool:
        """Whether all errors are equal, bit for bit."""
        return bool(np.array_equal(self.baseline_m, self.pipeline_m))


def number_labels(labels: Bools | Ints | list[str]) -> Ints:
    """Return for each label (n,) its number in sorted order: (n,) int64."""
    if len(labels) == 0:
        return np.zeros(0, np.int64)
    _, numbers = np.unique(np.asarray(labels), return_inverse=True)
    return np.asarray(numbers.reshape(-1), dtype=np.int64)


_BLOCK_CELLS = 4_000_000

WeightCounts: TypeAlias = NDArray[np.integer[Any]]


class Statistic(Protocol):
    """A statistic of weighted errors, metres."""

    def of(self, errors_m: Floats, chain: Ints, weights: WeightCounts) -> Floats:
        """Return the statistic for each of r weightings.

        Args:
            errors_m: (n,).
            chain: (n,) numbers of the chains, below c.
            weights: (r, c) how often the errors of a chain count; no row is all zero.

        Returns:
            (r,) metres.
        """
        ...


@dataclass(frozen=True, slots=True)
class PowerMean:
    """The root of the mean of a power of the errors: the mean for 1, the root mean square for 2."""

    exponent: int

    def of(self, errors_m: Floats, chain: Ints, weights: WeightCounts) -> Floats:
        """Return (Σ w eᵖ / Σ w)^(1/p) by sums over chains."""
        chains = weights.shape[1]
        sums = np.bincount(chain, weights=errors_m**self.exponent, minlength=chains)
        sizes = np.bincount(chain, minlength=chains)
        # Only matrices of floats are multiplied by BLAS; sizes stay exact.
        totals = weights.astype(np.float64) @ np.stack([sums, sizes], axis=1)
        mean: Floats = totals[:, 0] / totals[:, 1]
        return mean if self.exponent == 1 else mean ** (1.0 / self.exponent)


@dataclass(frozen=True, slots=True)
class Percentile:
    """A percentile, interpolated as in :class:`~tickfix.evaluation.error_metrics.ErrorStatistics`."""

    percent: float

    def of(self, errors_m: Floats, chain: Ints, weights: WeightCounts) -> Floats:
        """Return the value at index q·(Σw − 1) of the sorted errors, each repeated as often as it counts."""
        order = np.argsort(errors_m, kind="stable")
        ordered, chain = errors_m[order], chain[order]
        rows = max(1, _BLOCK_CELLS // max(1, len(order)))
        blocks = [self._block(ordered, weights[i : i + rows][:, chain]) for i in range(0, len(weights), rows)]
        return np.concatenate(blocks)

    def _block(self, ordered: Floats, weights: WeightCounts) -> Floats:
        reached = np.cumsum(weights, axis=1, dtype=np.int32)
        index = self.percent / 100.0 * (reached[:, -1] - 1)
        low = np.floor(index)
        below = ordered[np.argmax(reached > low[:, np.newaxis], axis=1)]
        above = ordered[np.argmax(reached > np.ceil(index)[:, np.newaxis], axis=1)]
        return np.asarray(below + (above - below) * (index - low))


STATISTICS: Final[Mapping[str, Statistic]] = MappingProxyType(
    {
        "mean": PowerMean(1),
        "median": Percentile(50),
        "p75": Percentile(75),
        "p90": Percentile(90),
        "p95": Percentile(95),
        "rmse": PowerMean(2),
    }
)
"""By the names under which comparisons report them."""


REPLICATES: Final = 4000
CONFIDENCE: Final = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class BootstrapInterval:
    """A difference with its interval.

    Attributes:
        difference_m: quantity of the pipeline less that of the baseline: negative where the pipeline is better.
        low_m, high_m: ends of the interval; None with fewer than two chains, which say nothing of their spread.
        standard_error_m: of the difference, None likewise.
    """

    difference_m: float
    low_m: float | None = None
    high_m: float | None = None
    standard_error_m: float | None = None


def statistic_difference(paired: PairedErrors, statistic: Statistic) -> float:
    """Return the statistic of the pipeline minus that of the baseline, over all samples, metres."""
    every = np.ones((1, paired.chains), dtype=np.int64)
    pipeline = statistic.of(paired.pipeline_m, paired.chain, every)
    return float(pipeline[0] - statistic.of(paired.baseline_m, paired.chain, every)[0])


def interval(
    paired: PairedErrors,
    statistic: Statistic,
    rng: Rng,
    *,
    replicates: int = REPLICATES,
    confidence: float = CONFIDENCE,
) -> BootstrapInterval:
    """Return the difference with its bootstrap interval over chains.

    Each replicate draws as many chains as there are, with replacement, the same for both pipelines. The interval is
    the percentile interval, widened for few chains as by T. Hesterberg, *What teachers should know about the
    bootstrap* (2015): a percentile interval is too narrow by about √((c − 1)/c) and has normal instead of Student's
    tails, so the percentiles are taken at Φ(±√(c/(c − 1))·t) instead of ±z.
    """
    found = statistic_difference(paired, statistic)
    if paired.identical:
        return BootstrapInterval(difference_m=0.0, low_m=0.0, high_m=0.0, standard_error_m=0.0)
    c = paired.chains
    if c < 2:
        return BootstrapInterval(difference_m=found)
    drawn = rng.multinomial(c, np.full(c, 1.0 / c), size=replicates).astype(np.int16)
    replicated: Floats = statistic.of(paired.pipeline_m, paired.chain, drawn) - statistic.of(
        paired.baseline_m, paired.chain, drawn
    )
    widening = math.sqrt(c / (c - 1))
    tail = float(stats.norm.cdf(widening * stats.t.ppf((1.0 - confidence) / 2.0, c - 1)))
    low, high = np.quantile(replicated, [tail, 1.0 - tail])
    return BootstrapInterval(
        difference_m=found,
        low_m=float(low),
        high_m=float(high),
        standard_error_m=float(np.std(replicated)) * widening,
    )


PERMUTATIONS: Final = 9999
_EXACT_CHAINS: Final = 12


def permutation_p_value(
    paired: PairedErrors, statistic: Statistic, rng: Rng, *, permutations: int = PERMUTATIONS
) -> float:
    """Return the two-sided p-value of the difference under swaps of the two pipelines, chain by chain.

    With up to 12 chains every swap is tried and p is the share of those whose difference is as great; beyond that
    ``permutations`` are drawn and p is (1 + as great) / (1 + drawn), which never is 0: B. Phipson
    and G. Smyth, *Permutation p-values should never be zero* (2010).
    """
    # scipy.stats.permutation_test(permutation_type="samples") computes the same test, and the tests compare with it. It
    # is not used here for two reasons. It draws swaps in another order, so every p-value of more than 12 chains would
    # differ from those in published reports. And it takes two differences as equal within 2e-14 of their size, while
    # sums over thousands of waypoints in another order differ by more: ties would be counted by chance.
    if len(paired) == 0 or paired.identical:
        return 1.0
    c = paired.chains
    exact = c <= _EXACT_CHAINS
    swaps = _all_swaps(c) if exact else rng.integers(0, 2, size=(permutations, c), dtype=np.int8)
    both = np.concatenate([paired.pipeline_m, paired.baseline_m])
    chain = np.concatenate([paired.chain, paired.chain + c])
    differences = _swapped_differences(both, chain, swaps, statistic)
    observed = _swapped_differences(both, chain, np.zeros((1, c), dtype=np.int8), statistic)[0]
    # Differences that are equal mathematically may differ in their last bits.
    as_great = int(np.sum(np.abs(differences) >= abs(observed) * (1.0 - 1e-9)))
    return as_great / len(swaps) if exact else (1 + as_great) / (1 + permutations)


def _all_swaps(chains: int) -> WeightCounts:
    return np.array(list(product((0, 1), repeat=chains)), dtype=np.int8)


def _swapped_differences(
    both: NDArray[np.float64], chain: Ints, swaps: WeightCounts, statistic: Statistic
) -> NDArray[np.float64]:
    kept = 1 - swaps
    one = statistic.of(both, chain, np.concatenate([kept, swaps], axis=1))
    return np.asarray(one - statistic.of(both, chain, np.concatenate([swaps, kept], axis=1)))


def holm_correction(p_values: Sequence[float]) -> tuple[float, ...]:
    """Return the p-values adjusted by Holm's step-down rule, in their order.

    Sorted p_(1) ≤ … ≤ p_(m) become max over j ≤ i of min(1, (m − j + 1) p_(j)): deciding by them at 5 % claims a
    difference where there is none in at most 5 % of all families of comparisons, however the comparisons depend on
    each other. S. Holm, *A simple sequentially rejective multiple test procedure* (1979).
    """
    m = len(p_values)
    adjusted = [0.0] * m
    least = 0.0
    for rank, i in enumerate(sorted(range(m), key=lambda i: p_values[i])):
        least = max(least, min(1.0, (m - rank) * p_values[i]))
        adjusted[i] = least
    return tuple(adjusted)


SIGNIFICANCE_LEVEL: Final = 0.05
TEST_POWER: Final = 0.80
_DETECTABLE_STANDARD_ERRORS: Final = float(stats.norm.ppf(1.0 - SIGNIFICANCE_LEVEL / 2.0) + stats.norm.ppf(TEST_POWER))


def detectable_m(standard_error_m: float) -> float:
    """Return the difference that walks with this standard error would have shown four times out of five, metres."""
    return _DETECTABLE_STANDARD_ERRORS * standard_error_m


def walks_needed(walks: int, standard_error_m: float, difference_m: float) -> int | None:
    """Return how many walks like these would show ``difference_m``: at the 5 % level, with a power of 80 %.

    n · ((z₀.₉₇₅ + z₀.₈₀) · SE / |d|)², since a standard error falls with the root of their number. None for a
    difference of 0, which no number of walks shows.
    """
    if difference_m == 0.0:
        return None
    return math.ceil(walks * (detectable_m(standard_error_m) / abs(difference_m)) ** 2)
