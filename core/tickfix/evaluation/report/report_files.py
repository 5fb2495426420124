"""The folder of a report: renders HTML, Markdown and JSON from one :class:`ReportData`, and writes CSV."""

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
from tickfix.evaluation.report.charts import draw_charts, pipeline_styles
from tickfix.evaluation.report.html_report import html_page
from tickfix.evaluation.report.report_data import Chart, ReportData, ReportSection, Verdict, build_report
from tickfix.evaluation.report.report_tables import ReportTable

_MAX_WORST_WALKS: Final = 20


def markdown_report(report: ReportData, charts: Sequence[Chart]) -> str:
    """Return the report as Markdown; figures are linked."""
    parts = [f"# {_markdown_escaped(report.title)}", _markdown_escaped(report.summary), "## Verdict"]
    parts.append(_markdown_verdicts(report.verdicts) or report.no_verdict)
    if report.covered_verdicts:
        parts += ["At the waypoints covered by the survey:", _markdown_verdicts(report.covered_verdicts)]
    parts += [_markdown_escaped(report.verdict_note), *_markdown_section(report.errors)]
    if charts:
        parts.append("## Figures")
    parts += [f"![{c.title}]({c.path.parent.name}/{c.path.name})\n\n**{c.title}.** {c.caption}" for c in charts]
    for section in report.details:
        parts += _markdown_section(section)
    parts.append("## Worst walks")
    for walk in report.walks[:_MAX_WORST_WALKS]:
        if walk.worst_cases:
            parts += [_markdown_escaped(f"{walk.trial.site}: {walk.trial.walk}"), _markdown_table(walk.table())]
    parts += ["## Provenance", f"```sh\n{report.command}\n```"]
    parts += [f"- {name}: {_markdown_escaped(value)}" for name, value in report.provenance if name != "command"]
    parts += [_markdown_table(table) for table in report.provenance_tables]
    return "\n\n".join(part for part in parts if part) + "\n"


def _markdown_verdicts(verdicts: Sequence[Verdict]) -> str:
    return "\n".join(
        f"- {_markdown_escaped(v.sentence)}{f'; worse on {_markdown_escaped(v.worse_on)}' if v.worse_on else ''}"
        for v in verdicts
    )


def _markdown_section(section: ReportSection) -> list[str]:
    if not section.tables:
        return []
    return [f"## {section.title}", *map(_markdown_table, section.tables), _markdown_escaped(section.note)]


def _markdown_table(table: ReportTable) -> str:
    lines = [f"{_markdown_escaped(table.caption)}\n"] if table.caption else []
    lines.append("| " + " | ".join(map(_markdown_escaped, table.columns)) + " |")
    lines.append("|---" * len(table.columns) + "|")
    for row in table.marked_rows():
        cells = [f"**{_markdown_escaped(cell)}**" if is_best else _markdown_escaped(cell) for cell, is_best in row]
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
    """Write a report and return the path of its page.

    ::

        report.html            the page, which needs no other file
        report.md, figures/    the same as Markdown, with its figures as SVG
        report.json            what ``tickfix compare --json`` prints
        samples.csv, metrics.csv, comparisons.csv

    Args:
        result: what it is about.
        floors: plans by site and floor.
        folder: an existing folder; a report in it is replaced.
        draw: greatest number of walks to draw.
    """
    figures = folder / "figures"
    figures.mkdir(exist_ok=True)
    for old in figures.glob("*.svg"):
        old.unlink()
    report = build_report(result)
    charts = draw_charts(result, figures)
    page = folder / "report.html"
    page.write_text(html_page(report, charts, pipeline_styles(result), floors, draw=draw), "utf-8")
    (folder / "report.md").write_text(markdown_report(report, charts), "utf-8")
    document = json.dumps(report.document, indent=2, ensure_ascii=False, allow_nan=False)
    (folder / "report.json").write_text(document + "\n", "utf-8")
    write_csv(result, folder)
    return page
