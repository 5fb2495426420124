"""The report as one self-contained HTML page: tables, charts, and the worst walks on their floor plans."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any, Final

from tickfix.api import Floor
from tickfix.evaluation.comparison.comparison_result import ComparisonResult
from tickfix.evaluation.comparison.pooled_metrics import Scope
from tickfix.evaluation.report.charts import Chart, drawn_pipelines, pipeline_styles
from tickfix.evaluation.report.report_data import (
    ReportTable,
    WorstWalk,
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
from tickfix.evaluation.report.walk_plans import plan_symbols, walk_pictures


def table_html(table: ReportTable) -> str:
    """Return a table, what is best of a column in bold."""
    best = table.best or (frozenset[int](),) * len(table.rows)
    head = "".join(f"<th>{escape(title)}</th>" for title in table.columns)
    body = "".join(
        "<tr>" + "".join(_cell_html(i, cell, is_best=i - 1 in good) for i, cell in enumerate(row)) + "</tr>\n"
        for row, good in zip(table.rows, best, strict=True)
    )
    caption = f"<caption>{escape(table.caption)}</caption>"
    return f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>\n'


def figure_html(chart: Chart, number: int) -> str:
    """Return a figure with its caption; ``number`` is its own in the page."""
    svg = inline_svg(chart.path.read_text("utf-8"), f"f{number}-")
    return (
        f"<figure>{svg}<figcaption><b>{escape(chart.title)}.</b> {escape(chart.caption)} "
        f"<small>{escape(chart.path.parent.name)}/{escape(chart.path.name)}</small></figcaption></figure>\n"
    )


def inline_svg(svg: str, prefix: str) -> str:
    """Return an SVG file as part of a page: without prolog, and with ids that no other figure has."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}\1"', body)
    body = re.sub(r"url\(#([^)]+)\)", rf"url(#{prefix}\1)", body)
    return re.sub(r'xlink:href="#([^"]+)"', rf'xlink:href="#{prefix}\1"', body)


def _cell_html(column: int, text: str, *, is_best: bool) -> str:
    if column == 0:
        return f"<th>{escape(text)}</th>"
    shown = f"<b>{escape(text)}</b>" if is_best else escape(text)
    return f"<td>{shown}</td>"


def walks_html(
    result: ComparisonResult, drawn: Sequence[WorstWalk], total: int, floors: Mapping[tuple[str, str], Floor]
) -> str:
    """Return the walks that are drawn, of so many in all, with a key of the lines; nothing where none is.

    Args:
        result: what the page is about.
        drawn: the worst walks, the worst first.
        total: number of walks.
        floors: plans by ground and floor.
    """
    if not drawn:
        return ""
    drawn_floors = {(walk.trial.site, floor) for walk in drawn for floor in _floors_of_walk(walk)}
    plans = {key: floor for key, floor in floors.items() if key in drawn_floors}
    style = pipeline_styles(result)
    key = "".join(
        f'<span class="key"><svg width="34" height="8"><line x1="0" y1="4" x2="34" y2="4" stroke="{line.color}" '
        f'stroke-width="{1.2 * line.width:g}" stroke-dasharray="{_svg_dashes(line.dashes)}"/></svg>'
        f"{escape(name)}</span>"
        for name, line in style.items()
    )
    note = f"{len(drawn)} of {total} walks are drawn; --draw {total} draws all. " if len(drawn) < total else ""
    what = (
        f"{note}Black: truth at waypoints, straight between them; the ring is the start. Tracks as published, a place "
        "a second. A square marks the waypoint at which the pipeline of that colour was worst."
    )
    missing = [name for name in result.pipelines if name not in drawn_pipelines(result)]
    if missing:
        what += f" Not drawn: {', '.join(missing)}."
    pictures = "".join(_walk_html(walk, plans, result) for walk in drawn)
    return f'{plan_symbols(plans)}<p class="note">{escape(what)}</p><p>{key}</p>{pictures}'


