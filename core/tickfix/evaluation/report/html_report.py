"""The report as one self-contained HTML page, rendered from ``report.html.jinja``.

The template has all markup and styles; this module computes what it places: charts as inline SVG, and the geometry of
walks on their floor plans. A plan is in the page once, however many walks are drawn on it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from tickfix.api import Floats, Floor
from tickfix.evaluation.comparison.trial_outcomes import TrialOutcome
from tickfix.evaluation.pictures import crop
from tickfix.evaluation.report.report_data import Chart, ReportData, WorstWalk
from tickfix.evaluation.theme import FOREGROUND, MUTED, LineStyle

_TEMPLATE: Final = "report.html.jinja"


def html_page(
    report: ReportData,
    charts: Sequence[Chart],
    styles: Mapping[str, LineStyle],
    floors: Mapping[tuple[str, str], Floor],
    *,
    draw: int,
) -> str:
    """Return the page.

    Args:
        report: what it shows.
        charts: written already; their SVGs become part of the page.
        styles: the line style of each pipeline whose tracks are drawn.
        floors: plans by site and floor.
        draw: greatest number of walks to draw, the worst first.
    """
    drawn = report.walks[:draw]
    drawn_floors = {(walk.trial.site, floor) for walk in drawn for floor in _floors_of_walk(walk)}
    plans = {key: floor for key, floor in floors.items() if key in drawn_floors}
    # Autoescape covers every text; the only markup from outside the template are SVG files that we wrote ourselves.
    environment = Environment(
        loader=PackageLoader("tickfix.evaluation", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template(_TEMPLATE).render(
        report=report,
        charts=[_page_chart(chart, i) for i, chart in enumerate(charts)],
        plans=[_page_plan(plan) for plan in plans.values()],
        walks=[_page_walk(walk, list(plans), styles, report) for walk in drawn],
        line_styles={name: (style.color, style.width, _dash_pattern(style, 2.0)) for name, style in styles.items()},
        not_drawn=[name for name in report.pipelines if name not in styles],
        foreground=FOREGROUND,
    )
    return f"{page}\n"


@dataclass(frozen=True, slots=True)
class _PageChart:
    chart: Chart
    svg: Markup
    is_wide: bool


_WIDE_PT: Final = 440.0
"""A chart wider than this takes two columns, so that the text of all charts has about the same size."""
_PAGE_COLORS: Final = {"#ffffff": "paper", FOREGROUND: "ink", MUTED: "muted", "#e4e4e2": "rule"}
"""The neutral colours of the charts, and the CSS variables that replace them in the page, where they depend on whether
the reader's screen is light or dark."""


def _page_chart(chart: Chart, number: int) -> _PageChart:
    svg = inline_svg(chart.path.read_text("utf-8"), f"f{number}-")
    if not chart.keeps_colors:
        for color, variable in _PAGE_COLORS.items():
            # The fallback keeps a figure that is copied out of the page as it was.
            svg = svg.replace(f": {color}", f": var(--{variable}, {color})")
    size = re.search(r'viewBox="\S+ \S+ (\S+) \S+"', svg)
    is_wide = size is not None and float(size[1]) > _WIDE_PT
    return _PageChart(chart, Markup(svg), is_wide)  # noqa: S704 - an SVG that draw_charts wrote


