"""Pictures of walks and of errors, good enough for a paper, readable in grey and by the colour-blind."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch

from tickfix.api import Fix, Floats, Floor, Truth
from tickfix.evaluation.plan import crop, draw_plan
from tickfix.evaluation.style import INK, QUIET, Line, canvas, legend, lines, printable
from tickfix.evaluation.track import Track

REGION_95: Final = math.sqrt(-2.0 * math.log(0.05))
"""Semi-axes of the 95 % region of a plane Gaussian in standard deviations: its squared radius is χ² with 2 degrees of
freedom, whose quantile is −2 ln(1 − p)."""

_Entries = list[tuple[Artist, str]]


def draw_walk(
    floor: Floor,
    truth: Sequence[Truth],
    tracks: Mapping[str, Track],
    fixes: Sequence[Fix] | Floats,
    path: Path,
    *,
    title: str = "",
    regions_of: str | None = None,
    regions_every_s: float = 5.0,
) -> None:
    """Draw a walk on its floor's plan; what lies on other floors, in other frames, is left out.

    Args:
        floor: the plan; one without geometry gives bare axes.
        truth: waypoints, in any order.
        tracks: by pipeline, the last drawn on top.
        fixes: what fingerprints found, or their places (n, 2) on this floor.
        path: the file to write, ``.png`` or ``.svg``; the same data give the same bytes.
        title: above the picture.
        regions_of: the pipeline whose 95 % regions are drawn, by default the last.
        regions_every_s: device time between two of them.

    Raises:
        ValueError: for another suffix, or when ``regions_of`` is none of the pipelines.
    """
    chosen = regions_of if regions_of is not None else next(reversed(list(tracks)), None)
    if chosen is not None and chosen not in tracks:
        raise ValueError(f"regions_of: found {chosen!r}, expected one of {', '.join(tracks) or 'no pipelines'}")
    waypoints = [w.xy for w in sorted(truth, key=lambda w: w.t_ns) if w.floor == floor.name]
    way = np.array(waypoints).reshape(-1, 2)
    ways = {name: _positions(track, floor.name) for name, track in tracks.items()}
    drawn = np.concatenate([np.empty((0, 2)), *ways.values()])
    low, high = crop(way, drawn[np.isfinite(drawn).all(axis=1)])
    wide, tall = (high - low) * min(6.4 / (high - low)[0], 5.6 / (high - low)[1])
    beside = tall > wide
    with canvas(path, (wide + 0.7, tall + 0.8)) as figure:
        axes = figure.add_subplot()
        draw_plan(axes, floor)
        entries = _draw_truth(axes, way, ways)
        entries += _draw_fixes(axes, fixes, floor.name)
        for look, (name, xy) in zip(lines(len(ways)), ways.items(), strict=True):
            entries.append((_draw_line(axes, xy, look), name))
        if chosen is not None:
            look = dict(zip(ways, lines(len(ways)), strict=True))[chosen]
            regions = list(_regions(tracks[chosen], floor.name, regions_every_s))
            entries += _draw_regions(axes, regions, look, f"95 % region of {chosen}, every {regions_every_s:g} s")
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x, m", ylabel="y, m")
        axes.set_title(printable(title))
        if entries:
            legend(figure, entries, beside=beside)


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
        entries: _Entries = []
        for look, (name, errors) in zip(lines(len(known)), known.items(), strict=True):
            share = 100.0 * np.arange(len(errors) + 1) / max(1, len(errors))
            (line,) = axes.step(
                np.append(0.0, errors), share, where="post", color=look.color, linestyle=look.dashes, linewidth=1.5
            )
            entries.append(
                (line, f"{name}\nmedian {np.median(errors):.1f} m" if len(errors) else f"{name}\nno waypoints")
            )
        axes.set_title(printable(title))
        if entries:
            legend(figure, entries, beside=True)


def _positions(track: Track, floor: str) -> Floats:
    """Return (n, 2) the means, NaN where there is none on ``floor``."""
    beliefs = [estimate.belief for estimate in track.estimates]
    nowhere = np.full(2, np.nan)
    return np.array([b.xy if b is not None and b.floor == floor else nowhere for b in beliefs]).reshape(-1, 2)


def _regions(track: Track, floor: str, every_s: float) -> Iterator[Floats]:
    """Give the ellipses (64, 2) that hold 95 % of the Gaussians with the beliefs' means and covariances."""
    angle = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    circle = REGION_95 * np.stack([np.cos(angle), np.sin(angle)])
    due_ns: float = -math.inf
    for estimate in track.estimates:
        belief = estimate.belief
        if belief is None or belief.floor != floor or estimate.t_ns < due_ns:
            continue
        if np.isfinite(belief.xy).all() and np.isfinite(belief.covariance).all():
            due_ns = estimate.t_ns + every_s * 1e9
            variance, directions = np.linalg.eigh(belief.covariance)
            yield belief.xy + (directions * np.sqrt(np.maximum(variance, 0.0)) @ circle).T


def _draw_truth(axes: Axes, way: Floats, ways: Mapping[str, Floats]) -> _Entries:
    entries: _Entries = []
    if len(way):
        (line,) = axes.plot(
            *way.T,
            color=INK,
            linewidth=0.8,
            dashes=(5, 3),
            marker="o",
            markersize=3.6,
            markeredgecolor="white",
            markeredgewidth=0.6,
            zorder=8,
        )
        entries.append((line, "truth at waypoints"))
    places = np.concatenate([way, *ways.values()])
    places = places[np.isfinite(places).all(axis=1)]
    if len(places):
        (start,) = axes.plot(
            *places[0],
            marker="o",
            markersize=9,
            markerfacecolor="none",
            markeredgecolor=INK,
            linestyle="none",
            zorder=9,
        )
        entries.append((start, "start"))
    return entries


def _draw_fixes(axes: Axes, fixes: Sequence[Fix] | Floats, floor: str) -> _Entries:
    places = [
        fix.xy if isinstance(fix, Fix) else fix for fix in fixes if not isinstance(fix, Fix) or fix.floor == floor
    ]
    if not places:
        return []
    (crosses,) = axes.plot(
        *np.array(places).T, linestyle="none", marker="x", markersize=3.6, markeredgewidth=0.8, color=QUIET, zorder=5
    )
    return [(crosses, "Wi-Fi fixes")]


def _draw_line(axes: Axes, xy: Floats, look: Line) -> Artist:
    (line,) = axes.plot(
        *xy.T, color=look.color, linestyle=look.dashes, linewidth=look.width, zorder=7, dash_capstyle="butt"
    )
    return line


def _draw_regions(axes: Axes, regions: Sequence[Floats], look: Line, label: str) -> _Entries:
    if not regions:
        return []
    fill = PolyCollection(regions, facecolors=look.color, alpha=0.07, zorder=4)
    rims = PolyCollection(regions, facecolors="none", edgecolors=look.color, linewidths=0.5, alpha=0.7, zorder=4)
    axes.add_collection(fill, autolim=False)
    axes.add_collection(rims, autolim=False)
    return [(Patch(facecolor=look.color + "20", edgecolor=look.color, linewidth=0.5), label)]
