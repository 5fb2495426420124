"""A comparison in one sentence."""

from __future__ import annotations

from enum import StrEnum
from typing import Final

from tickfix.evaluation.statistics.bootstrap import Interval

_WORDS: Final = {"mean": "in mean", "median": "in median", "rmse": "in RMSE", "ipin": "in the IPIN score"}
_MANY: Final = 1_000_000
FEWEST_CHAINS: Final = 6
"""With fewer no p-value can be below 5 %: of the 2⁵ swaps of five chains two are as great as the observed one."""


class Answer(StrEnum):
    """What may be concluded of a pipeline."""

    BETTER = "better"
    """The corrected test says so at the 5 % level, and the 95 % interval lies below 0."""
    WORSE = "worse"
    """The same, and the interval lies above 0."""
    CANNOT_TELL = "cannot tell"
    """Neither; this is no proof that they are equal."""
    IDENTICAL = "identical"
    """Every error is the same, bit for bit."""


def sentence(
    answer: Answer,
    *,
    pipeline: str,
    baseline: str,
    metric: str,
    interval: Interval,
    p: float,
    walks: int,
    chains: int,
    walks_needed: int | None,
    worse: int,
) -> str:
    """Return the verdict, such as *B is 0.80 m better than A in mean (95 % CI 0.50–1.10, p = 0.002, 61 walks)*."""
    what = _WORDS.get(metric, f"at {metric}")
    on = f"{walks} {'walk' if walks == 1 else 'walks'}"
    if answer is Answer.IDENTICAL:
        return f"{pipeline} and {baseline} do not differ at all ({on})"
    found = interval.difference_m
    side = f"{abs(found):.2f} m {'better' if found < 0 else 'worse'}"
    if interval.low_m is None or interval.high_m is None:
        return f"cannot tell: {pipeline} is {side} than {baseline} {what}, but {on} of one chain have no spread"
    if answer is Answer.CANNOT_TELL:
        span = f"95 % CI {_end(interval.low_m)} to {_end(interval.high_m)}"
        more = _needed(walks_needed, walks, chains)
        return f"cannot tell: {pipeline} is {side} than {baseline} {what} ({span}, {_p(p)}, {on}); {more}"
    low, high = sorted((abs(interval.low_m), abs(interval.high_m)))
    text = f"{pipeline} is {side} than {baseline} {what} (95 % CI {low:.2f}–{high:.2f} m, {_p(p)}, {on})"
    if answer is Answer.BETTER and worse:
        text += f"; worse on {worse} of them"
    return text


def _end(value_m: float) -> str:
    return f"{abs(value_m):.2f} m {'better' if value_m < 0 else 'worse'}"


def _p(p: float) -> str:
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}" if p < 0.1 else f"p = {p:.2f}"


def _needed(needed: int | None, walks: int, chains: int) -> str:
    if chains < FEWEST_CHAINS:
        return f"{chains} independent chains of walks are too few for any test, at least {FEWEST_CHAINS} are needed"
    if needed is None or needed > _MANY:
        return "no number of walks would tell so small a difference"
    if needed <= walks:
        return "it is borderline, more walks like these may settle it"
    return f"to tell a difference of this size about {needed} walks would be needed"
