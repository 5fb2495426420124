"""The data of a report, independent of its format: tables of text with the best cells marked, and the worst walks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from tickfix.evaluation.comparison.comparison_result import ComparisonResult
from tickfix.evaluation.comparison.pooled_metrics import Scope, scored
from tickfix.evaluation.comparison.trials import Trial
from tickfix.evaluation.paired_comparison import PairedComparison
from tickfix.evaluation.paired_statistics import BootstrapInterval


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
    """Return how the best of a column is shown; None where all are shown alike, and so none stands out."""
    known = [value for value in values if value is not None]
    return format_value(best(known)) if known and len(set(map(format_value, values))) > 1 else None


_Formatter = Callable[[Any], str]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportTable:
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
    ("length of track / way", "path_ratio", format_number, None),
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
    ("of it pdr", "pdr_us", format_number, None),
    ("of it filter", "filter_us", format_number, None),
    ("fix, µs", "fix_us", format_number, _LOWEST),
)
_SCOPE_PHRASES: Final = {
    Scope.ALL: "at all scored waypoints",
    Scope.COVERED: "at waypoints covered by the survey",
    Scope.INTERPOLATED: "between waypoints, every second, against INTERPOLATED truth",
}


def error_tables(result: ComparisonResult) -> tuple[ReportTable, ...]:
    """Return the error figures of each scope that has points."""
    return tuple(
        _metrics_table(
            {name: result.metrics[name][scope.value] for name in result.pipelines},
            f"Errors in metres {words}: {len(result.samples[scope])} points",
            _ERROR_METRICS,
        )
        for scope, words in _SCOPE_PHRASES.items()
        if len(result.samples[scope])
    )


def track_table(result: ComparisonResult) -> ReportTable:
    """Return the figures of whole tracks."""
    tracks = {name: result.metrics[name]["tracks"] for name in result.pipelines}
    minutes = next(iter(tracks.values()))["stationary_minutes"] if tracks else 0.0
    return _metrics_table(tracks, f"Tracks; {minutes:.1f} minutes of standing", _TRACK_METRICS)


def uncertainty_table(result: ComparisonResult) -> ReportTable:
    """Return the figures of uncertainty."""
    said = {name: result.metrics[name][Scope.ALL.value] for name in result.pipelines}
    return _metrics_table(
        said, "Uncertainty at all scored waypoints: share of truths in the regions", _UNCERTAINTY_METRICS
    )


def cost_table(result: ComparisonResult) -> ReportTable:
    """Return what the pipelines cost."""
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
    """Return means and differences ground by ground."""
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


def choices_table(result: ComparisonResult) -> ReportTable:
    """Return the choices of each pipeline."""
    chosen: Mapping[str, Mapping[str, str]] = result.provenance.get("pipelines", {})
    rows = tuple((name, stage, words) for name, stages in chosen.items() for stage, words in stages.items())
    return ReportTable(
        caption="Pipelines, all parameters spelt out", columns=("pipeline", "stage", "choice"), rows=rows
    )


def digest_table(result: ComparisonResult) -> ReportTable:
    """Return the pooled digests."""
    rows = tuple((name, p.published, p.settled) for name, p in result.summary.pipelines.items())
    caption = "SHA-256 of all tracks, published and settled: the same again on the same machine"
    return ReportTable(caption=caption, columns=("pipeline", "published", "settled"), rows=rows)


def _interval_text(interval: BootstrapInterval) -> str:
    if interval.low_m is None or interval.high_m is None:
        return "–"
    return f"{format_signed(interval.low_m)} … {format_signed(interval.high_m)}"


def _metrics_table(
    by_pipeline: Mapping[str, Mapping[str, Any]],
    caption: str,
    columns: Sequence[tuple[str, str, _Formatter, Callable[[Sequence[float]], float] | None]],
) -> ReportTable:
    rows, bests = [], []
    winners: list[str | None] = []
    for _, key, format_value, best in columns:
        winners.append(None if best is None else best_text([f[key] for f in by_pipeline.values()], format_value, best))
    for name, metrics in by_pipeline.items():
        cells = [format_value(metrics[key]) for _, key, format_value, _ in columns]
        rows.append((name, *cells))
        bests.append(frozenset(i for i, cell in enumerate(cells) if winners[i] == cell))
    titles = ("pipeline", *(title for title, *_ in columns))
    return ReportTable(caption=caption, columns=titles, rows=tuple(rows), best=tuple(bests))


@dataclass(frozen=True, slots=True, kw_only=True)
class WorstCase:
    """One pipeline on one walk.

    Attributes:
        mean_m: of the errors at scored waypoints.
        worst_m, worst_s: the greatest of them, and when it was, seconds since the first waypoint.
        covered: whether the survey had been there.
        floor: on which the estimate was wrong, empty where it was right.
        diagnosis: what the pipeline said of itself then.
    """

    pipeline: str
    mean_m: float
    worst_m: float
    worst_s: float
    worst_sample: int
    covered: bool
    floor: str
    diagnosis: str


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WorstWalk:
    """A walk with the trouble that each pipeline had on it."""

    trial: Trial
    worst_cases: tuple[WorstCase, ...]

    @property
    def mean_m(self) -> float:
        """Mean error of the pipeline that was worst."""
        return max((worst_case.mean_m for worst_case in self.worst_cases), default=0.0)


def worst_walks(trials: Sequence[Trial]) -> tuple[WorstWalk, ...]:
    """Return every walk once, with the seed that was worst, the walk with the greatest mean error first.

    Walks of which no waypoint was scored come last.
    """
    worst: dict[tuple[str, str], WorstWalk] = {}
    for trial in trials:
        walk = WorstWalk(trial=trial, worst_cases=_worst_cases(trial))
        name = (trial.site, trial.walk)
        if name not in worst or walk.mean_m > worst[name].mean_m:
            worst[name] = walk
    return tuple(sorted(worst.values(), key=lambda walk: (-walk.mean_m, walk.trial.site, walk.trial.walk)))


def _worst_cases(trial: Trial) -> tuple[WorstCase, ...]:
    kept = np.flatnonzero(scored(trial, Scope.ALL))
    if len(kept) == 0:
        return ()
    found = []
    for name, outcome in trial.outcomes.items():
        sample_errors = outcome.at_samples
        i = int(kept[np.argmax(sample_errors.error_m[kept])])
        found.append(
            WorstCase(
                pipeline=name,
                mean_m=float(np.mean(sample_errors.error_m[kept])),
                worst_m=float(sample_errors.error_m[i]),
                worst_s=float(outcome.samples.t_ns[i] - outcome.samples.t_ns[0]) * 1e-9,
                worst_sample=i,
                covered=bool(outcome.covered[i]),
                floor="" if sample_errors.floor_right[i] else "wrong floor",
                diagnosis=str(outcome.diagnoses[i]),
            )
        )
    return tuple(found)