def _walk_html(walk: WorstWalk, plans: Mapping[tuple[str, str], Floor], result: ComparisonResult) -> str:
    trial = walk.trial
    seed = f", seed {trial.seed}" if len(result.provenance.get("seeds", [])) > 1 else ""
    title = f"{trial.site}: {trial.walk}{seed}"
    pictures = "".join(
        f"{svg}<div><small>{escape(floor)}</small></div>"
        for floor, svg in walk_pictures(walk, plans, pipeline_styles(result))
    )
    rows = tuple(
        (
            t.pipeline,
            f"{t.mean_m:.1f}",
            f"{t.worst_m:.1f}",
            f"{t.worst_s:.0f}",
            "; ".join(filter(None, (t.floor, "" if t.covered else "not surveyed", t.diagnosis))),
        )
        for t in walk.worst_cases
    )
    columns = ("pipeline", "mean, m", "worst, m", "at, s", "what the pipeline said of itself there")
    table = ReportTable(caption="", columns=columns, rows=rows)
    body = table_html(table) if rows else "<p>No waypoint was scored.</p>"
    return f'<article class="walk"><h3>{escape(title)}</h3>{pictures}{body}</article>\n'


def _floors_of_walk(walk: WorstWalk) -> set[str]:
    outcome = next(iter(walk.trial.outcomes.values()))
    return set(outcome.samples.floors) | {outcome.floor}


def _svg_dashes(dashes: Any) -> str:
    return "none" if dashes == "solid" else " ".join(f"{2 * d:g}" for d in dashes[1])


_MAX_LISTED: Final = 12


def html_page(
    result: ComparisonResult, charts: Sequence[Chart], floors: Mapping[tuple[str, str], Floor], *, draw: int
) -> str:
    """Return the page.

    Args:
        result: what it is about.
        charts: drawn already; their SVGs become part of the page.
        floors: plans by ground and floor.
        draw: greatest number of walks to draw, the worst first.
    """
    walks = worst_walks(result.trials)
    drawn = walks[:draw]
    names = ", ".join(result.pipelines)
    sections = [
        f"<h1>Comparison of {escape(names if len(names) < 120 else f'{len(result.pipelines)} pipelines')}</h1>",
        _summary_html(result, len(walks)),
        _section_html("Verdict", _verdicts_html(result)),
        _section_html("Figures", "".join(figure_html(chart, i) for i, chart in enumerate(charts))),
        _section_html("Errors", "".join(table_html(table) for table in error_tables(result))),
        _section_html("Differences", _comparisons_html(result)),
        _section_html("Tracks", table_html(track_table(result))),
        _section_html("Uncertainty", table_html(uncertainty_table(result))),
        _section_html("Cost", table_html(cost_table(result))),
        _section_html("Where", table_html(site_table(result)) if len(result.sites) > 1 else ""),
        _section_html("Walks, the worst first", walks_html(result, drawn, len(walks), floors)),
        _section_html("How it was made", _provenance_html(result)),
    ]
    style = files("tickfix.evaluation.report").joinpath("report.css").read_text("utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>tickfix compare: {escape(names[:80])}</title>"
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{style}</style></head><body>\n{chr(10).join(sections)}\n</body></html>\n"
    )


def _section_html(title: str, body: str) -> str:
    return f"<section><h2>{escape(title)}</h2>\n{body}\n</section>" if body else ""


def _summary_html(result: ComparisonResult, walks: int) -> str:
    seeds = result.provenance.get("seeds", [0])
    samples, covered = len(result.samples[Scope.ALL]), len(result.samples[Scope.COVERED])
    text = (
        f"{walks} walks on {len(result.sites)} {'site' if len(result.sites) == 1 else 'sites'}, "
        f"{len(seeds)} {'seed' if len(seeds) == 1 else 'seeds'}; {samples} errors at waypoints where every pipeline "
        f"has an estimate, {covered} of them covered by the survey. Baseline: {result.baseline}."
    )
    return f"<p>{escape(text)}</p>"


