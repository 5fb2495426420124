"""The tables of a report: text with the best cells marked, independent of the format in which they are shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from tickfix.evaluation.comparison.comparison_result import ComparisonResult
from tickfix.evaluation.comparison.pooled_metrics import Scope
from tickfix.evaluation.paired_comparison import PairedComparison
from tickfix.evaluation.paired_statistics import BootstrapInterval
from tickfix.evaluation.walk_runs import PipelineSummary, RunSummary


def format_metres(value: float | None) -> str:
    """Return metres with two digits, a dash for none."""
    return "–" if value is None else f"{value:.2f}"


def format_signed(value: float) -> str:
    """Return metres with their sign and two digits."""
    return f"{value:+.2f}".replace("-", "−")


def format_percent(value: float | None) -> str:
    """Return a share as per cent, a dash for none."""
    return "–" if value is None else f"{100 * value:.1f} %"


def format_number(value: float | None) -> str:
    """Return a number with three significant digits at least, a dash for none."""
    return "–" if value is None else f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def best_text(
    values: Sequence[float | None],
    format_value: Callable[[float | None], str],
    best: Callable[[Sequence[float]], float],
) -> str | None:
    """Return the text of the best value; None if there is no value or all have the same text."""
    known = [value for value in values if value is not None]
    return format_value(best(known)) if known and len(set(map(format_value, values))) > 1 else None


_Formatter = Callable[[Any], str]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportTable:
    """A table of text.

    Attributes:
        caption: what it shows, with units.
        columns: titles; the first ``labels`` columns are of labels, the others of values.
        rows: as many cells as columns each.
        best: for each row the indices of the cells that are best of their column; empty if none is marked.
        labels: number of leading label columns.
        values_are_text: whether the values are words and digests rather than numbers.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    best: tuple[frozenset[int], ...] = ()
    labels: int = 1
    values_are_text: bool = False

    def marked_rows(self) -> tuple[tuple[tuple[str, bool], ...], ...]:
        """Return the rows as pairs (text of the cell, whether it is best of its column)."""
        best = self.best or (frozenset[int](),) * len(self.rows)
        return tuple(
            tuple((cell, i in marked) for i, cell in enumerate(row))
            for row, marked in zip(self.rows, best, strict=True)
        )


_LOWEST: Final = min
_HIGHEST: Final = max
_ERROR_METRICS: Final = (
    ("mean", "mean_m", format_metres, _LOWEST),
    ("median", "median_m", format_metres, _LOWEST),
    ("p75", "p75_m", format_metres, _LOWEST),
    ("p90", "p90_m", format_metres, _LOWEST),
    ("p95", "p95_m", format_metres, _LOWEST),
    ("max", "max_m", format_metres, _LOWEST),
    ("RMSE", "rmse_m", format_metres, _LOWEST),
    ("CE50", "ce50_m", format_metres, _LOWEST),
    ("CE95", "ce95_m", format_metres, _LOWEST),
    ("IPIN", "ipin_m", format_metres, _LOWEST),
    ("floor", "floor_probability", format_percent, _HIGHEST),
)
_TRACK_METRICS: Final = (
    ("available", "availability", format_percent, _HIGHEST),
    ("first position, s", "first_position_s", format_number, _LOWEST),
    ("wall crossings a minute", "crossings_per_minute", format_number, _LOWEST),
    ("outside", "outside", format_percent, _LOWEST),
    ("acceleration, m/s²", "acceleration_mps2", format_number, _LOWEST),
    ("track length / true length", "path_ratio", format_number, None),
    ("jumps a stationary minute", "jumps_per_stationary_minute", format_number, _LOWEST),
)
_UNCERTAINTY_METRICS: Final = (
    ("NEES mean (2)", "nees_mean", format_number, None),
    ("NEES median (1.39)", "nees_median", format_number, None),
    *(
        (f"{shape} {level} %", f"{shape}_{level}", format_percent, None)
        for shape in ("ellipse", "density")
        for level in (50, 90, 95)
    ),
)
_COST_METRICS: Final = (
    ("tick, µs", "tick_us", format_number, _LOWEST),
    ("pdr, µs", "pdr_us", format_number, None),
    ("filter, µs", "filter_us", format_number, None),
    ("fix, µs", "fix_us", format_number, _LOWEST),
)
_SCOPE_PHRASES: Final = {
    Scope.ALL: "at all scored waypoints",
    Scope.COVERED: "at waypoints covered by the survey",
    Scope.INTERPOLATED: "between waypoints, every second, against INTERPOLATED truth",
}


