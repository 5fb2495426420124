"""Walks on their floor plans as small SVGs; each plan is in the page once, however many walks are drawn on it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Final

import numpy as np

from tickfix.api import Floats, Floor
from tickfix.evaluation.comparison.trial_outcomes import TrialOutcome
from tickfix.evaluation.pictures import crop
from tickfix.evaluation.report.report_data import WorstWalk
from tickfix.evaluation.theme import FOREGROUND, LineStyle

_WIDE_PX: Final = 620.0
_TALL_PX: Final = 460.0
_SCALE_BARS_M: Final = (100.0, 50.0, 20.0, 10.0, 5.0)


def plan_symbols(floors: Mapping[tuple[str, str], Floor]) -> str:
    """Return one hidden SVG that defines the plan of every floor, metres with y pointing up."""
    symbols = [
        f'<g id="{_plan_id(floors, key)}">'
        f'<path fill="#f5f5f3" fill-rule="evenodd" stroke="#bcbcb8" d="{_svg_rings(floor.outline)}"/>'
        f'<path fill="#e5e5e2" stroke="#bcbcb8" d="{_svg_rings(floor.obstacles)}"/>'
        f'<path fill="none" stroke="#8f8f8b" d="{_svg_segments(floor.walls)}"/></g>'
        for key, floor in floors.items()
    ]
    return f'<svg width="0" height="0" aria-hidden="true" class="defs"><defs>{"".join(symbols)}</defs></svg>'


def walk_pictures(
    walk: WorstWalk, floors: Mapping[tuple[str, str], Floor], styles: Mapping[str, LineStyle]
) -> tuple[tuple[str, str], ...]:
    """Return pairs (floor, SVG) of a walk, one for each floor that it visited."""
    site, outcomes = walk.trial.site, walk.trial.outcomes
    any_ = next(iter(outcomes.values()))
    visited = list(dict.fromkeys(any_.samples.floors)) or [f for f in [any_.floor] if f]
    pictures = []
    for name in visited:
        here = np.array([floor == name for floor in any_.samples.floors], dtype=np.bool_)
        tracks = {pipeline: _floor_track(outcomes[pipeline], name) for pipeline in styles}
        low, high = crop(any_.samples.xy[here], np.concatenate([np.zeros((0, 2)), *tracks.values()]))
        worst = {
            t.worst_sample: styles[t.pipeline]
            for t in walk.worst_cases
            if t.pipeline in styles and here[t.worst_sample]
        }
        marks = [(any_.samples.xy[i], style) for i, style in worst.items()]
        plan = _plan_id(floors, (site, name)) if (site, name) in floors else ""
        pictures.append((name, _walk_svg(plan, low, high, any_.samples.xy[here], tracks, styles, marks)))
    return tuple(pictures)


def _walk_svg(
    plan: str,
    low: Floats,
    high: Floats,
    truth: Floats,
    tracks: Mapping[str, Floats],
    styles: Mapping[str, LineStyle],
    marks: Sequence[tuple[Floats, LineStyle]],
) -> str:
    width_m, height_m = (high - low).tolist()
    scale = min(_WIDE_PX / width_m, _TALL_PX / height_m)
    px = 1.0 / scale
    # Widths are in metres, so that a picture taken out of the page keeps its looks.
    parts = [f'<use href="#{plan}" stroke-width="{0.7 * px:.3f}"/>'] if plan else []
    parts.append(
        f'<polyline points="{_svg_points(truth)}" fill="none" stroke="{FOREGROUND}" stroke-width="{px:.3f}" '
        f'stroke-dasharray="{5 * px:.3f} {3 * px:.3f}"/>'
    )
    for name, xy in tracks.items():
        style = styles[name]
        dashes = "none" if style.dashes == "solid" else " ".join(f"{2 * d * px:.3f}" for d in style.dashes[1])
        parts.append(
            f'<polyline points="{_svg_points(xy)}" fill="none" stroke="{style.color}" '
            f'stroke-width="{1.2 * style.width * px:.3f}" stroke-dasharray="{dashes}">'
            f"<title>{escape(name)}</title></polyline>"
        )
    parts += [f'<circle fill="{FOREGROUND}" cx="{x:.2f}" cy="{-y:.2f}" r="{3 * px:.3f}"/>' for x, y in truth.tolist()]
    if len(truth):
        x, y = truth[0].tolist()
        ring = f'fill="none" stroke="{FOREGROUND}" stroke-width="{px:.3f}"'
        parts.append(f'<circle {ring} cx="{x:.2f}" cy="{-y:.2f}" r="{8 * px:.3f}"/>')
    for (x, y), style in marks:
        side = 12 * px
        parts.append(
            f'<rect x="{x - side / 2:.2f}" y="{-y - side / 2:.2f}" width="{side:.3f}" height="{side:.3f}" '
            f'fill="none" stroke="{style.color}" stroke-width="{2.2 * px:.3f}"/>'
        )
    bar = next((b for b in _SCALE_BARS_M if b < 0.3 * width_m), _SCALE_BARS_M[-1])
    x, y = low[0] + 0.03 * width_m, -low[1] - 0.04 * height_m
    parts.append(f'<path stroke="{FOREGROUND}" stroke-width="{2 * px:.3f}" d="M{x:.2f} {y:.2f}h{bar:g}"/>')
    parts.append(f'<text x="{x:.2f}" y="{y - 4 * px:.2f}" font-size="{11 * px:.3f}">{bar:g} m</text>')
    box = f"{low[0]:.2f} {-high[1]:.2f} {width_m:.2f} {height_m:.2f}"
    size = f'width="{width_m * scale:.0f}" height="{height_m * scale:.0f}"'
    return f'<svg class="walk" viewBox="{box}" {size} role="img">{"".join(parts)}</svg>'


def _floor_track(outcome: TrialOutcome, floor: str) -> Floats:
    thinned_track = outcome.thinned_track
    if floor not in thinned_track.floors:
        return np.zeros((0, 2))
    return np.asarray(thinned_track.xy[thinned_track.floor == thinned_track.floors.index(floor)], dtype=np.float64)


def _plan_id(floors: Mapping[tuple[str, str], Floor], key: tuple[str, str]) -> str:
    return f"plan-{list(floors).index(key)}"


def _svg_points(xy: Floats) -> str:
    return " ".join(f"{x:.1f},{-y:.1f}" for x, y in xy.tolist())


def _svg_rings(rings: Iterable[Floats]) -> str:
    return "".join("M" + "L".join(f"{x:.1f} {-y:.1f}" for x, y in ring.tolist()) + "Z" for ring in rings if len(ring))


def _svg_segments(walls: Floats) -> str:
    return "".join(f"M{a[0]:.1f} {-a[1]:.1f}L{b[0]:.1f} {-b[1]:.1f}" for a, b in walls.tolist())
