"""One pipeline against the baseline: difference, interval, test, and what it takes to say more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any, Final

import numpy as np

from tickfix.api import Rng
from tickfix.evaluation.statistics.bootstrap import Interval, interval
from tickfix.evaluation.statistics.holm import holm
from tickfix.evaluation.statistics.permutation import p_value
from tickfix.evaluation.statistics.power import LEVEL, detectable_m, walks_needed
from tickfix.evaluation.statistics.quantities import Power, Quantity
from tickfix.evaluation.statistics.samples import Paired
from tickfix.evaluation.statistics.verdict import Answer, sentence

_FEW_REPLICATES: Final = 2000
_FEW_PERMUTATIONS: Final = 1999


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """One pipeline against the baseline in one figure.

    Attributes:
        pipeline, baseline: names.
        metric, scope: which figure, over which points; see ``docs/metrics.md``.
        interval: difference and 95 % interval, not corrected for other comparisons.
        p_single, p: of the paired test; alone, and corrected for the pipelines compared by the same figure.
        walks, chains, points: what it rests on.
        answer: what may be concluded.
        worse_on: names of the walks with a greater mean error than the baseline's, worst first, each with by how much.
    """

    pipeline: str
    baseline: str
    metric: str
    scope: str
    interval: Interval
    p_single: float
    p: float
    walks: int
    chains: int
    points: int
    answer: Answer
    worse_on: tuple[tuple[str, float], ...] = ()

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
        return sentence(
            self.answer,
            pipeline=self.pipeline,
            baseline=self.baseline,
            metric=self.metric,
            interval=self.interval,
            p=self.p,
            walks=self.walks,
            chains=self.chains,
            walks_needed=self.walks_needed,
            worse=len(self.worse_on),
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
            "p_single": self.p_single,
            "walks": self.walks,
            "chains": self.chains,
            "points": self.points,
            "answer": self.answer.value,
            "verdict": self.verdict,
            "walks_needed": self.walks_needed,
            "detectable_m": self.detectable_m,
            "worse_on": [{"walk": walk, "by_m": by_m} for walk, by_m in self.worse_on],
        }


def compare(
    pairs: Mapping[str, Paired],
    *,
    baseline: str,
    metric: str,
    scope: str,
    quantity: Quantity,
    walks: Sequence[str] = (),
) -> tuple[Comparison, ...]:
    """Compare pipelines with the baseline in one figure; their p-values are corrected for one another.

    The random numbers depend on metric and scope only, so that a pipeline's interval is the same whoever else is there.

    Args:
        pairs: by pipeline, the baseline left out.
        baseline, metric, scope: names.
        quantity: what the metric computes.
        walks: names of the walks by number, to name those on which a pipeline is worse; none are named without.
    """
    alone = [
        _alone(name, paired, baseline=baseline, metric=metric, scope=scope, quantity=quantity, walks=walks)
        for name, paired in pairs.items()
        if len(paired)
    ]
    corrected = holm([comparison.p_single for comparison in alone])
    return tuple(
        replace(comparison, p=p, answer=_answer(pairs[comparison.pipeline], comparison.interval, p))
        for comparison, p in zip(alone, corrected, strict=True)
    )


def _alone(
    name: str, paired: Paired, *, baseline: str, metric: str, scope: str, quantity: Quantity, walks: Sequence[str]
) -> Comparison:
    # Sums over chains are cheap, sorting is not.
    effort = {} if isinstance(quantity, Power) else {"replicates": _FEW_REPLICATES}
    trials = {} if isinstance(quantity, Power) else {"permutations": _FEW_PERMUTATIONS}
    p = p_value(paired, quantity, _rng("permutation", metric, scope), **trials)
    return Comparison(
        pipeline=name,
        baseline=baseline,
        metric=metric,
        scope=scope,
        interval=interval(paired, quantity, _rng("bootstrap", metric, scope), **effort),
        p_single=p,
        p=p,
        walks=paired.walks,
        chains=paired.chains,
        points=len(paired),
        answer=Answer.CANNOT_TELL,
        worse_on=_worse(paired, walks),
    )


def _answer(paired: Paired, found: Interval, p: float) -> Answer:
    if paired.identical:
        return Answer.IDENTICAL
    if found.low_m is None or found.high_m is None or p > LEVEL or found.low_m <= 0.0 <= found.high_m:
        return Answer.CANNOT_TELL
    return Answer.BETTER if found.difference_m < 0 else Answer.WORSE


def _worse(paired: Paired, walks: Sequence[str]) -> tuple[tuple[str, float], ...]:
    if not walks:
        return ()
    sizes = np.bincount(paired.walk)
    by_m = np.bincount(paired.walk, weights=paired.pipeline_m - paired.baseline_m) / sizes
    worst = np.argsort(-by_m, kind="stable")
    return tuple((walks[i], float(by_m[i])) for i in worst if by_m[i] > 0.0)


def _rng(purpose: str, metric: str, scope: str) -> Rng:
    digest = sha256(f"{purpose} {metric} {scope}".encode()).digest()
    return np.random.Generator(np.random.Philox(int.from_bytes(digest[:8], "little")))
