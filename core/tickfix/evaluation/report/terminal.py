"""The tables and verdicts of a report for the terminal, readable at 100 columns."""

from __future__ import annotations

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from tickfix.evaluation.report.report_data import ReportData
from tickfix.evaluation.report.report_tables import ReportTable, pooled_metrics_table, walk_means_table
from tickfix.evaluation.walk_runs import RunSummary


def terminal_table(table: ReportTable, *, fold_values: bool = False) -> Table:
    """Return a table, the best cells in bold, the caption below; ``fold_values`` makes room for many columns."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 1), caption=table.caption, caption_justify="left")
    for i, title in enumerate(table.columns):
        if i < table.labels:
            shown.add_column(Text(title), overflow="fold", vertical="bottom")
        else:
            shown.add_column(Text(title), justify="right", no_wrap=not fold_values, overflow="fold")
    for row in table.marked_rows():
        shown.add_row(*(Text(cell, style="bold" if is_best else "") for cell, is_best in row))
    return shown


def pooled_table(summary: RunSummary) -> Table:
    """Return the pooled metrics of a run: a row per pipeline, errors in metres, the best in bold."""
    return terminal_table(pooled_metrics_table(summary))


def walk_table(summary: RunSummary) -> Table:
    """Return the mean errors in metres: a row per walk, a column per pipeline, the best of a walk in bold."""
    return terminal_table(walk_means_table(summary), fold_values=True)


def render_report(report: ReportData) -> Group:
    """Return the pooled metrics and the verdicts."""
    parts: list[RenderableType] = [terminal_table(report.pooled)]
    parts += [Text(verdict.sentence) for verdict in report.verdicts]
    if report.covered_verdicts:
        parts.append(Text("\nAt the waypoints covered by the survey:"))
        parts += [Text(verdict.sentence) for verdict in report.covered_verdicts]
    return Group(*parts)
