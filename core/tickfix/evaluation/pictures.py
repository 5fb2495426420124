"""Pictures of walks on their floor plan and of error distributions, as PNG, SVG or animated GIF, readable in grey and
by the colour-blind.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import reduce
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.path import Path as Outline
from PIL import Image
from shapely.geometry.polygon import orient

from tickfix.api import Estimate, Fix, Floats, Floor, Truth
from tickfix.evaluation.theme import (
    FOREGROUND,
    MUTED,
    RC_PARAMS,
    LineStyle,
    NotebookFigure,
    canvas,
    legend,
    line_styles,
    printable,
    save_figure,
    themed_figure,
)

_FLOOR_COLOR: Final = "#f5f5f3"
_OBSTACLE_COLOR: Final = "#e5e5e2"
_EDGE_COLOR: Final = "#bcbcb8"
_WALL_COLOR: Final = "#8f8f8b"
_MARGIN_M: Final = 4.0
_MIN_EXTENT_M: Final = 20.0
_MIN_ASPECT: Final = 0.45


def draw_plan(axes: Axes, floor: Floor) -> None:
    """Draw outline, obstacles and walls; a floor without geometry leaves the axes empty."""
    outline = reduce(shapely.symmetric_difference, _polygons(floor.outline), shapely.Polygon())
    layers = ((outline, _FLOOR_COLOR, 0.8), (shapely.union_all(_polygons(floor.obstacles)), _OBSTACLE_COLOR, 0.5))
    for order, (area, face, width) in enumerate(layers, start=1):
        paths = [_outline_path(polygon) for polygon in shapely.get_parts(area) if isinstance(polygon, shapely.Polygon)]
        axes.add_collection(
            PathCollection(
                [path for path in paths if len(path)],
                facecolors=face,
                edgecolors=_EDGE_COLOR,
                linewidths=width,
                zorder=order,
            ),
            autolim=False,
        )
    walls = LineCollection(list(floor.walls), colors=_WALL_COLOR, linewidths=0.7, zorder=3, capstyle="round")
    axes.add_collection(walls, autolim=False)


def crop(walk: Floats, tracks: Floats) -> tuple[Floats, Floats]:
    """Return the corners (2,), (2,) of what to show: the walk, tracks that stay near it, and a margin.

    Args:
        walk: (n, 2) the truth; where it is empty the tracks take its place.
        tracks: (m, 2) all positions drawn. One that goes astray runs out of the picture rather than shrink the rest:
            kept are places within a third of the walk's extent, or 10 m, of its bounding box.
    """
    frame = walk if len(walk) else tracks
    if not len(frame):
        return np.zeros(2), np.full(2, _MIN_EXTENT_M)
    low, high = frame.min(axis=0), frame.max(axis=0)
    reach = max(10.0, float(np.hypot(*(high - low))) / 3.0)
    near = tracks[((tracks >= low - reach) & (tracks <= high + reach)).all(axis=1)]
    shown = np.concatenate([frame, near])
    low, high = shown.min(axis=0) - _MARGIN_M, shown.max(axis=0) + _MARGIN_M
    extent = np.maximum(high - low, max(_MIN_EXTENT_M, _MIN_ASPECT * float((high - low).max())))
    middle = (low + high) / 2
    return middle - extent / 2, middle + extent / 2


def _polygons(rings: Sequence[Floats]) -> list[shapely.Geometry]:
    return [shapely.make_valid(shapely.Polygon(ring)) for ring in rings if len(ring) > 2]


def _outline_path(polygon: shapely.Polygon) -> Outline:
    # Renderers fill by winding number, so holes must run against their shell.
    wound = orient(polygon)
    rings = [np.asarray(ring.coords) for ring in (wound.exterior, *wound.interiors)]
    return Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings if len(ring)))


REGION_95: Final = math.sqrt(-2.0 * math.log(0.05))
"""Semi-axes of the 95 % region of a plane Gaussian in standard deviations: its squared radius is χ² with 2 degrees of
freedom, whose quantile is −2 ln(1 − p)."""

_LegendEntries = list[tuple[Artist, str]]


def draw_walk(
    floor: Floor,
    truth: Sequence[Truth],
    tracks: Mapping[str, Iterable[Estimate]],
    fixes: Sequence[Fix] | Floats,
    path: Path,
    *,
    title: str = "",
    regions_of: str | None = None,
    regions_every_s: float = 5.0,
) -> None:
    """Draw a walk as :func:`walk_figure` does and write it to ``path``, ``.png`` or ``.svg``.

    Equal data give equal bytes.

    Raises:
        ValueError: for another suffix, or when ``regions_of`` is none of the pipelines.
    """
    figure = walk_figure(
        floor, truth, tracks, fixes, title=title, regions_of=regions_of, regions_every_s=regions_every_s
    )
    save_figure(figure, path)


def walk_figure(
    floor: Floor,
    truth: Sequence[Truth],
    tracks: Mapping[str, Iterable[Estimate]],
    fixes: Sequence[Fix] | Floats,
    *,
    title: str = "",
    regions_of: str | None = None,
    regions_every_s: float = 5.0,
) -> NotebookFigure:
    """Return a walk drawn on its floor's plan; what lies on other floors, in other frames, is left out.

    Args:
        floor: the plan; one without geometry gives bare axes.
        truth: waypoints, in any order.
        tracks: by pipeline, the last drawn on top.
        fixes: what fingerprints found, or their places (n, 2) on this floor.
        title: above the picture.
        regions_of: the pipeline whose 95 % regions are drawn, by default the last.
        regions_every_s: device time between two of them.

    Raises:
        ValueError: when ``regions_of`` is none of the pipelines.
    """
    chosen = regions_of if regions_of is not None else next(reversed(list(tracks)), None)
    if chosen is not None and chosen not in tracks:
        raise ValueError(f"regions_of: found {chosen!r}, expected one of {', '.join(tracks) or 'no pipelines'}")
    waypoints = [w.xy for w in sorted(truth, key=lambda w: w.t_ns) if w.floor == floor.name]
    truth_xy = np.array(waypoints).reshape(-1, 2)
    track_xy = {name: _positions_on_floor(track, floor.name) for name, track in tracks.items()}
    drawn = np.concatenate([np.empty((0, 2)), *track_xy.values()])
    low, high = crop(truth_xy, drawn[np.isfinite(drawn).all(axis=1)])
    width_in, height_in = (high - low) * min(6.4 / (high - low)[0], 5.6 / (high - low)[1])
    beside = height_in > width_in
    with themed_figure((width_in + 0.7, height_in + 0.8)) as figure:
        axes = figure.add_subplot()
        draw_plan(axes, floor)
        entries = _draw_truth(axes, truth_xy, track_xy)
        entries += _draw_fixes(axes, fixes, floor.name)
        for style, (name, xy) in zip(line_styles(len(track_xy)), track_xy.items(), strict=True):
            entries.append((_draw_line(axes, xy, style), name))
        if chosen is not None:
            style = dict(zip(track_xy, line_styles(len(track_xy)), strict=True))[chosen]
            regions = list(_region_ellipses(tracks[chosen], floor.name, regions_every_s))
            entries += _draw_regions(axes, regions, style, f"95 % region of {chosen}, every {regions_every_s:g} s")
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x, m", ylabel="y, m")
        axes.set_title(printable(title))
        if entries:
            legend(figure, entries, beside=beside)
    return figure


def draw_cdf(errors_by_pipeline: Mapping[str, Floats], path: Path, *, title: str = "") -> None:
    """Draw the empirical distribution of errors: for each distance, the share of waypoints with no greater error.

    Args:
        errors_by_pipeline: errors (n,) in metres, all finite; a pipeline without any has only a line in the legend.
        path: the file to write, ``.png`` or ``.svg``.
        title: above the picture.
    """
    known = {name: np.sort(np.asarray(errors)) for name, errors in errors_by_pipeline.items()}
    tails = [(float(np.percentile(errors, 95)), float(errors[-1])) for errors in known.values() if len(errors)]
    right = max(0.1, 1.03 * min(max(tail[1] for tail in tails), 2.0 * max(tail[0] for tail in tails)) if tails else 1.0)
    with canvas(path, (4.2, 3.4)) as figure:
        axes = figure.add_subplot()
        axes.set(xlim=(0.0, right), ylim=(0.0, 102.0), xlabel="error, m", ylabel="waypoints with no greater error, %")
        axes.set_yticks([0, 25, 50, 75, 90, 95, 100], ["0", "25", "50", "75", "90", "", "100"])
        axes.grid(color="#e4e4e2", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
        entries: _LegendEntries = []
        for style, (name, errors) in zip(line_styles(len(known)), known.items(), strict=True):
            share = 100.0 * np.arange(len(errors) + 1) / max(1, len(errors))
            (line,) = axes.step(
                np.append(0.0, errors), share, where="post", color=style.color, linestyle=style.dashes, linewidth=1.5
            )
            entries.append(
                (line, f"{name}\nmedian {np.median(errors):.1f} m" if len(errors) else f"{name}\nno waypoints")
            )
        axes.set_title(printable(title))
        if entries:
            legend(figure, entries, beside=True)


def _positions_on_floor(track: Iterable[Estimate], floor: str) -> Floats:
    """Return (n, 2) the means, NaN where there is none on ``floor``."""
    beliefs = [estimate.belief for estimate in track]
    nowhere = np.full(2, np.nan)
    return np.array([b.xy if b is not None and b.floor == floor else nowhere for b in beliefs]).reshape(-1, 2)


def _region_ellipses(track: Iterable[Estimate], floor: str, every_s: float) -> Iterator[Floats]:
    """Give the ellipses (64, 2) that hold 95 % of the Gaussians with the beliefs' means and covariances."""
    angle = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    circle = REGION_95 * np.stack([np.cos(angle), np.sin(angle)])
    due_ns: float = -math.inf
    for estimate in track:
        belief = estimate.belief
        if belief is None or belief.floor != floor or estimate.t_ns < due_ns:
            continue
        if np.isfinite(belief.xy).all() and np.isfinite(belief.covariance).all():
            due_ns = estimate.t_ns + every_s * 1e9
            variance, directions = np.linalg.eigh(belief.covariance)
            yield belief.xy + (directions * np.sqrt(np.maximum(variance, 0.0)) @ circle).T