def error_tables(result: ComparisonResult) -> tuple[ReportTable, ...]:
    """Return the error metrics of each scope that has samples."""
    return tuple(
        _metrics_table(
            {name: result.metrics[name][scope.value] for name in result.pipelines},
            f"Errors in metres {words}: {len(result.samples[scope])} samples",
            _ERROR_METRICS,
        )
        for scope, words in _SCOPE_PHRASES.items()
        if len(result.samples[scope])
    )


def track_table(result: ComparisonResult) -> ReportTable:
    """Return the metrics of whole tracks."""
    tracks = {name: result.metrics[name]["tracks"] for name in result.pipelines}
    minutes = next(iter(tracks.values()))["stationary_minutes"] if tracks else 0.0
    return _metrics_table(tracks, f"Tracks; {minutes:.1f} minutes stationary", _TRACK_METRICS)


def uncertainty_table(result: ComparisonResult) -> ReportTable:
    """Return how well the stated uncertainty agrees with the errors."""
    metrics = {name: result.metrics[name][Scope.ALL.value] for name in result.pipelines}
    return _metrics_table(
        metrics, "Uncertainty at all scored waypoints: share of truths in the regions", _UNCERTAINTY_METRICS
    )


def cost_table(result: ComparisonResult) -> ReportTable:
    """Return the processor time of the pipelines."""
    costs = {name: result.metrics[name]["cost"] for name in result.pipelines}
    return _metrics_table(costs, "Processor time per tick, and of the fingerprint per scan", _COST_METRICS)


def comparison_table(comparisons: Sequence[PairedComparison], caption: str) -> ReportTable:
    """Return differences with intervals and p-values."""
    rows = []
    for c in comparisons:
        i = c.interval
        rows.append(
            (
                c.pipeline,
                c.metric,
                c.scope,
                format_signed(i.difference_m),
                _interval_text(i),
                f"{c.p_uncorrected:.4f}",
                f"{c.p:.4f}",
                c.conclusion.value,
                "–" if c.walks_needed is None else f"{c.walks_needed}",
                format_metres(c.detectable_m),
            )
        )
    columns = ("pipeline", "metric", "scope", "difference", "95 % CI", "p", "p corrected", "conclusion")
    return ReportTable(caption=caption, columns=(*columns, "walks needed", "detectable"), rows=tuple(rows))


def site_table(result: ComparisonResult) -> ReportTable:
    """Return means and differences by site."""
    rows = []
    for part in result.sites:
        found = {c.pipeline: c for c in part.comparisons}
        for name in result.pipelines:
            c = found.get(name)
            span = "" if c is None else _interval_text(c.interval)
            difference = "baseline" if c is None else format_signed(c.interval.difference_m)
            rows.append((part.site, str(part.walks), name, format_metres(part.means_m[name]), difference, span))
    columns = ("site", "walks", "pipeline", "mean", "difference", "95 % CI")
    caption = f"Mean error in metres by site, and its difference from {result.baseline}"
    return ReportTable(caption=caption, columns=columns, rows=tuple(rows))


def _choices_table(result: ComparisonResult) -> ReportTable:
    """Return the algorithms and parameters of each pipeline."""
    chosen: Mapping[str, Mapping[str, str]] = result.provenance.get("pipelines", {})
    rows = tuple((name, stage, words) for name, stages in chosen.items() for stage, words in stages.items())
    return ReportTable(
        caption="Pipelines with all parameters",
        columns=("pipeline", "stage", "choice"),
        rows=rows,
        values_are_text=True,
    )


def _digest_table(result: ComparisonResult) -> ReportTable:
    """Return the pooled digests of the tracks."""
    rows = tuple((name, p.published, p.settled) for name, p in result.summary.pipelines.items())
    caption = "SHA-256 of all tracks, published and settled; a repetition on the same machine gives the same"
    return ReportTable(caption=caption, columns=("pipeline", "published", "settled"), rows=rows, values_are_text=True)


def _interval_text(interval: BootstrapInterval) -> str:
    if interval.low_m is None or interval.high_m is None:
        return "–"
    return f"{format_signed(interval.low_m)} … {format_signed(interval.high_m)}"


def _metrics_table(
    by_pipeline: Mapping[str, Mapping[str, Any]],
    caption: str,
    columns: Sequence[tuple[str, str, _Formatter, Callable[[Sequence[float]], float] | None]],
) -> ReportTable:
    return _best_by_column(
        list(by_pipeline),
        caption,
        [(title, [metrics[key] for metrics in by_pipeline.values()], fmt, best) for title, key, fmt, best in columns],
    )