def inline_svg(svg: str, prefix: str) -> str:
    """Return an SVG file as part of a page: without prolog, and with ids that no other figure has."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}\1"', body)
    body = re.sub(r"url\(#([^)]+)\)", rf"url(#{prefix}\1)", body)
    return re.sub(r'xlink:href="#([^"]+)"', rf'xlink:href="#{prefix}\1"', body)


_WIDTH_PX: Final = 620.0
_HEIGHT_PX: Final = 460.0
_SCALE_BARS_M: Final = (100.0, 50.0, 20.0, 10.0, 5.0)


@dataclass(frozen=True, slots=True)
class _PagePlan:
    """SVG path data of a floor plan, metres, y down as SVG has it."""

    outline: str
    obstacles: str
    walls: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _PageTrack:
    pipeline: str
    points: str
    color: str
    width: float
    dashes: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _WalkPicture:
    """A walk on one floor: metres, y down; ``px`` is the length of a pixel in metres.

    Attributes:
        floor, plan: name of the floor, and the index of its plan in the page; None if it has none.
        view_box: left, top, width, height.
        px: metres per pixel at the picture's natural size.
        truth: waypoints as pairs (x, y).
        truth_points: the same as SVG points.
        tracks: of the pipelines.
        worst: corners (x, y) of the squares at the worst waypoints, each with its colour.
        scale_bar: x, y and length.
    """

    floor: str
    plan: int | None
    view_box: tuple[float, float, float, float]
    px: float
    truth: list[tuple[float, float]]
    truth_points: str
    tracks: list[_PageTrack]
    worst: list[tuple[float, float, str]]
    scale_bar: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class _PageWalk:
    walk: WorstWalk
    title: str
    pictures: list[_WalkPicture]


def _page_plan(floor: Floor) -> _PagePlan:
    walls = "".join(f"M{a[0]:.1f} {-a[1]:.1f}L{b[0]:.1f} {-b[1]:.1f}" for a, b in floor.walls.tolist())
    return _PagePlan(_ring_path(floor.outline), _ring_path(floor.obstacles), walls)


def _page_walk(
    walk: WorstWalk, plans: Sequence[tuple[str, str]], styles: Mapping[str, LineStyle], report: ReportData
) -> _PageWalk:
    trial = walk.trial
    seed = f", seed {trial.seed}" if report.several_seeds else ""
    outcome = next(iter(trial.outcomes.values()))
    visited = list(dict.fromkeys(outcome.samples.floors)) or [floor for floor in [outcome.floor] if floor]
    pictures = [_walk_picture(walk, outcome, floor, plans, styles) for floor in visited]
    return _PageWalk(walk, f"{trial.site}: {trial.walk}{seed}", pictures)


def _walk_picture(
    walk: WorstWalk,
    outcome: TrialOutcome,
    floor: str,
    plans: Sequence[tuple[str, str]],
    styles: Mapping[str, LineStyle],
) -> _WalkPicture:
    here = np.array([name == floor for name in outcome.samples.floors], dtype=np.bool_)
    truth = outcome.samples.xy[here]
    tracks = {name: _track_on_floor(walk.trial.outcomes[name], floor) for name in styles}
    low, high = crop(truth, np.concatenate([np.zeros((0, 2)), *tracks.values()]))
    width_m, height_m = (high - low).tolist()
    px = max(width_m / _WIDTH_PX, height_m / _HEIGHT_PX)
    # Pipelines that are worst at the same waypoint share its square; the last one gives the colour.
    worst = {
        case.worst_sample: styles[case.pipeline].color
        for case in walk.worst_cases
        if case.pipeline in styles and here[case.worst_sample]
    }
    corners = [
        (float(outcome.samples.xy[i, 0]) - 6 * px, -float(outcome.samples.xy[i, 1]) - 6 * px, color)
        for i, color in worst.items()
    ]
    bar_m = next((length for length in _SCALE_BARS_M if length < 0.3 * width_m), _SCALE_BARS_M[-1])
    key = (walk.trial.site, floor)
    return _WalkPicture(
        floor=floor,
        plan=plans.index(key) if key in plans else None,
        view_box=(float(low[0]), -float(high[1]), width_m, height_m),
        px=px,
        truth=[(x, -y) for x, y in truth.tolist()],
        truth_points=_svg_points(truth),
        tracks=[
            _PageTrack(
                pipeline=name,
                points=_svg_points(xy),
                color=styles[name].color,
                width=1.2 * styles[name].width * px,
                dashes=_dash_pattern(styles[name], 2 * px),
            )
            for name, xy in tracks.items()
        ],
        worst=corners,
        scale_bar=(float(low[0]) + 0.03 * width_m, -float(low[1]) - 0.04 * height_m, bar_m),
    )


def _floors_of_walk(walk: WorstWalk) -> set[str]:
    outcome = next(iter(walk.trial.outcomes.values()))
    return set(outcome.samples.floors) | {outcome.floor}


def _track_on_floor(outcome: TrialOutcome, floor: str) -> Floats:
    """Return the positions (n, 2) of a thinned track on ``floor``, metres."""
    track = outcome.thinned_track
    if floor not in track.floors:
        return np.zeros((0, 2))
    return np.asarray(track.xy[track.floor == track.floors.index(floor)], dtype=np.float64)


def _dash_pattern(style: LineStyle, scale: float) -> str:
    return "none" if style.dashes == "solid" else " ".join(f"{scale * dash:.3g}" for dash in style.dashes[1])


def _svg_points(xy: Floats) -> str:
    return " ".join(f"{x:.1f},{-y:.1f}" for x, y in xy.tolist())


def _ring_path(rings: Iterable[Floats]) -> str:
    return "".join("M" + "L".join(f"{x:.1f} {-y:.1f}" for x, y in ring.tolist()) + "Z" for ring in rings if len(ring))