def _draw_truth(axes: Axes, truth_xy: Floats, track_xy: Mapping[str, Floats]) -> _LegendEntries:
    entries: _LegendEntries = []
    if len(truth_xy):
        (line,) = axes.plot(
            *truth_xy.T,
            color=FOREGROUND,
            linewidth=0.8,
            dashes=(5, 3),
            marker="o",
            markersize=3.6,
            markeredgecolor="white",
            markeredgewidth=0.6,
            zorder=8,
        )
        entries.append((line, "truth at waypoints"))
    places = np.concatenate([truth_xy, *track_xy.values()])
    places = places[np.isfinite(places).all(axis=1)]
    if len(places):
        (start,) = axes.plot(
            *places[0],
            marker="o",
            markersize=9,
            markerfacecolor="none",
            markeredgecolor=FOREGROUND,
            linestyle="none",
            zorder=9,
        )
        entries.append((start, "start"))
    return entries


def _draw_fixes(axes: Axes, fixes: Sequence[Fix] | Floats, floor: str) -> _LegendEntries:
    places = [
        fix.xy if isinstance(fix, Fix) else fix for fix in fixes if not isinstance(fix, Fix) or fix.floor == floor
    ]
    if not places:
        return []
    (crosses,) = axes.plot(
        *np.array(places).T, linestyle="none", marker="x", markersize=3.6, markeredgewidth=0.8, color=MUTED, zorder=5
    )
    return [(crosses, "Wi-Fi fixes")]


