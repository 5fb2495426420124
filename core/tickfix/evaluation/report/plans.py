"""Walks on their floor plans as small SVGs: the plan stands in the page once, however many walks are drawn on it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Final

import numpy as np

from tickfix.api import Floats, Floor
from tickfix.evaluation.comparison.outcome import Outcome
from tickfix.evaluation.plan import crop
from tickfix.evaluation.report.trouble import WorstWalk
from tickfix.evaluation.style import INK, Line

_WIDE_PX: Final = 620.0
_TALL_PX: Final = 460.0
_BARS_M: Final = (100.0, 50.0, 20.0, 10.0, 5.0)


def plan_symbols(floors: Mapping[tuple[str, str], Floor]) -> str:
    """Return one hidden SVG that defines the plan of every floor, metres with y pointing up."""
    symbols = [
        f'<g id="{_plan_id(floors, key)}">'
        f'<path fill="#f5f5f3" fill-rule="evenodd" stroke="#bcbcb8" d="{_rings(floor.outline)}"/>'
        f'<path fill="#e5e5e2" stroke="#bcbcb8" d="{_rings(floor.obstacles)}"/>'
        f'<path fill="none" stroke="#8f8f8b" d="{_segments(floor.walls)}"/></g>'
        for key, floor in floors.items()
    ]
    return f'<svg width="0" height="0" aria-hidden="true" class="defs"><defs>{"".join(symbols)}</defs></svg>'


def walk_pictures(
    walk: WorstWalk, floors: Mapping[tuple[str, str], Floor], looks: Mapping[str, Line]
) -> tuple[tuple[str, str], ...]:
    """Return pairs (floor, SVG) of a walk, one for each floor that it visited."""
    ground, outcomes = walk.trial.ground, walk.trial.outcomes
    any_ = next(iter(outcomes.values()))
    visited = list(dict.fromkeys(any_.points.floors)) or [f for f in [any_.floor] if f]
    pictures = []
    for name in visited:
        here = np.array([floor == name for floor in any_.points.floors], dtype=np.bool_)
        ways = {pipeline: _way(outcomes[pipeline], name) for pipeline in looks}
        low, high = crop(any_.points.xy[here], np.concatenate([np.zeros((0, 2)), *ways.values()]))
        worst = {t.worst_point: looks[t.pipeline] for t in walk.troubles if t.pipeline in looks and here[t.worst_point]}
        marks = [(any_.points.xy[i], look) for i, look in worst.items()]
        plan = _plan_id(floors, (ground, name)) if (ground, name) in floors else ""
        pictures.append((name, _picture(plan, low, high, any_.points.xy[here], ways, looks, marks)))
    return tuple(pictures)


def _picture(
    plan: str,
    low: Floats,
    high: Floats,
    truth: Floats,
    ways: Mapping[str, Floats],
    looks: Mapping[str, Line],
    marks: Sequence[tuple[Floats, Line]],
) -> str:
    wide, tall = (high - low).tolist()
    scale = min(_WIDE_PX / wide, _TALL_PX / tall)
    px = 1.0 / scale
    # Widths are in metres, so that a picture taken out of the page keeps its looks.
    parts = [f'<use href="#{plan}" stroke-width="{0.7 * px:.3f}"/>'] if plan else []
    parts.append(
        f'<polyline points="{_points(truth)}" fill="none" stroke="{INK}" stroke-width="{px:.3f}" '
        f'stroke-dasharray="{5 * px:.3f} {3 * px:.3f}"/>'
    )
    for name, xy in ways.items():
        look = looks[name]
        dashes = "none" if look.dashes == "solid" else " ".join(f"{2 * d * px:.3f}" for d in look.dashes[1])
        parts.append(
            f'<polyline points="{_points(xy)}" fill="none" stroke="{look.color}" '
            f'stroke-width="{1.2 * look.width * px:.3f}" stroke-dasharray="{dashes}">'
            f"<title>{escape(name)}</title></polyline>"
        )
    parts += [f'<circle fill="{INK}" cx="{x:.2f}" cy="{-y:.2f}" r="{3 * px:.3f}"/>' for x, y in truth.tolist()]
    if len(truth):
        x, y = truth[0].tolist()
        ring = f'fill="none" stroke="{INK}" stroke-width="{px:.3f}"'
        parts.append(f'<circle {ring} cx="{x:.2f}" cy="{-y:.2f}" r="{8 * px:.3f}"/>')
    for (x, y), look in marks:
        side = 12 * px
        parts.append(
            f'<rect x="{x - side / 2:.2f}" y="{-y - side / 2:.2f}" width="{side:.3f}" height="{side:.3f}" '
            f'fill="none" stroke="{look.color}" stroke-width="{2.2 * px:.3f}"/>'
        )
    bar = next((b for b in _BARS_M if b < 0.3 * wide), _BARS_M[-1])
    x, y = low[0] + 0.03 * wide, -low[1] - 0.04 * tall
    parts.append(f'<path stroke="{INK}" stroke-width="{2 * px:.3f}" d="M{x:.2f} {y:.2f}h{bar:g}"/>')
    parts.append(f'<text x="{x:.2f}" y="{y - 4 * px:.2f}" font-size="{11 * px:.3f}">{bar:g} m</text>')
    box = f"{low[0]:.2f} {-high[1]:.2f} {wide:.2f} {tall:.2f}"
    size = f'width="{wide * scale:.0f}" height="{tall * scale:.0f}"'
    return f'<svg class="walk" viewBox="{box}" {size} role="img">{"".join(parts)}</svg>'


def _way(outcome: Outcome, floor: str) -> Floats:
    sketch = outcome.sketch
    if floor not in sketch.floors:
        return np.zeros((0, 2))
    return np.asarray(sketch.xy[sketch.floor == sketch.floors.index(floor)], dtype=np.float64)


def _plan_id(floors: Mapping[tuple[str, str], Floor], key: tuple[str, str]) -> str:
    return f"plan-{list(floors).index(key)}"


def _points(xy: Floats) -> str:
    return " ".join(f"{x:.1f},{-y:.1f}" for x, y in xy.tolist())


def _rings(rings: Iterable[Floats]) -> str:
    return "".join("M" + "L".join(f"{x:.1f} {-y:.1f}" for x, y in ring.tolist()) + "Z" for ring in rings if len(ring))


def _segments(walls: Floats) -> str:
    return "".join(f"M{a[0]:.1f} {-a[1]:.1f}L{b[0]:.1f} {-b[1]:.1f}" for a, b in walls.tolist())
