"""The figures of [wang2015] drawn again: trajectories, errors over time, errors by number of particles, the CDF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from tickfix.api import Floor
from tickfix.evaluation.pictures import draw_cdf, draw_plan
from tickfix.evaluation.theme import FOREGROUND, canvas, legend, line_styles
from tickfix_papers.seed_statistics import mean
from tickfix_papers.wang2015.claims import TABLE_1_M2, TABLE_2_M2, mse_m2
from tickfix_papers.wang2015.seed_run import (
    EKF_MOTION,
    EPOCHS_S,
    MWPO,
    ON_ODOMETRY,
    ON_WIFI,
    PARTICLES,
    SCHEMES,
    WPO,
    SeedRun,
    particle_scheme,
)
from tickfix_papers.wang2015.twin import floor_plan


def draw(walks: Sequence[SeedRun], folder: Path) -> tuple[Path, ...]:
    """Draw Figures 11, 15 and 18 to 20, and the distribution of errors; walks are those of the first seed."""
    first = walks[0]
    paths = {
        name: folder / f"wang2015-{name}.png" for name in ("particles", "schemes", "time", "wifi", "odometry", "cdf")
    }
    _draw_particles(walks, paths["particles"])
    _draw_tracks(first, SCHEMES, paths["schemes"])
    _draw_time(first, paths["time"])
    for name, suffix, schemes in (("wifi", ON_WIFI, (WPO, MWPO)), ("odometry", ON_ODOMETRY, (WPO, MWPO, EKF_MOTION))):
        _draw_tracks(first, [scheme + suffix for scheme in schemes], paths[name], gross=True)
    errors = {scheme: np.concatenate([walk.error_m(scheme) for walk in walks]) for scheme in SCHEMES}
    draw_cdf(errors, paths["cdf"], title=f"[wang2015] errors at the epochs of {len(walks)} walks")
    return tuple(paths.values())


def _draw_particles(walks: Sequence[SeedRun], path: Path) -> None:
    """Draw Figure 11 with and without the map, the paper's figures beside it."""
    with canvas(path, (4.6, 3.4)) as figure:
        axes = figure.add_subplot()
        entries = []
        for style, mapped, printed in zip(line_styles(2), (False, True), (TABLE_1_M2, TABLE_2_M2), strict=True):
            found = [mean(mse_m2(walks, particle_scheme(n, mapped=mapped))) for n in PARTICLES]
            centre = np.array([interval.mean for interval in found])
            half = centre - np.array([interval.low for interval in found])
            words = "with map" if mapped else "without map"
            bars = axes.errorbar(PARTICLES, centre, half, color=style.color, linestyle=style.dashes, capsize=2.0)
            (points,) = axes.plot(list(printed), list(printed.values()), "x", color=style.color)
            entries += [(bars.lines[0], f"{words}, ours"), (points, f"{words}, the paper's")]
        axes.set(xlabel="particles", ylabel="mean square error, m²", ylim=(0.0, None))
        _style_axes(axes)
        axes.set_title(f"[wang2015] Figure 11, {len(walks)} seeds with 95 % intervals")
        legend(figure, entries, beside=False)


def _draw_tracks(walk: SeedRun, schemes: Sequence[str], path: Path, *, gross: bool = False) -> None:
    """Draw a plan for each scheme, the truth dashed; ``gross`` rings the epochs of gross errors."""
    floor = floor_plan()
    with canvas(path, (7.2, 2.6 * len(schemes))) as figure:
        for axes, scheme in zip(figure.subplots(len(schemes), 1, squeeze=False).ravel(), schemes, strict=True):
            _draw_floor(axes, floor, scheme)
            axes.plot(*walk.truth.T, color=FOREGROUND, linewidth=0.8, dashes=(5, 3), zorder=5)
            axes.plot(
                *walk.xy[scheme].T, color=line_styles(1)[0].color, marker=".", markersize=4.0, linewidth=0.8, zorder=6
            )
            if gross:
                hit = np.isin(walk.t_s, EPOCHS_S)
                axes.plot(
                    *walk.xy[scheme][hit].T, "o", color=FOREGROUND, markerfacecolor="none", markersize=9.0, zorder=7
                )
                axes.plot(*walk.truth[hit].T, "+", color=FOREGROUND, markersize=9.0, zorder=7)


def _draw_floor(axes: Axes, floor: Floor, title: str) -> None:
    draw_plan(axes, floor)
    axes.set(xlim=(-2.0, floor.width_m + 2.0), ylim=(-2.0, floor.height_m + 2.0), aspect="equal", ylabel="y, m")
    axes.set_title(title)


def _draw_time(walk: SeedRun, path: Path) -> None:
    """Draw Figure 18."""
    with canvas(path, (6.4, 3.2)) as figure:
        axes = figure.add_subplot()
        entries = []
        for style, scheme in zip(line_styles(len(SCHEMES)), SCHEMES, strict=True):
            (line,) = axes.plot(
                walk.t_s, walk.error_m(scheme), color=style.color, linestyle=style.dashes, linewidth=style.width
            )
            entries.append((line, scheme))
        axes.set(xlabel="time, s", ylabel="error, m", ylim=(0.0, None))
        _style_axes(axes)
        axes.set_title(f"[wang2015] Figure 18, seed {walk.seed}")
        legend(figure, entries, beside=True)


def _style_axes(axes: Axes) -> None:
    axes.grid(color="#e4e4e2", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