def _draw_line(axes: Axes, xy: Floats, style: LineStyle) -> Artist:
    (line,) = axes.plot(
        *xy.T, color=style.color, linestyle=style.dashes, linewidth=style.width, zorder=7, dash_capstyle="butt"
    )
    return line


def _draw_regions(axes: Axes, regions: Sequence[Floats], style: LineStyle, label: str) -> _LegendEntries:
    if not regions:
        return []
    fill = PolyCollection(regions, facecolors=style.color, alpha=0.07, zorder=4)
    rims = PolyCollection(regions, facecolors="none", edgecolors=style.color, linewidths=0.5, alpha=0.7, zorder=4)
    axes.add_collection(fill, autolim=False)
    axes.add_collection(rims, autolim=False)
    return [(Patch(facecolor=style.color + "20", edgecolor=style.color, linewidth=0.5), label)]


_WIDTH_IN: Final = 6.0
_DPI: Final = 90
_TAIL_S: Final = 8.0
_PALETTE_SIZE: Final = 64


def animate_walk(
    floor: Floor,
    truth: Sequence[Truth],
    tracks: Mapping[str, Iterable[Estimate]],
    path: Path,
    *,
    title: str = "",
    every_s: float = 0.6,
    speedup: float = 6.0,
) -> None:
    """Write an animated GIF of the published tracks of one walk on one floor.

    Args:
        floor: the plan.
        truth: waypoints; between them the true dot walks straight.
        tracks: by pipeline.
        path: the file to write.
        title: above the picture.
        every_s: device time between two frames.
        speedup: how much faster than it happened it plays.
    """
    waypoints = [w for w in sorted(truth, key=lambda w: w.t_ns) if w.floor == floor.name]
    if not waypoints:
        return
    t_s = np.array([w.t_ns for w in waypoints]) * 1e-9
    truth_xy = np.array([w.xy for w in waypoints])
    instants_s = np.arange(t_s[0], t_s[-1] + every_s, every_s)
    places = {"truth": np.column_stack([np.interp(instants_s, t_s, truth_xy[:, axis]) for axis in (0, 1)])}
    places |= {name: _positions_at(track, floor.name, instants_s) for name, track in tracks.items()}
    low, high = crop(truth_xy, np.concatenate([xy[np.isfinite(xy).all(axis=1)] for xy in places.values()]))
    tail = round(_TAIL_S / every_s)
    with mpl.rc_context(RC_PARAMS):
        figure = Figure(figsize=(_WIDTH_IN, _WIDTH_IN * float((high - low)[1] / (high - low)[0]) + 0.7), dpi=_DPI)
        agg_canvas: Any = FigureCanvasAgg(figure)  # its methods are untyped
        axes = figure.add_axes((0.09, 0.09, 0.88, 0.84))
        draw_plan(axes, floor)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x, m", ylabel="y, m")
        axes.set_title(printable(title))
        styles = [(FOREGROUND, 1.0), *((style.color, style.width) for style in line_styles(len(tracks)))]
        tails = [axes.plot([], [], color=c, linewidth=w, alpha=0.7, animated=True, zorder=6)[0] for c, w in styles]
        dots = [
            axes.plot([], [], "o", color=c, markersize=6, markeredgecolor="white", animated=True, zorder=7)[0]
            for c, _ in styles
        ]
        axes.legend(dots, list(places), loc="upper right", ncols=len(places), handletextpad=0.1, columnspacing=0.8)
        agg_canvas.draw()
        background = agg_canvas.copy_from_bbox(figure.bbox)
        frames = []
        for now in range(len(instants_s)):
            agg_canvas.restore_region(background)
            for xy, line, dot in zip(places.values(), tails, dots, strict=True):
                line.set_data(*xy[max(0, now - tail) : now + 1].T)
                dot.set_data(*xy[now : now + 1].T)
                axes.draw_artist(line)
                axes.draw_artist(dot)
            picture = Image.frombuffer("RGBA", agg_canvas.get_width_height(), agg_canvas.buffer_rgba().tobytes())
            frames.append(picture.convert("RGB").quantize(_PALETTE_SIZE))
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=round(1000 * every_s / speedup), loop=0, optimize=False
    )


def _positions_at(track: Iterable[Estimate], floor: str, instants_s: Floats) -> Floats:
    """Return where the track said the device was at each moment (n, 2), NaN where it said nothing on this floor."""
    positioned = [e for e in track if e.belief is not None and e.belief.floor == floor]
    places = np.full((len(instants_s), 2), np.nan)
    if positioned:
        t_s = np.array([e.t_ns for e in positioned]) * 1e-9
        last = np.searchsorted(t_s, instants_s, side="right") - 1
        known = last >= 0
        places[known] = np.array([e.belief.xy for e in positioned if e.belief is not None])[last[known]]
    return places
