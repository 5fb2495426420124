"""Figures over seeds, and when they decide a claim.

A claim such as "A is better than B" is decided by the paired difference over seeds, in which what the seeds have in
common cancels. It holds if the whole 95 % interval lies on the claimed side. If it does not, the reason says whether
the opposite holds or nothing is decided.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from tickfix.api import Floats
from tickfix.reproduction.report import Cell, Claim, Interval

_LEVEL = 0.95


def mean(values: Sequence[float] | Floats) -> Interval:
    """Return the mean of one value per seed with its 95 % interval, x̄ ± t·s/√n by Student's t.

    Raises:
        ValueError: for fewer than two values, or one that is not finite.
    """
    x = np.asarray(values, dtype=np.float64)
    if x.ndim != 1 or len(x) < 2 or not np.isfinite(x).all():
        raise ValueError(f"values: found {x}, expected at least two, one a seed, all finite")
    n, centre = len(x), float(x.mean())
    half = float(stdtrit(n - 1, 0.5 + _LEVEL / 2) * x.std(ddof=1) / np.sqrt(n))
    return Interval(mean=centre, low=centre - half, high=centre + half, seeds=n)


def difference(a: Sequence[float] | Floats, b: Sequence[float] | Floats) -> Interval:
    """Return the mean of a − b, paired by seed."""
    return mean(np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64))


def reduction(before: Sequence[float] | Floats, after: Sequence[float] | Floats) -> Interval:
    """Return by how many per cent ``after`` is smaller than ``before``, paired by seed."""
    first = np.asarray(before, dtype=np.float64)
    return mean(100.0 * (first - np.asarray(after, dtype=np.float64)) / first)


def exact(value: float) -> Interval:
    """Return a figure in which no chance is: it rests on no seed."""
    return Interval(mean=value, low=value, high=value, seeds=0)


def row(ours: Sequence[Sequence[float] | Floats], paper: Sequence[float | None] = ()) -> tuple[Cell, ...]:
    """Return a row of a table: our means over seeds, beside the paper's figures where it prints any.

    Args:
        ours: for each column one value per seed.
        paper: a figure for each column, or nothing at all.
    """
    printed = paper or (None,) * len(ours)
    return tuple(Cell(paper=p, ours=mean(values)) for p, values in zip(printed, ours, strict=True))


def judge(
    claim: str,
    interval: Interval,
    *,
    paper: str,
    ours: str,
    above: float = -np.inf,
    below: float = np.inf,
    why: str = "",
) -> Claim:
    """Return the claim, decided by ``above < interval < below``.

    Args:
        claim: in one sentence.
        interval: of the quantity that decides.
        paper, ours: the figures, as text.
        above, below: bounds of what is claimed. Zero and infinity for "better"; both finite for "about".
        why: what was found out about the cause, told if the claim does not hold.
    """
    holds = above < interval.low and interval.high < below
    reason = ""
    if not holds:
        outside = interval.high <= above or interval.low >= below
        open_ended = np.isinf(above) or np.isinf(below)
        if not outside:
            reason = "undecided: the interval reaches over the bound"
        elif interval.low == interval.high and interval.low in (above, below):
            reason = "no difference at all"
        else:
            reason = "the opposite holds" if open_ended else "outside what is claimed"
        reason = f"{reason}. {why}" if why else reason
    return Claim(claim=claim, paper=paper, ours=ours, interval=interval, holds=holds, reason=reason)