def _verdicts_html(result: ComparisonResult) -> str:
    if not result.verdicts():
        only = len(result.pipelines) == 1
        return f"<p>{'There is nothing to compare one pipeline with.' if only else 'No waypoint was scored.'}</p>"
    parts = [_verdict_list_html(result, Scope.ALL)]
    if result.partly_covered:
        parts.append("<p>At the waypoints covered by the survey:</p>" + _verdict_list_html(result, Scope.COVERED))
    note = (
        "Differences are pipeline less baseline. Intervals and tests take chains of walks as a whole; p is corrected "
        f"for {len(result.verdicts())} {'pipeline' if len(result.verdicts()) == 1 else 'pipelines'} compared (Holm). "
        f"The verdict is about the {result.metric} over all scored waypoints."
    )
    return "".join(parts) + f'<p class="note">{escape(note)}</p>'


def _verdict_list_html(result: ComparisonResult, scope: Scope) -> str:
    items = []
    for c in result.verdicts(scope):
        worse = ""
        if c.worse_walks and scope is Scope.ALL:
            named = ", ".join(f"{walk} (+{by_m:.1f} m)" for walk, by_m in c.worse_walks[:_MAX_LISTED])
            more = f" and {len(c.worse_walks) - _MAX_LISTED} more" if len(c.worse_walks) > _MAX_LISTED else ""
            worse = f"<br><small>worse on {escape(named)}{more}</small>"
        items.append(f'<li class="{c.conclusion.name.lower()}">{escape(c.verdict)}{worse}</li>')
    return f'<ul class="verdicts">{"".join(items)}</ul>'


def _comparisons_html(result: ComparisonResult) -> str:
    if not result.comparisons:
        return ""
    caption = (
        f"Differences from {result.baseline} in metres; p of the paired test, alone and corrected for the pipelines of "
        "a metric and scope; walks needed to tell a difference of this size, and the difference that these walks would "
        "have told, with a power of 80 %"
    )
    note = (
        "The verdict is about one metric chosen before. Searching this table for a small p finds one sooner or later."
    )
    return table_html(comparison_table(result.comparisons, caption)) + f'<p class="note">{note}</p>'


def _provenance_html(result: ComparisonResult) -> str:
    p = result.provenance
    rows: list[tuple[str, Any]] = [
        ("command", p.get("command", "")),
        ("in folder", p.get("folder", "")),
        ("versions", ", ".join(f"{name} {version}" for name, version in p.get("versions", {}).items())),
        ("seeds", ", ".join(map(str, p.get("seeds", [])))),
        ("start", "first waypoint told" if p.get("start_known") else "unknown"),
        ("cross-validation", _crossvalidation_text(p.get("crossvalidation"))),
        ("messages", ", ".join(f"{name} {count}" for name, count in result.summary.intake.items())),
        ("stage failures", ", ".join(f"{name} ({n} ticks)" for name, n in result.failures.items()) or "none"),
    ]
    listed = "".join(f"<dt>{escape(name)}</dt><dd>{escape(str(value))}</dd>" for name, value in rows if value != "")
    code = tuple((name, digest) for name, digest in p.get("code", {}).items())
    sites = tuple((g["name"], g["walks"], g["digest"]) for g in p.get("sites", []))
    tables = [
        choices_table(result),
        digest_table(result),
        ReportTable(caption="SHA-256 of the code that ran", columns=("pipeline", "code"), rows=code),
        ReportTable(caption="SHA-256 of the sites", columns=("site", "walks", "digest"), rows=_text_rows(sites)),
        ReportTable(
            caption="SHA-256 of the walks",
            columns=("site", "walk", "file"),
            rows=tuple(dict.fromkeys((t.site, t.walk, t.sha256) for t in result.trials)),
        ),
    ]
    details = "".join(
        f"<details><summary>{escape(t.caption)}</summary>{table_html(t)}</details>" for t in tables if t.rows
    )
    return f"<dl>{listed}</dl>{details}"


def _crossvalidation_text(found: Mapping[str, Any] | None) -> str:
    return "" if not found else f"{found['folds']} folds a floor, {found['spare']:g} of the walks left alone"


def _text_rows(rows: Iterable[tuple[Any, ...]]) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(map(str, row)) for row in rows)
