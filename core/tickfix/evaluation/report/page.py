"""The report as one HTML page: everything is in it, and it asks no network for anything."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any, Final

from tickfix.api import Floor
from tickfix.evaluation.comparison.points import Scope
from tickfix.evaluation.comparison.result import Result
from tickfix.evaluation.report.chart import Chart
from tickfix.evaluation.report.elements import figure_html, table_html
from tickfix.evaluation.report.page_walks import walks_html
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

_LISTED: Final = 12


def html_page(result: Result, charts: Sequence[Chart], floors: Mapping[tuple[str, str], Floor], *, draw: int) -> str:
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
        _summary(result, len(walks)),
        _section("Verdict", _verdicts(result)),
        _section("Figures", "".join(figure_html(chart, i) for i, chart in enumerate(charts))),
        _section("Errors", "".join(table_html(table) for table in error_tables(result))),
        _section("Differences", _comparisons(result)),
        _section("Tracks", table_html(track_table(result))),
        _section("Uncertainty", table_html(trust_table(result))),
        _section("Cost", table_html(cost_table(result))),
        _section("Where", table_html(ground_table(result)) if len(result.grounds) > 1 else ""),
        _section("Walks, the worst first", walks_html(result, drawn, len(walks), floors)),
        _section("How it was made", _provenance(result)),
    ]
    style = files("tickfix.evaluation.report").joinpath("page.css").read_text("utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>tickfix compare: {escape(names[:80])}</title>"
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{style}</style></head><body>\n{chr(10).join(sections)}\n</body></html>\n"
    )


def _section(title: str, body: str) -> str:
    return f"<section><h2>{escape(title)}</h2>\n{body}\n</section>" if body else ""


def _summary(result: Result, walks: int) -> str:
    seeds = result.provenance.get("seeds", [0])
    points, covered = len(result.points[Scope.ALL]), len(result.points[Scope.COVERED])
    text = (
        f"{walks} walks on {len(result.grounds)} {'site' if len(result.grounds) == 1 else 'sites'}, "
        f"{len(seeds)} {'seed' if len(seeds) == 1 else 'seeds'}; {points} errors at waypoints where every pipeline has "
        f"an estimate, {covered} of them covered by the survey. Baseline: {result.baseline}."
    )
    return f"<p>{escape(text)}</p>"


def _verdicts(result: Result) -> str:
    if not result.verdicts():
        only = len(result.pipelines) == 1
        return f"<p>{'There is nothing to compare one pipeline with.' if only else 'No waypoint was scored.'}</p>"
    parts = [_items(result, Scope.ALL)]
    if result.partly_covered:
        parts.append("<p>At the waypoints covered by the survey:</p>" + _items(result, Scope.COVERED))
    note = (
        "Differences are pipeline less baseline. Intervals and tests take chains of walks as a whole; p is corrected "
        f"for {len(result.verdicts())} {'pipeline' if len(result.verdicts()) == 1 else 'pipelines'} compared (Holm). "
        f"The verdict is about the {result.metric} over all scored waypoints."
    )
    return "".join(parts) + f'<p class="note">{escape(note)}</p>'


def _items(result: Result, scope: Scope) -> str:
    items = []
    for c in result.verdicts(scope):
        worse = ""
        if c.worse_on and scope is Scope.ALL:
            named = ", ".join(f"{walk} (+{by_m:.1f} m)" for walk, by_m in c.worse_on[:_LISTED])
            more = f" and {len(c.worse_on) - _LISTED} more" if len(c.worse_on) > _LISTED else ""
            worse = f"<br><small>worse on {escape(named)}{more}</small>"
        items.append(f'<li class="{c.answer.name.lower()}">{escape(c.verdict)}{worse}</li>')
    return f'<ul class="verdicts">{"".join(items)}</ul>'


def _comparisons(result: Result) -> str:
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


def _provenance(result: Result) -> str:
    p = result.provenance
    rows: list[tuple[str, Any]] = [
        ("command", p.get("command", "")),
        ("in folder", p.get("folder", "")),
        ("versions", ", ".join(f"{name} {version}" for name, version in p.get("versions", {}).items())),
        ("seeds", ", ".join(map(str, p.get("seeds", [])))),
        ("start", "first waypoint told" if p.get("start_known") else "unknown"),
        ("cross-validation", _folds(p.get("crossvalidation"))),
        ("messages", ", ".join(f"{name} {count}" for name, count in result.summary.intake.items())),
        ("stage failures", ", ".join(f"{name} ({n} ticks)" for name, n in result.failures.items()) or "none"),
    ]
    listed = "".join(f"<dt>{escape(name)}</dt><dd>{escape(str(value))}</dd>" for name, value in rows if value != "")
    code = tuple((name, digest) for name, digest in p.get("code", {}).items())
    sites = tuple((g["name"], g["walks"], g["site"]) for g in p.get("grounds", []))
    tables = [
        settings_table(result),
        digest_table(result),
        Table(caption="SHA-256 of the code that ran", columns=("pipeline", "code"), rows=code),
        Table(caption="SHA-256 of the sites", columns=("site", "walks", "digest"), rows=_texts(sites)),
        Table(
            caption="SHA-256 of the walks",
            columns=("site", "walk", "file"),
            rows=tuple(dict.fromkeys((t.ground, t.walk, t.sha256) for t in result.trials)),
        ),
    ]
    details = "".join(
        f"<details><summary>{escape(t.caption)}</summary>{table_html(t)}</details>" for t in tables if t.rows
    )
    return f"<dl>{listed}</dl>{details}"


def _folds(found: Mapping[str, Any] | None) -> str:
    return "" if not found else f"{found['folds']} folds a floor, {found['spare']:g} of the walks left alone"


def _texts(rows: Iterable[tuple[Any, ...]]) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(map(str, row)) for row in rows)
