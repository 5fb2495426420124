"""The tables of a report, in words: what the page and its Markdown both show."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from tickfix.evaluation.cells import metres, percent, plain, signed, winner
from tickfix.evaluation.comparison.points import Scope
from tickfix.evaluation.comparison.result import Result
from tickfix.evaluation.statistics.bootstrap import Interval
from tickfix.evaluation.statistics.comparison import Comparison

_Show = Callable[[Any], str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table of text.

    Attributes:
        caption: what it shows, with units.
        columns: titles; the first column is of labels.
        rows: as many cells as columns each.
        best: for each row the numbers of the cells, the label apart, that are best of their column.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    best: tuple[frozenset[int], ...] = ()


_LESS: Final = min
_MORE: Final = max
_ERRORS: Final = (
    ("mean", "mean_m", metres, _LESS),
    ("median", "median_m", metres, _LESS),
    ("p75", "p75_m", metres, _LESS),
    ("p90", "p90_m", metres, _LESS),
    ("p95", "p95_m", metres, _LESS),
    ("max", "max_m", metres, _LESS),
    ("RMSE", "rmse_m", metres, _LESS),
    ("CE50", "ce50_m", metres, _LESS),
    ("CE95", "ce95_m", metres, _LESS),
    ("IPIN", "ipin_m", metres, _LESS),
    ("floor", "floor_probability", percent, _MORE),
)
_TRACKS: Final = (
    ("available", "availability", percent, _MORE),
    ("first position, s", "first_position_s", plain, _LESS),
    ("wall crossings a minute", "crossings_per_minute", plain, _LESS),
    ("outside", "outside", percent, _LESS),
    ("acceleration, m/s²", "acceleration_mps2", plain, _LESS),
    ("length of track / way", "path_ratio", plain, None),
    ("jumps a standing minute", "jumps_per_standing_minute", plain, _LESS),
)
_TRUST: Final = (
    ("NEES mean (2)", "nees_mean", plain, None),
    ("NEES median (1.39)", "nees_median", plain, None),
    *(
        (f"{shape} {level} %", f"{shape}_{level}", percent, None)
        for shape in ("ellipse", "density")
        for level in (50, 90, 95)
    ),
)
_COST: Final = (
    ("tick, µs", "tick_us", plain, _LESS),
    ("of it pdr", "pdr_us", plain, None),
    ("of it filter", "filter_us", plain, None),
    ("fix, µs", "fix_us", plain, _LESS),
)
_SCOPES: Final = {
    Scope.ALL: "at all scored waypoints",
    Scope.COVERED: "at waypoints covered by the survey",
    Scope.INTERPOLATED: "between waypoints, every second, against INTERPOLATED truth",
}


def error_tables(result: Result) -> tuple[Table, ...]:
    """Return the error figures of each scope that has points."""
    return tuple(
        _figures(
            {name: result.figures[name][scope.value] for name in result.pipelines},
            f"Errors in metres {words}: {len(result.points[scope])} points",
            _ERRORS,
        )
        for scope, words in _SCOPES.items()
        if len(result.points[scope])
    )


def track_table(result: Result) -> Table:
    """Return the figures of whole tracks."""
    tracks = {name: result.figures[name]["tracks"] for name in result.pipelines}
    minutes = next(iter(tracks.values()))["standing_minutes"] if tracks else 0.0
    return _figures(tracks, f"Tracks; {minutes:.1f} minutes of standing", _TRACKS)


def trust_table(result: Result) -> Table:
    """Return the figures of uncertainty."""
    said = {name: result.figures[name][Scope.ALL.value] for name in result.pipelines}
    return _figures(said, "Uncertainty at all scored waypoints: share of truths in the regions", _TRUST)


def cost_table(result: Result) -> Table:
    """Return what the pipelines cost."""
    costs = {name: result.figures[name]["cost"] for name in result.pipelines}
    return _figures(costs, "Processor time per tick, and of the fingerprint per scan", _COST)


def comparison_table(comparisons: Sequence[Comparison], caption: str) -> Table:
    """Return differences with intervals and p-values."""
    rows = []
    for c in comparisons:
        i = c.interval
        rows.append(
            (
                c.pipeline,
                c.metric,
                c.scope,
                signed(i.difference_m),
                _span(i),
                f"{c.p_single:.4f}",
                f"{c.p:.4f}",
                c.answer.value,
                "–" if c.walks_needed is None else f"{c.walks_needed}",
                metres(c.detectable_m),
            )
        )
    columns = ("pipeline", "metric", "scope", "difference", "95 % CI", "p", "p corrected", "answer")
    return Table(caption=caption, columns=(*columns, "walks needed", "detectable"), rows=tuple(rows))


def ground_table(result: Result) -> Table:
    """Return means and differences ground by ground."""
    rows = []
    for part in result.grounds:
        found = {c.pipeline: c for c in part.comparisons}
        for name in result.pipelines:
            c = found.get(name)
            span = "" if c is None else _span(c.interval)
            difference = "baseline" if c is None else signed(c.interval.difference_m)
            rows.append((part.ground, str(part.walks), name, metres(part.means_m[name]), difference, span))
    columns = ("site", "walks", "pipeline", "mean", "difference", "95 % CI")
    caption = f"Mean error in metres by site, and its difference from {result.baseline}"
    return Table(caption=caption, columns=columns, rows=tuple(rows))


def settings_table(result: Result) -> Table:
    """Return the choices of each pipeline."""
    chosen: Mapping[str, Mapping[str, str]] = result.provenance.get("pipelines", {})
    rows = tuple((name, stage, words) for name, stages in chosen.items() for stage, words in stages.items())
    return Table(caption="Pipelines, all parameters spelt out", columns=("pipeline", "stage", "choice"), rows=rows)


def digest_table(result: Result) -> Table:
    """Return the pooled digests."""
    rows = tuple((name, p.published, p.settled) for name, p in result.summary.pipelines.items())
    caption = "SHA-256 of all tracks, published and settled: the same again on the same machine"
    return Table(caption=caption, columns=("pipeline", "published", "settled"), rows=rows)


def _span(interval: Interval) -> str:
    if interval.low_m is None or interval.high_m is None:
        return "–"
    return f"{signed(interval.low_m)} … {signed(interval.high_m)}"


def _figures(
    by_pipeline: Mapping[str, Mapping[str, Any]],
    caption: str,
    columns: Sequence[tuple[str, str, _Show, Callable[[Sequence[float]], float] | None]],
) -> Table:
    rows, bests = [], []
    winners: list[str | None] = []
    for _, key, show, best in columns:
        winners.append(None if best is None else winner([f[key] for f in by_pipeline.values()], show, best))
    for name, figures in by_pipeline.items():
        cells = [show(figures[key]) for _, key, show, _ in columns]
        rows.append((name, *cells))
        bests.append(frozenset(i for i, cell in enumerate(cells) if winners[i] == cell))
    titles = ("pipeline", *(title for title, *_ in columns))
    return Table(caption=caption, columns=titles, rows=tuple(rows), best=tuple(bests))
