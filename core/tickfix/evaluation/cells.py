"""Figures as the text of a table's cells, and which text of a column is the best."""

from __future__ import annotations

from collections.abc import Callable, Sequence


def metres(value: float | None) -> str:
    """Return metres with two digits, a dash for none."""
    return "–" if value is None else f"{value:.2f}"


def signed(value: float) -> str:
    """Return metres with their sign and two digits."""
    return f"{value:+.2f}".replace("-", "−")


def percent(value: float | None) -> str:
    """Return a share as per cent, a dash for none."""
    return "–" if value is None else f"{100 * value:.1f} %"


def plain(value: float | None) -> str:
    """Return a number with three significant digits at least, a dash for none."""
    return "–" if value is None else f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def winner(
    values: Sequence[float | None], show: Callable[[float | None], str], best: Callable[[Sequence[float]], float]
) -> str | None:
    """Return how the best of a column is shown; None where all are shown alike, and so none stands out."""
    known = [value for value in values if value is not None]
    return show(best(known)) if known and len(set(map(show, values))) > 1 else None
