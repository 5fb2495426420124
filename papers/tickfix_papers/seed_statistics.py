"""Means and paired differences over seeds with 95 % intervals, and how they decide a claim.

It holds if the whole interval lies on the claimed side; if not, the reason says whether the opposite holds or nothing
is decided.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from tickfix.api import Floats
from tickfix_papers.reproduction_report import Claim, SeedInterval, TableCell

_LEVEL = 0.95


def mean(values: Sequence[float] | Floats) -> SeedInterval:
    """Return the mean of one value per seed with its 95 % interval, x̄ ± t·s/√n by Student's t.

    Raises:
        ValueError: for fewer than two values, or one that is not finite.
    """
    x = np.asarray(values, dtype=np.float64)
    if x.ndim != 1 or len(x) < 2 or not np.isfinite(x).all():
        raise ValueError(f"values: found {x}, expected at least two, one a seed, all finite")
    n, centre = len(x), float(x.mean())
    half = float(stdtrit(n - 1, 0.5 + _LEVEL / 2) * x.std(ddof=1) / np.sqrt(n))
    return SeedInterval(mean=centre, low=centre - half, high=centre + half, seeds=n)


def paired_difference(a: Sequence[float] | Floats, b: Sequence[float] | Floats) -> SeedInterval:
    """Return the mean of a − b, paired by seed."""
    return mean(np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64))


def percent_reduction(before: Sequence[float] | Floats, after: Sequence[float] | Floats) -> SeedInterval:
    """Return by how many per cent ``after`` is smaller than ``before``, paired by seed."""
    first = np.asarray(before, dtype=np.float64)
    return mean(100.0 * (first - np.asarray(after, dtype=np.float64)) / first)


def exact_value(value: float) -> SeedInterval:
    """Return a value without randomness: an interval of zero width, from no seed."""
    return SeedInterval(mean=value, low=value, high=value, seeds=0)


def table_row(ours: Sequence[Sequence[float] | Floats], paper: Sequence[float | None] = ()) -> tuple[TableCell, ...]:
    """Return a row of a table: our means over seeds, beside the paper's figures where it prints any.

    Args:
        ours: for each column one value per seed.
        paper: a figure for each column, or nothing at all.
    """
    printed = paper or (None,) * len(ours)
    return tuple(TableCell(paper=p, ours=mean(values)) for p, values in zip(printed, ours, strict=True))


def decide_claim(
    claim: str,
    interval: SeedInterval,
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
        why: the cause, as far as known; added to the reason if the claim does not hold.
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
