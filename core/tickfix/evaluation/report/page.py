"""The report as one HTML page: everything is in it, and it asks no network for anything."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any, Final

from tickfix.api import Floor
from tickfix.evaluation.comparison.points import Scope
from tickfix.evaluation.comparison.result import Result
from tickfix.evaluation.report.chart import Chart
from tickfix.evaluation.report.charts import chosen, looks
from tickfix.evaluation.report.plans import plan_symbols, walk_pictures
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
from tickfix.evaluation.report.trouble import WorstWalk, worst_walks

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
        _section("Figures", "".join(_figure(chart, i) for i, chart in enumerate(charts))),
        _section("Errors", "".join(_table(table) for table in error_tables(result))),
        _section("Differences", _comparisons(result)),
        _section("Tracks", _table(track_table(result))),
        _section("Uncertainty", _table(trust_table(result))),
        _section("Cost", _table(cost_table(result))),
        _section("Where", _table(ground_table(result)) if len(result.grounds) > 1 else ""),
        _section("Walks, the worst first", _walks(result, drawn, len(walks), floors)),
        _section("How it was made", _provenance(result)),
    ]
    style = files("tickfix.evaluation.report").joinpath("page.css").read_text("utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>tickfix compare: {escape(names[:80])}</title>"
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{style}</style></head><body>\n{chr(10).join(sections)}\n</body></html>\n"
    )


def inline(svg: str, prefix: str) -> str:
    """Return an SVG file as part of a page: without prolog, and with ids that no other figure has."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}\1"', body)
    body = re.sub(r"url\(#([^)]+)\)", rf"url(#{prefix}\1)", body)
    return re.sub(r'xlink:href="#([^"]+)"', rf'xlink:href="#{prefix}\1"', body)


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
    return _table(comparison_table(result.comparisons, caption)) + f'<p class="note">{note}</p>'


def _figure(chart: Chart, number: int) -> str:
    svg = inline(chart.path.read_text("utf-8"), f"f{number}-")
    return (
        f"<figure>{svg}<figcaption><b>{escape(chart.title)}.</b> {escape(chart.caption)} "
        f"<small>{escape(chart.path.parent.name)}/{escape(chart.path.name)}</small></figcaption></figure>\n"
    )


def _table(table: Table) -> str:
    best = table.best or (frozenset[int](),) * len(table.rows)
    head = "".join(f"<th>{escape(title)}</th>" for title in table.columns)
    body = "".join(
        "<tr>" + "".join(_cell(i, cell, is_best=i - 1 in good) for i, cell in enumerate(row)) + "</tr>\n"
        for row, good in zip(table.rows, best, strict=True)
    )
    caption = f"<caption>{escape(table.caption)}</caption>"
    return f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>\n'


def _cell(column: int, text: str, *, is_best: bool) -> str:
    if column == 0:
        return f"<th>{escape(text)}</th>"
    shown = f"<b>{escape(text)}</b>" if is_best else escape(text)
    return f"<td>{shown}</td>"


def _walks(result: Result, drawn: Sequence[WorstWalk], total: int, floors: Mapping[tuple[str, str], Floor]) -> str:
    if not drawn:
        return ""
    used = {(walk.trial.ground, floor) for walk in drawn for floor in _any_floors(walk)}
    plans = {key: floor for key, floor in floors.items() if key in used}
    look = looks(result)
    key = "".join(
        f'<span class="key"><svg width="34" height="8"><line x1="0" y1="4" x2="34" y2="4" stroke="{line.color}" '
        f'stroke-width="{1.2 * line.width:g}" stroke-dasharray="{_dashes(line.dashes)}"/></svg>{escape(name)}</span>'
        for name, line in look.items()
    )
    told = f"{len(drawn)} of {total} walks are drawn; --draw {total} draws all. " if len(drawn) < total else ""
    what = (
        f"{told}Black: truth at waypoints, straight between them; the ring is the start. Tracks as published, a place "
        "a second. A square marks the waypoint at which the pipeline of that colour was worst."
    )
    missing = [name for name in result.pipelines if name not in chosen(result)]
    if missing:
        what += f" Not drawn: {', '.join(missing)}."
    pictures = "".join(_walk(walk, plans, result) for walk in drawn)
    return f'{plan_symbols(plans)}<p class="note">{escape(what)}</p><p>{key}</p>{pictures}'


def _walk(walk: WorstWalk, plans: Mapping[tuple[str, str], Floor], result: Result) -> str:
    trial = walk.trial
    seed = f", seed {trial.seed}" if len(result.provenance.get("seeds", [])) > 1 else ""
    title = f"{trial.ground}: {trial.walk}{seed}"
    pictures = "".join(
        f"{svg}<div><small>{escape(floor)}</small></div>" for floor, svg in walk_pictures(walk, plans, looks(result))
    )
    rows = tuple(
        (
            t.pipeline,
            f"{t.mean_m:.1f}",
            f"{t.worst_m:.1f}",
            f"{t.worst_s:.0f}",
            "; ".join(filter(None, (t.floor, "" if t.covered else "not surveyed", t.words))),
        )
        for t in walk.troubles
    )
    columns = ("pipeline", "mean, m", "worst, m", "at, s", "what the pipeline said of itself there")
    table = Table(caption="", columns=columns, rows=rows)
    body = _table(table) if rows else "<p>No waypoint was scored.</p>"
    return f'<article class="walk"><h3>{escape(title)}</h3>{pictures}{body}</article>\n'


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
    details = "".join(f"<details><summary>{escape(t.caption)}</summary>{_table(t)}</details>" for t in tables if t.rows)
    return f"<dl>{listed}</dl>{details}"


def _folds(found: Mapping[str, Any] | None) -> str:
    return "" if not found else f"{found['folds']} folds a floor, {found['spare']:g} of the walks left alone"


def _texts(rows: Iterable[tuple[Any, ...]]) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(map(str, row)) for row in rows)


def _any_floors(walk: WorstWalk) -> set[str]:
    outcome = next(iter(walk.trial.outcomes.values()))
    return set(outcome.points.floors) | {outcome.floor}


def _dashes(dashes: Any) -> str:
    return "none" if dashes == "solid" else " ".join(f"{2 * d:g}" for d in dashes[1])
