"""Writes the folder of a report: HTML, Markdown, JSON and CSV."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, Final

from tickfix.api import Floor
from tickfix.evaluation.comparison.comparison_result import ComparisonResult
from tickfix.evaluation.comparison.pooled_metrics import Scope, chain_names
from tickfix.evaluation.report.charts import Chart, draw_charts
from tickfix.evaluation.report.html_report import html_page
from tickfix.evaluation.report.report_data import (
    ReportTable,
    choices_table,
    comparison_table,
    cost_table,
    digest_table,
    error_tables,
    site_table,
    track_table,
    uncertainty_table,
    worst_walks,
)

_MAX_WORST_WALKS: Final = 20


def markdown_report(result: ComparisonResult, charts: Sequence[Chart]) -> str:
    """Return the report; figures are linked."""
    parts = [f"# Comparison of {', '.join(result.pipelines)}", "## Verdict", _markdown_verdicts(result, Scope.ALL)]
    if result.partly_covered:
        parts += ["At the waypoints covered by the survey:", _markdown_verdicts(result, Scope.COVERED)]
    parts.append("## Figures")
    parts += [f"![{c.title}]({c.path.parent.name}/{c.path.name})\n\n**{c.title}.** {c.caption}" for c in charts]
    parts += ["## Errors", *map(_markdown_table, error_tables(result))]
    if result.comparisons:
        caption = f"Differences from {result.baseline} in metres"
        parts += ["## Differences", _markdown_table(comparison_table(result.comparisons, caption))]
    parts += [
        "## Tracks",
        _markdown_table(track_table(result)),
        "## Uncertainty",
        _markdown_table(uncertainty_table(result)),
    ]
    parts += ["## Cost", _markdown_table(cost_table(result))]
    if len(result.sites) > 1:
        parts += ["## Where", _markdown_table(site_table(result))]
    parts += ["## The worst walks", _markdown_worst_walks(result), "## How it was made"]
    parts += [f"```sh\n{result.provenance.get('command', '')}\n```"]
    parts += [_markdown_table(choices_table(result)), _markdown_table(digest_table(result))]
    return "\n\n".join(part for part in parts if part) + "\n"


def _markdown_verdicts(result: ComparisonResult, scope: Scope) -> str:
    return "\n".join(f"- {_markdown_escaped(c.verdict)}" for c in result.verdicts(scope)) or "Nothing to compare."


def _markdown_worst_walks(result: ComparisonResult) -> str:
    rows = []
    for walk in worst_walks(result.trials)[:_MAX_WORST_WALKS]:
        rows += [
            (walk.trial.site, walk.trial.walk, t.pipeline, f"{t.mean_m:.1f}", f"{t.worst_m:.1f}", t.diagnosis)
            for t in walk.worst_cases
        ]
    columns = ("site", "walk", "pipeline", "mean, m", "worst, m", "what it said of itself there")
    return _markdown_table(ReportTable(caption="", columns=columns, rows=tuple(rows)))


def _markdown_table(table: ReportTable) -> str:
    best = table.best or (frozenset[int](),) * len(table.rows)
    lines = [f"{_markdown_escaped(table.caption)}\n"] if table.caption else []
    lines.append("| " + " | ".join(map(_markdown_escaped, table.columns)) + " |")
    lines.append("|---" * len(table.columns) + "|")
    for row, good in zip(table.rows, best, strict=True):
        cells = [
            f"**{_markdown_escaped(cell)}**" if i - 1 in good else _markdown_escaped(cell) for i, cell in enumerate(row)
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _markdown_escaped(text: str) -> str:
    for character in "\\`*_[]<|":
        text = text.replace(character, f"\\{character}")
    return text


_SAMPLE_COLUMNS = (
    "site",
    "walk",
    "chain",
    "seed",
    "time_s",
    "travelled_m",
    "floor",
    "x_m",
    "y_m",
    "covered",
    "pipeline",
)
_ERROR_COLUMNS = ("error_m", "storeys_off", "nees", "density_level")


def write_csv(result: ComparisonResult, folder: Path) -> None:
    """Write ``samples.csv``, a line per waypoint and pipeline, ``metrics.csv`` and ``comparisons.csv``."""
    _write_csv_file(folder / "samples.csv", (*_SAMPLE_COLUMNS, *_ERROR_COLUMNS), _sample_rows(result))
    _write_csv_file(folder / "metrics.csv", ("pipeline", "group", "metric", "value"), _metric_rows(result))
    plain = [
        {name: value for name, value in c.as_json().items() if name not in ("interval_m", "worse_walks")}
        | {"low_m": c.interval.low_m, "high_m": c.interval.high_m}
        for c in result.comparisons
    ]
    columns = list(plain[0]) if plain else ["pipeline"]
    _write_csv_file(folder / "comparisons.csv", columns, ([row[name] for name in columns] for row in plain))


def _sample_rows(result: ComparisonResult) -> Iterator[list[Any]]:
    chains = chain_names(result.trials)
    for trial in result.trials:
        for name, outcome in trial.outcomes.items():
            truth, sample_errors = outcome.samples, outcome.at_samples
            for i in range(len(truth)):
                yield [
                    trial.site,
                    trial.walk,
                    chains.get((trial.site, trial.walk), ""),
                    trial.seed,
                    (int(truth.t_ns[i]) - int(truth.t_ns[0])) * 1e-9,
                    float(truth.travelled_m[i]),
                    truth.floors[i],
                    *truth.xy[i].tolist(),
                    int(outcome.covered[i]),
                    name,
                    *(
                        _csv_value(sample_errors, column, i)
                        for column in ("error_m", "storeys_off", "nees", "density_level")
                    ),
                ]


def _csv_value(sample_errors: Any, column: str, i: int) -> Any:
    value = getattr(sample_errors, column)[i].item()
    return "" if value != value or (column == "storeys_off" and value < 0) else value  # noqa: PLR0124 - NaN


def _metric_rows(result: ComparisonResult) -> Iterator[tuple[Any, ...]]:
    groups = [*(scope.value for scope in Scope), "tracks", "cost"]
    for name, group in chain.from_iterable(((name, group) for group in groups) for name in result.pipelines):
        for figure, value in result.metrics[name][group].items():
            if not isinstance(value, dict):
                yield name, group, figure, "" if value is None else value


def _write_csv_file(path: Path, columns: Sequence[str], rows: Any) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)


def write_report(result: ComparisonResult, floors: Mapping[tuple[str, str], Floor], folder: Path, *, draw: int) -> Path:
    """Write a report and return its page.

    ::

        report.html            the page, which needs no other file
        report.md, figures/    the same as Markdown, with its figures as SVG
        report.json            what ``tickfix compare --json`` prints
        points.csv, figures.csv, comparisons.csv

    Args:
        result: what it is about.
        floors: plans by ground and floor.
        folder: which must exist; a report in it is replaced.
        draw: greatest number of walks to draw.
    """
    figures = folder / "figures"
    figures.mkdir(exist_ok=True)
    for old in figures.glob("*.svg"):
        old.unlink()
    charts = draw_charts(result, figures)
    page = folder / "report.html"
    page.write_text(html_page(result, charts, floors, draw=draw), "utf-8")
    (folder / "report.md").write_text(markdown_report(result, charts), "utf-8")
    document = json.dumps(result.as_json(), indent=2, ensure_ascii=False, allow_nan=False)
    (folder / "report.json").write_text(document + "\n", "utf-8")
    write_csv(result, folder)
    return page
