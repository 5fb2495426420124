"""One pipeline against the baseline.

Difference, interval, corrected test, conclusion, and the verdict as a sentence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from hashlib import sha256
from typing import Any, Final

import numpy as np

from tickfix.api import Rng
from tickfix.evaluation.paired_statistics import (
    SIGNIFICANCE_LEVEL,
    BootstrapInterval,
    PairedErrors,
    PowerMean,
    Statistic,
    detectable_m,
    holm_correction,
    interval,
    permutation_p_value,
    walks_needed,
)

_METRIC_PHRASES: Final = {"mean": "in mean", "median": "in median", "rmse": "in RMSE", "ipin": "in the IPIN score"}
_MAX_WALKS_NEEDED: Final = 1_000_000
MIN_CHAINS: Final = 6
"""With fewer no p-value can be below 5 %: of the 2⁵ swaps of five chains two are as great as the observed one."""


class Conclusion(StrEnum):
    """The conclusion on a pipeline."""

    BETTER = "better"
    """The corrected test says so at the 5 % level, and the 95 % interval lies below 0."""
    WORSE = "worse"
    """The same, and the interval lies above 0."""
    INCONCLUSIVE = "inconclusive"
    """Neither of the two; this is no proof that the pipelines are equal."""
    IDENTICAL = "identical"
    """Every error is the same, bit for bit."""


def verdict_sentence(
    conclusion: Conclusion,
    *,
    pipeline: str,
    baseline: str,
    metric: str,
    interval: BootstrapInterval,
    p: float,
    walks: int,
    chains: int,
    walks_needed: int | None,
    worse_walk_count: int,
) -> str:
    """Return the verdict, such as *B is 0.80 m better than A in mean (95 % CI 0.50–1.10, p = 0.002, 61 walks)*."""
    what = _METRIC_PHRASES.get(metric, f"at {metric}")
    on = f"{walks} {'walk' if walks == 1 else 'walks'}"
    if conclusion is Conclusion.IDENTICAL:
        return f"{pipeline} and {baseline} do not differ at all ({on})"
    found = interval.difference_m
    side = f"{abs(found):.2f} m {'better' if found < 0 else 'worse'}"
    if interval.low_m is None or interval.high_m is None:
        return f"cannot tell: {pipeline} is {side} than {baseline} {what}, but {on} of one chain have no spread"
    if conclusion is Conclusion.INCONCLUSIVE:
        span = f"95 % CI {_signed_phrase(interval.low_m)} to {_signed_phrase(interval.high_m)}"
        more = _walks_needed_phrase(walks_needed, walks, chains)
        return f"cannot tell: {pipeline} is {side} than {baseline} {what} ({span}, {_p_phrase(p)}, {on}); {more}"
    low, high = sorted((abs(interval.low_m), abs(interval.high_m)))
    text = f"{pipeline} is {side} than {baseline} {what} (95 % CI {low:.2f}–{high:.2f} m, {_p_phrase(p)}, {on})"
    if conclusion is Conclusion.BETTER and worse_walk_count:
        text += f"; worse on {worse_walk_count} of them"
    return text


def _signed_phrase(value_m: float) -> str:
    return f"{abs(value_m):.2f} m {'better' if value_m < 0 else 'worse'}"


def _p_phrase(p: float) -> str:
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}" if p < 0.1 else f"p = {p:.2f}"


def _walks_needed_phrase(needed: int | None, walks: int, chains: int) -> str:
    if chains < MIN_CHAINS:
        return f"{chains} independent chains of walks are too few for any test, at least {MIN_CHAINS} are needed"
    if needed is None or needed > _MAX_WALKS_NEEDED:
        return "no number of walks would tell so small a difference"
    if needed <= walks:
        return "it is borderline, more walks like these may settle it"
    return f"to tell a difference of this size about {needed} walks would be needed"


_PERCENTILE_REPLICATES: Final = 2000
_PERCENTILE_PERMUTATIONS: Final = 1999


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedComparison:
    """One pipeline against the baseline in one metric.

    Attributes:
        pipeline, baseline: names.
        metric, scope: the metric and its samples; see ``docs/metrics.md``.
        interval: difference and 95 % interval, not corrected for other comparisons.
        p_uncorrected, p: of the paired test; alone, and corrected for the pipelines compared by the same figure.
        walks, chains, samples: their numbers.
        conclusion: the conclusion.
        worse_walks: names of the walks with a greater mean error than the baseline's, worst first, each with by how
            much.
    """

    pipeline: str
    baseline: str
    metric: str
    scope: str
    interval: BootstrapInterval
    p_uncorrected: float
    p: float
    walks: int
    chains: int
    samples: int
    conclusion: Conclusion
    worse_walks: tuple[tuple[str, float], ...] = ()

    @property
    def walks_needed(self) -> int | None:
        """Number of walks that would show a difference as great as the one found; None where that has no answer."""
        error_m = self.interval.standard_error_m
        return None if error_m is None else walks_needed(self.walks, error_m, self.interval.difference_m)

    @property
    def detectable_m(self) -> float | None:
        """Difference that as many walks would have shown four times out of five."""
        return None if self.interval.standard_error_m is None else detectable_m(self.interval.standard_error_m)

    @property
    def verdict(self) -> str:
        """The comparison as a sentence."""
        return verdict_sentence(
            self.conclusion,
            pipeline=self.pipeline,
            baseline=self.baseline,
            metric=self.metric,
            interval=self.interval,
            p=self.p,
            walks=self.walks,
            chains=self.chains,
            walks_needed=self.walks_needed,
            worse_walk_count=len(self.worse_walks),
        )

    def as_json(self) -> dict[str, Any]:
        """Return the object that stands under ``comparisons``."""
        i = self.interval
        return {
            "pipeline": self.pipeline,
            "baseline": self.baseline,
            "metric": self.metric,
            "scope": self.scope,
            "difference_m": i.difference_m,
            "interval_m": None if i.low_m is None or i.high_m is None else [i.low_m, i.high_m],
            "p": self.p,
            "p_uncorrected": self.p_uncorrected,
            "walks": self.walks,
            "chains": self.chains,
            "samples": self.samples,
            "conclusion": self.conclusion.value,
            "verdict": self.verdict,
            "walks_needed": self.walks_needed,
            "detectable_m": self.detectable_m,
            "worse_walks": [{"walk": walk, "excess_m": by_m} for walk, by_m in self.worse_walks],
        }


def compare_with_baseline(
    pairs: Mapping[str, PairedErrors],
    *,
    baseline: str,
    metric: str,
    scope: str,
    statistic: Statistic,
    walks: Sequence[str] = (),
) -> tuple[PairedComparison, ...]:
    """Compare pipelines with the baseline in one metric; their p-values are corrected for one another.

    The random numbers depend on metric and scope only: a pipeline's interval does not depend on the other pipelines.

    Args:
        pairs: by pipeline, the baseline left out.
        baseline, metric, scope: names.
        statistic: what the metric computes.
        walks: names of the walks by number, to name those on which a pipeline is worse; none are named without.
    """
    uncorrected = [
        _compare_uncorrected(
            name, paired, baseline=baseline, metric=metric, scope=scope, statistic=statistic, walks=walks
        )
        for name, paired in pairs.items()
        if len(paired)
    ]
    corrected = holm_correction([comparison.p_uncorrected for comparison in uncorrected])
    return tuple(
        replace(comparison, p=p, conclusion=_conclusion(pairs[comparison.pipeline], comparison.interval, p))
        for comparison, p in zip(uncorrected, corrected, strict=True)
    )


def _compare_uncorrected(
    name: str,
    paired: PairedErrors,
    *,
    baseline: str,
    metric: str,
    scope: str,
    statistic: Statistic,
    walks: Sequence[str],
) -> PairedComparison:
    # A percentile sorts in every replicate, which takes far longer than the sums of a mean: fewer replicates.
    effort = {} if isinstance(statistic, PowerMean) else {"replicates": _PERCENTILE_REPLICATES}
    trials = {} if isinstance(statistic, PowerMean) else {"permutations": _PERCENTILE_PERMUTATIONS}
    p = permutation_p_value(paired, statistic, _seeded_rng("permutation", metric, scope), **trials)
    return PairedComparison(
        pipeline=name,
        baseline=baseline,
        metric=metric,
        scope=scope,
        interval=interval(paired, statistic, _seeded_rng("bootstrap", metric, scope), **effort),
        p_uncorrected=p,
        p=p,
        walks=paired.walks,
        chains=paired.chains,
        samples=len(paired),
        conclusion=Conclusion.INCONCLUSIVE,
        worse_walks=_worse_walks(paired, walks),
    )


def _conclusion(paired: PairedErrors, found: BootstrapInterval, p: float) -> Conclusion:
    if paired.identical:
        return Conclusion.IDENTICAL
    if found.low_m is None or found.high_m is None or p > SIGNIFICANCE_LEVEL or found.low_m <= 0.0 <= found.high_m:
        return Conclusion.INCONCLUSIVE
    return Conclusion.BETTER if found.difference_m < 0 else Conclusion.WORSE


def _worse_walks(paired: PairedErrors, walks: Sequence[str]) -> tuple[tuple[str, float], ...]:
    if not walks:
        return ()
    sizes = np.bincount(paired.walk)
    by_m = np.bincount(paired.walk, weights=paired.pipeline_m - paired.baseline_m) / sizes
    worst = np.argsort(-by_m, kind="stable")
    return tuple((walks[i], float(by_m[i])) for i in worst if by_m[i] > 0.0)


def _seeded_rng(purpose: str, metric: str, scope: str) -> Rng:
    digest = sha256(f"{purpose} {metric} {scope}".encode()).digest()
    return np.random.Generator(np.random.Philox(int.from_bytes(digest[:8], "little")))
