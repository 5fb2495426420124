"""Metrics of a run as tables for the terminal, readable at 100 columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rich import box
from rich.table import Table
from rich.text import Text

from tickfix.evaluation.report.report_data import best_text, format_metres, format_percent
from tickfix.evaluation.walk_runs import PipelineSummary, RunSummary

_MetricOf = Callable[[PipelineSummary], float | None]

_ERROR_COLUMNS: Sequence[tuple[str, _MetricOf]] = (
    ("mean", lambda p: p.error_statistics.mean_m),
    ("median", lambda p: p.error_statistics.median_m),
    ("p75", lambda p: p.error_statistics.p75_m),
    ("p90", lambda p: p.error_statistics.p90_m),
    ("p95", lambda p: p.error_statistics.p95_m),
    ("max", lambda p: p.error_statistics.max_m),
    ("rmse", lambda p: p.error_statistics.rmse_m),
    ("covered\nmean", lambda p: p.covered.mean_m),
)
_SHARE_COLUMNS: Sequence[tuple[str, _MetricOf]] = (
    ("right\nfloor", lambda p: p.floor_probability),
    ("avail-\nable", lambda p: p.availability),
)


def pooled_table(summary: RunSummary) -> Table:
    """Return the pooled figures: a row per pipeline in the order of the run, errors in metres, the best in bold."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), caption=_caption(summary), caption_justify="left")
    table.add_column("error, m", overflow="fold", vertical="bottom")
    columns = []
    for title, cell in _ERROR_COLUMNS:
        table.add_column(title, justify="right", no_wrap=True)
        columns.append(_column_texts([cell(pipeline) for pipeline in summary.pipelines.values()], format_metres, min))
    for title, cell in _SHARE_COLUMNS:
        table.add_column(title, justify="right", no_wrap=True)
        columns.append(_column_texts([cell(pipeline) for pipeline in summary.pipelines.values()], format_percent, max))
    for i, name in enumerate(summary.pipelines):
        table.add_row(Text(name), *(column[i] for column in columns))
    return table


def walk_table(summary: RunSummary) -> Table:
    """Return the mean errors in metres: a row per walk, a column per pipeline, the best of a walk in bold."""
    table = Table(
        box=box.SIMPLE_HEAD,
        padding=(0, 1),
        caption="mean error in metres at the scored waypoints",
        caption_justify="left",
    )
    table.add_column("walk", overflow="fold")
    table.add_column("floor", overflow="fold")
    table.add_column("scored", justify="right", no_wrap=True)
    for name in summary.pipelines:
        table.add_column(Text(name), justify="right", overflow="fold")
    for walk in summary.walks:
        means = [walk.pipelines[name].error_statistics.mean_m for name in summary.pipelines]
        cells = _column_texts(means, format_metres, min)
        table.add_row(Text(walk.name), Text(walk.floor), f"{walk.scored}/{walk.waypoints}", *cells)
    return table


def _caption(summary: RunSummary) -> str:
    waypoints = sum(walk.waypoints for walk in summary.walks)
    scored = sum(walk.scored for walk in summary.walks)
    shares = {pipeline.covered_share for pipeline in summary.pipelines.values()} - {None}
    covered = f", {format_percent(shares.pop())} of them covered by the survey" if shares else ""
    walks = "walk" if len(summary.walks) == 1 else "walks"
    return f"{scored} of {waypoints} waypoints of {len(summary.walks)} {walks} scored{covered}"


def _column_texts(
    values: Sequence[float | None],
    format_value: Callable[[float | None], str],
    best: Callable[[Sequence[float]], float],
) -> list[Text]:
    best_shown = best_text(values, format_value, best)
    return [Text(text, style="bold" if text == best_shown else "") for text in map(format_value, values)]
