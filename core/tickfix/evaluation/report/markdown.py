"""The report as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from tickfix.evaluation.comparison.points import Scope
from tickfix.evaluation.comparison.result import Result
from tickfix.evaluation.report.chart import Chart
from tickfix.evaluation.report.tables import (
    Table,
    comparison_table,
    cost_table,
    digest_table,
    error_tables,
    ground_table,
    settings_table,
    track_table,
    trust_table,
)
from tickfix.evaluation.report.trouble import worst_walks

_WORST: Final = 20


def markdown(result: Result, charts: Sequence[Chart]) -> str:
    """Return the report; figures are linked."""
    parts = [f"# Comparison of {', '.join(result.pipelines)}", "## Verdict", _verdicts(result, Scope.ALL)]
    if result.partly_covered:
        parts += ["At the waypoints covered by the survey:", _verdicts(result, Scope.COVERED)]
    parts.append("## Figures")
    parts += [f"![{c.title}]({c.path.parent.name}/{c.path.name})\n\n**{c.title}.** {c.caption}" for c in charts]
    parts += ["## Errors", *map(_table, error_tables(result))]
    if result.comparisons:
        caption = f"Differences from {result.baseline} in metres"
        parts += ["## Differences", _table(comparison_table(result.comparisons, caption))]
    parts += ["## Tracks", _table(track_table(result)), "## Uncertainty", _table(trust_table(result))]
    parts += ["## Cost", _table(cost_table(result))]
    if len(result.grounds) > 1:
        parts += ["## Where", _table(ground_table(result))]
    parts += ["## The worst walks", _worst(result), "## How it was made"]
    parts += [f"```sh\n{result.provenance.get('command', '')}\n```"]
    parts += [_table(settings_table(result)), _table(digest_table(result))]
    return "\n\n".join(part for part in parts if part) + "\n"


def _verdicts(result: Result, scope: Scope) -> str:
    return "\n".join(f"- {_escaped(c.verdict)}" for c in result.verdicts(scope)) or "Nothing to compare."


def _worst(result: Result) -> str:
    rows = []
    for walk in worst_walks(result.trials)[:_WORST]:
        rows += [
            (walk.trial.ground, walk.trial.walk, t.pipeline, f"{t.mean_m:.1f}", f"{t.worst_m:.1f}", t.words)
            for t in walk.troubles
        ]
    columns = ("site", "walk", "pipeline", "mean, m", "worst, m", "what it said of itself there")
    return _table(Table(caption="", columns=columns, rows=tuple(rows)))


def _table(table: Table) -> str:
    best = table.best or (frozenset[int](),) * len(table.rows)
    lines = [f"{_escaped(table.caption)}\n"] if table.caption else []
    lines.append("| " + " | ".join(map(_escaped, table.columns)) + " |")
    lines.append("|---" * len(table.columns) + "|")
    for row, good in zip(table.rows, best, strict=True):
        cells = [f"**{_escaped(cell)}**" if i - 1 in good else _escaped(cell) for i, cell in enumerate(row)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _escaped(text: str) -> str:
    for character in "\\`*_[]<|":
        text = text.replace(character, f"\\{character}")
    return text
