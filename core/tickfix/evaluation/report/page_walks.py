"""The walks of a report's page: each on its plan, with what the pipelines said of themselves where they were worst."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from tickfix.api import Floor
from tickfix.evaluation.comparison.result import Result
from tickfix.evaluation.report.elements import table_html
from tickfix.evaluation.report.looks import chosen, looks
from tickfix.evaluation.report.plans import plan_symbols, walk_pictures
from tickfix.evaluation.report.tables import Table
from tickfix.evaluation.report.trouble import WorstWalk


def walks_html(result: Result, drawn: Sequence[WorstWalk], total: int, floors: Mapping[tuple[str, str], Floor]) -> str:
    """Return the walks that are drawn, of so many in all, with a key of the lines; nothing where none is.

    Args:
        result: what the page is about.
        drawn: the worst walks, the worst first.
        total: number of walks.
        floors: plans by ground and floor.
    """
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
    body = table_html(table) if rows else "<p>No waypoint was scored.</p>"
    return f'<article class="walk"><h3>{escape(title)}</h3>{pictures}{body}</article>\n'


def _any_floors(walk: WorstWalk) -> set[str]:
    outcome = next(iter(walk.trial.outcomes.values()))
    return set(outcome.points.floors) | {outcome.floor}


def _dashes(dashes: Any) -> str:
    return "none" if dashes == "solid" else " ".join(f"{2 * d:g}" for d in dashes[1])