def _best_by_column(
    names: Sequence[str],
    caption: str,
    columns: Sequence[tuple[str, Sequence[float | None], _Formatter, Callable[[Sequence[float]], float] | None]],
    label: str = "pipeline",
) -> ReportTable:
    rows: list[tuple[str, ...]] = [(name,) for name in names]
    marked: list[set[int]] = [set() for _ in names]
    for i, (_, values, format_value, best) in enumerate(columns, start=1):
        winner = None if best is None else best_text(values, format_value, best)
        for row, value in enumerate(values):
            text = format_value(value)
            rows[row] = (*rows[row], text)
            if text == winner:
                marked[row].add(i)
    titles = (label, *(title for title, *_ in columns))
    return ReportTable(caption=caption, columns=titles, rows=tuple(rows), best=tuple(map(frozenset, marked)))


_PIPELINE_ERRORS: Final[Sequence[tuple[str, Callable[[PipelineSummary], float | None]]]] = (
    ("mean", lambda p: p.error_statistics.mean_m),
    ("median", lambda p: p.error_statistics.median_m),
    ("p75", lambda p: p.error_statistics.p75_m),
    ("p90", lambda p: p.error_statistics.p90_m),
    ("p95", lambda p: p.error_statistics.p95_m),
    ("max", lambda p: p.error_statistics.max_m),
    ("rmse", lambda p: p.error_statistics.rmse_m),
    ("covered\nmean", lambda p: p.covered.mean_m),
)
_PIPELINE_SHARES: Final[Sequence[tuple[str, Callable[[PipelineSummary], float | None]]]] = (
    ("right\nfloor", lambda p: p.floor_probability),
    ("avail-\nable", lambda p: p.availability),
)


def pooled_metrics_table(summary: RunSummary) -> ReportTable:
    """Return the pooled metrics of a run: a row per pipeline in the order of the run, errors in metres."""
    waypoints = sum(walk.waypoints for walk in summary.walks)
    scored_waypoints = sum(walk.scored for walk in summary.walks)
    shares = {pipeline.covered_share for pipeline in summary.pipelines.values()} - {None}
    covered = f", {format_percent(shares.pop())} of them covered by the survey" if shares else ""
    walks = "walk" if len(summary.walks) == 1 else "walks"
    pipelines = list(summary.pipelines.values())
    return _best_by_column(
        list(summary.pipelines),
        f"{scored_waypoints} of {waypoints} waypoints of {len(summary.walks)} {walks} scored{covered}",
        [
            *((title, [of(p) for p in pipelines], format_metres, _LOWEST) for title, of in _PIPELINE_ERRORS),
            *((title, [of(p) for p in pipelines], format_percent, _HIGHEST) for title, of in _PIPELINE_SHARES),
        ],
        label="error, m",
    )


def walk_means_table(summary: RunSummary) -> ReportTable:
    """Return the mean errors in metres: a row per walk, a column per pipeline, the best of each walk marked."""
    rows, marked = [], []
    for walk in summary.walks:
        means = [walk.pipelines[name].error_statistics.mean_m for name in summary.pipelines]
        winner = best_text(means, format_metres, min)
        cells = [format_metres(mean_m) for mean_m in means]
        rows.append((walk.name, walk.floor, f"{walk.scored}/{walk.waypoints}", *cells))
        marked.append(frozenset(i for i, cell in enumerate(cells, start=3) if cell == winner))
    return ReportTable(
        caption="mean error in metres at the scored waypoints",
        columns=("walk", "floor", "scored", *summary.pipelines),
        rows=tuple(rows),
        best=tuple(marked),
        labels=2,
    )


def provenance_tables(result: ComparisonResult) -> Iterator[ReportTable]:
    """Yield the parameters of the pipelines and the digests of tracks, code, sites and walks."""
    p = result.provenance
    yield _choices_table(result)
    yield _digest_table(result)
    for caption, columns, rows in (
        ("SHA-256 of the code that ran", ("pipeline", "code"), tuple(p.get("code", {}).items())),
        (
            "SHA-256 of the sites",
            ("site", "walks", "digest"),
            tuple((site["name"], str(site["walks"]), site["digest"]) for site in p.get("sites", [])),
        ),
        (
            "SHA-256 of the walks",
            ("site", "walk", "file"),
            tuple(dict.fromkeys((t.site, t.walk, t.sha256) for t in result.trials)),
        ),
    ):
        yield ReportTable(caption=caption, columns=columns, rows=rows, values_are_text=True)
