"""The figures of a report, as SVG files: readable in print, in grey and by the colour-blind."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from tickfix.api import Floats
from tickfix.evaluation.comparison.points import Points, Scope
from tickfix.evaluation.comparison.result import Result
from tickfix.evaluation.metrics.curves import curve
from tickfix.evaluation.pictures import draw_cdf
from tickfix.evaluation.report.chart import Chart, quiet
from tickfix.evaluation.report.looks import chosen, looks
from tickfix.evaluation.report.sweeps import sweep_charts
from tickfix.evaluation.style import INK, QUIET, canvas, legend, printable

_FEWEST: Final = 5
_TICKS_M: Final = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
_NOMINAL: Final = np.linspace(0.02, 0.98, 49)


def draw_charts(result: Result, folder: Path) -> tuple[Chart, ...]:
    """Draw all figures for which there are points into ``folder``, which must exist."""
    charts: list[Chart] = []
    everywhere = result.points[Scope.ALL]
    if len(everywhere) == 0:
        return ()
    if result.comparisons:
        charts.append(_differences(result, folder / "differences.svg"))
    for scope in (Scope.ALL, Scope.COVERED):
        points = result.points[scope]
        if scope is Scope.ALL or result.partly_covered:
            path = folder / f"cdf-{scope.value}.svg"
            draw_cdf({name: points.said[name].error_m for name in chosen(result)}, path)
            where = "all scored" if scope is Scope.ALL else "covered"
            charts.append(Chart(path, f"Errors at {where} waypoints", f"Distribution of {len(points)} errors."))
    others = [name for name in chosen(result) if name != result.baseline]
    if others:
        charts.append(_scatter(result, everywhere, others, folder / "paired.svg"))
        charts.append(_walk_differences(result, everywhere, others, folder / "walks.svg"))
    between = result.points[Scope.INTERPOLATED]
    if len(between):
        told = "against truth interpolated between waypoints; bins with fewer than five values are left out."
        path, name = folder / "time.svg", "Error over time"
        _curves(result, path, between, between.t_s, 10.0, "time since the first waypoint, s")
        charts.append(Chart(path, name, f"Mean (line) and third quartile (thin) every 10 s, {told}"))
        path, name = folder / "distance.svg", "Error over distance"
        _curves(result, path, between, between.travelled_m, 10.0, "way since the first waypoint, m")
        charts.append(Chart(path, name, f"Mean (line) and third quartile (thin) every 10 m, {told}"))
    charts.append(_trust(result, everywhere, folder / "uncertainty.svg"))
    return (*charts, *sweep_charts(result, folder))


@contextmanager
def _axes(path: Path, size_in: tuple[float, float]) -> Iterator[tuple[Figure, Axes]]:
    with canvas(path, size_in) as figure:
        axes = figure.add_subplot()
        quiet(axes)
        yield figure, axes


def _differences(result: Result, path: Path) -> Chart:
    shown = [c for c in result.comparisons if c.metric == result.metric and c.scope != Scope.INTERPOLATED.value]
    if not result.partly_covered:
        shown = [c for c in shown if c.scope == Scope.ALL.value]
    scopes = list(dict.fromkeys(c.scope for c in shown))
    names = list(dict.fromkeys(c.pipeline for c in shown))
    with _axes(path, (6.4, 0.7 + 0.24 * len(shown))) as (_, axes):
        axes.axvline(0.0, color=INK, linewidth=0.8)
        for c in shown:
            at = names.index(c.pipeline) + (scopes.index(c.scope) - (len(scopes) - 1) / 2) * 0.32
            covered = c.scope == Scope.COVERED.value
            color = "#d55e00" if covered else "#0072b2"
            i = c.interval
            if i.low_m is not None and i.high_m is not None:
                axes.plot([i.low_m, i.high_m], [at, at], color=color, linewidth=1.6)
            axes.plot(
                [i.difference_m], [at], color=color, marker="s" if covered else "o", markersize=4.5, linestyle="none"
            )
        axes.set_yticks(range(len(names)), [printable(name) for name in names])
        axes.set(ylim=(len(names) - 0.5, -0.5), xlabel=f"difference in {result.metric}, m (left of 0: better)")
        axes.grid(axis="y", visible=False)
    how = "circles: all scored waypoints; squares: covered ones" if len(scopes) > 1 else "all scored waypoints"
    caption = f"Difference in {result.metric} from {result.baseline} with its 95 % interval ({how})."
    return Chart(path, "Differences", caption)


def _panels(path: Path, names: Sequence[str], draw: Callable[[Axes, str], None], size_in: tuple[float, float]) -> None:
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    with canvas(path, (columns * size_in[0], rows * size_in[1])) as figure:
        for i, name in enumerate(names, 1):
            axes = figure.add_subplot(rows, columns, i)
            quiet(axes)
            draw(axes, name)
            axes.set_title(printable(name))


def _scatter(result: Result, points: Points, names: Sequence[str], path: Path) -> Chart:
    base = points.said[result.baseline].error_m
    every = np.concatenate([base, *(points.said[name].error_m for name in names)])
    low, high = max(0.05, float(every.min()) / 1.3), max(1.0, float(every.max()) * 1.3)
    look = looks(result)

    def draw(axes: Axes, name: str) -> None:
        axes.plot([low, high], [low, high], color=INK, linewidth=0.8)
        axes.plot(
            np.maximum(base, low),
            np.maximum(points.said[name].error_m, low),
            linestyle="none",
            marker="o",
            markersize=2.6,
            markeredgewidth=0,
            alpha=0.55,
            color=look[name].color,
            rasterized=len(base) > 5000,
        )
        axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high), box_aspect=1)
        ticks = [t for t in _TICKS_M if low <= t <= high]
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_ticks(ticks, [f"{t:g}" for t in ticks])
            axis.set_minor_locator(NullLocator())
        axes.set(xlabel=printable(f"{result.baseline}, m"), ylabel=printable(f"{name}, m"))

    _panels(path, names, draw, (2.6, 2.7))
    caption = f"Each point is a waypoint: error of {result.baseline} (across) and of the other (up), both logarithmic. "
    return Chart(path, "Paired errors", caption + "Below the diagonal the other is better.")


def _walk_differences(result: Result, points: Points, names: Sequence[str], path: Path) -> Chart:
    sizes = np.bincount(points.walk)
    look = looks(result)

    def draw(axes: Axes, name: str) -> None:
        apart = points.said[name].error_m - points.said[result.baseline].error_m
        by_m = np.sort(np.bincount(points.walk, weights=apart) / sizes)
        axes.bar(np.arange(len(by_m)), by_m, width=0.9, color=look[name].color)
        axes.axhline(0.0, color=INK, linewidth=0.8)
        axes.set(xlabel="walks, sorted", ylabel="difference, m")
        axes.grid(axis="x", visible=False)
        axes.set_xticks([])

    _panels(path, names, draw, (2.4, 2.0))
    caption = f"Difference in mean error from {result.baseline}, walk by walk: below 0 the walk was better."
    return Chart(path, "Differences by walk", caption)


def _curves(result: Result, path: Path, points: Points, abscissa: Floats, width: float, label: str) -> None:
    with _axes(path, (6.0, 2.9)) as (figure, axes):
        entries = []
        for name, look in looks(result).items():
            found = curve(abscissa, points.said[name].error_m, width)
            kept = found.n >= _FEWEST
            (line,) = axes.plot(
                found.middle[kept], found.mean_m[kept], color=look.color, linestyle=look.dashes, linewidth=1.6
            )
            axes.plot(found.middle[kept], found.p75_m[kept], color=look.color, linestyle=look.dashes, linewidth=0.6)
            entries.append((line, name))
        axes.set(xlabel=label, ylabel="error, m")
        axes.set_xlim(left=0.0)
        axes.set_ylim(bottom=0.0)
        legend(figure, entries, beside=True)


def _trust(result: Result, points: Points, path: Path) -> Chart:
    with _axes(path, (3.4, 3.2)) as (figure, axes):
        axes.plot([0, 100], [0, 100], color=QUIET, linewidth=0.8)
        entries: list[tuple[Line2D, str]] = []
        for name, look in looks(result).items():
            levels = points.said[name].density_level
            held = [100.0 * float(np.mean(levels <= p)) for p in _NOMINAL]
            (line,) = axes.plot(100 * _NOMINAL, held, color=look.color, linestyle=look.dashes, linewidth=1.5)
            entries.append((line, name))
        axes.set(xlim=(0, 100), ylim=(0, 100), aspect="equal")
        axes.set(xlabel="content of the region, %", ylabel="truths in it, %")
        legend(figure, list(entries), beside=True)
    caption = (
        "How often the highest-density region of a given content held the truth; below the diagonal a pipeline is "
    )
    return Chart(path, "Uncertainty", caption + "surer of itself than it should be.")
