"""Which pipelines a report draws, and how they look in all its figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tickfix.evaluation.comparison.points import Scope
from tickfix.evaluation.comparison.result import Result
from tickfix.evaluation.style import Line, lines

MOST_LINES: Final = 6
"""More lines than there are colours cannot be told apart: the baseline and the best are drawn."""


def chosen(result: Result) -> tuple[str, ...]:
    """Return the pipelines that are drawn, in their order: the baseline and those with the least mean error."""
    if len(result.pipelines) <= MOST_LINES:
        return result.pipelines

    def mean_m(name: str) -> float:
        found = result.figures[name][Scope.ALL.value]["mean_m"]
        return float("inf") if found is None else float(found)

    best = sorted((n for n in result.pipelines if n != result.baseline), key=mean_m)[: MOST_LINES - 1]
    return tuple(name for name in result.pipelines if name == result.baseline or name in best)


def looks(result: Result) -> Mapping[str, Line]:
    """Return how each pipeline that is drawn looks, in all figures alike."""
    names = chosen(result)
    return dict(zip(names, lines(len(names)), strict=True))
