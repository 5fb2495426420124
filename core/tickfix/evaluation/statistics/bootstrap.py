"""Intervals for a difference: chains of walks are drawn again and again, with all that belongs to them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from tickfix.api import Floats, Rng
from tickfix.evaluation.statistics.quantities import Quantity
from tickfix.evaluation.statistics.samples import Paired

REPLICATES: Final = 4000
CONFIDENCE: Final = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
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


def difference(paired: Paired, quantity: Quantity) -> float:
    """Return the quantity of the pipeline less that of the baseline, over all points."""
    every = np.ones((1, paired.chains), dtype=np.int64)
    pipeline = quantity.of(paired.pipeline_m, paired.chain, every)
    return float(pipeline[0] - quantity.of(paired.baseline_m, paired.chain, every)[0])


def interval(
    paired: Paired, quantity: Quantity, rng: Rng, *, replicates: int = REPLICATES, confidence: float = CONFIDENCE
) -> Interval:
    """Return the difference with its bootstrap interval over chains.

    Each replicate draws as many chains as there are, with replacement, the same for both pipelines. The interval is
    the percentile interval, widened for few chains as by T. Hesterberg, *What teachers should know about the
    bootstrap* (2015): a percentile interval is too narrow by about √((c − 1)/c) and has normal instead of Student's
    tails, so the percentiles are taken at Φ(±√(c/(c − 1))·t) instead of ±z.
    """
    found = difference(paired, quantity)
    if paired.identical:
        return Interval(difference_m=0.0, low_m=0.0, high_m=0.0, standard_error_m=0.0)
    c = paired.chains
    if c < 2:
        return Interval(difference_m=found)
    drawn = rng.multinomial(c, np.full(c, 1.0 / c), size=replicates).astype(np.int16)
    replicated: Floats = quantity.of(paired.pipeline_m, paired.chain, drawn) - quantity.of(
        paired.baseline_m, paired.chain, drawn
    )
    widening = math.sqrt(c / (c - 1))
    tail = float(stats.norm.cdf(widening * stats.t.ppf((1.0 - confidence) / 2.0, c - 1)))
    low, high = np.quantile(replicated, [tail, 1.0 - tail])
    return Interval(
        difference_m=found,
        low_m=float(low),
        high_m=float(high),
        standard_error_m=float(np.std(replicated)) * widening,
    )
