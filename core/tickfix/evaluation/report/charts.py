"""The charts of a report as SVG files.

Differences, error distributions, errors over time, calibration, sweeps, error against cost.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from tickfix.api import Floats
from tickfix.evaluation.comparison.comparison_result import ComparisonResult
from tickfix.evaluation.comparison.pooled_metrics import PooledSamples, Scope
from tickfix.evaluation.error_metrics import bin_errors
from tickfix.evaluation.pictures import draw_cdf
from tickfix.evaluation.report.report_data import Chart
from tickfix.evaluation.theme import FOREGROUND, MUTED, LineStyle, canvas, legend, line_styles, printable

_GRID_COLOR: Final = "#e4e4e2"


def style_axes(axes: Axes) -> None:
    """Put a faint grid behind the data and remove the frame."""
    axes.grid(color=_GRID_COLOR, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


MAX_LINES: Final = 6
"""There are six distinct line styles; of more pipelines only the baseline and the best are drawn."""


def drawn_pipelines(result: ComparisonResult) -> tuple[str, ...]:
    """Return the pipelines that are drawn, in their order: the baseline and those with the least mean error."""
    if len(result.pipelines) <= MAX_LINES:
        return result.pipelines

    def mean_m(name: str) -> float:
        found = result.metrics[name][Scope.ALL.value]["mean_m"]
        return float("inf") if found is None else float(found)

    best = sorted((n for n in result.pipelines if n != result.baseline), key=mean_m)[: MAX_LINES - 1]
    return tuple(name for name in result.pipelines if name == result.baseline or name in best)


def pipeline_styles(result: ComparisonResult) -> Mapping[str, LineStyle]:
    """Return the line style of each pipeline that is drawn, the same in all figures."""
    names = drawn_pipelines(result)
    return dict(zip(names, line_styles(len(names)), strict=True))


_HEAT_COLORMAP: Final = "cividis"
"""Made for the colour-blind: J. Nuñez, C. Anderton, R. Renslow (2018)."""


def sweep_charts(result: ComparisonResult, folder: Path) -> tuple[Chart, ...]:
    """Draw a figure for each swept table, and error against cost where there are at least three pipelines."""
    charts = []
    tables: dict[str, dict[str, Mapping[str, Any]]] = {}
    for name, sweep in result.provenance.get("sweeps", {}).items():
        if name in result.pipelines:
            tables.setdefault(sweep["table"], {})[name] = sweep["values"]
    for i, (table, pipelines) in enumerate(tables.items()):
        labels = [label for label in next(iter(pipelines.values())) if _varies(label, pipelines)]
        if len(labels) == 1:
            charts.append(_sweep_curve(result, table, labels[0], pipelines, folder / f"sweep-{i}.svg"))
        elif labels:
            charts.append(_sweep_heat_map(result, table, labels, pipelines, folder / f"sweep-{i}.svg"))
    if len(result.pipelines) > 2:
        charts.append(_pareto_chart(result, folder / "cost.svg"))
    return tuple(charts)


def pareto(cost: Sequence[float], error: Sequence[float]) -> tuple[int, ...]:
    """Return the indices of the points on the Pareto front, by rising cost: no other is better in both."""
    front: list[int] = []
    for i in sorted(range(len(cost)), key=lambda i: (cost[i], error[i])):
        if not front or error[i] < error[front[-1]]:
            front.append(i)
    return tuple(front)


def _varies(label: str, pipelines: Mapping[str, Mapping[str, Any]]) -> bool:
    return len({str(values[label]) for values in pipelines.values()}) > 1


def _mean_m(result: ComparisonResult, name: str) -> float:
    found = result.metrics[name][Scope.ALL.value]["mean_m"]
    return float("nan") if found is None else float(found)


def _sweep_curve(
    result: ComparisonResult, table: str, label: str, pipelines: Mapping[str, Mapping[str, Any]], path: Path
) -> Chart:
    values = [values[label] for values in pipelines.values()]
    numbers = all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values)
    at = np.array(values, dtype=float) if numbers else np.arange(len(values), dtype=float)
    order = np.argsort(at, kind="stable")
    names = [list(pipelines)[i] for i in order]
    with canvas(path, (4.2, 2.9)) as figure:
        axes = figure.add_subplot()
        style_axes(axes)
        for scope, color, marker, words in (
            (Scope.ALL, "#0072b2", "o", "all scored"),
            (Scope.COVERED, "#d55e00", "s", "covered"),
        ):
            if scope is Scope.ALL or result.partly_covered:
                means = [result.metrics[name][scope.value]["mean_m"] for name in names]
                axes.plot(at[order], means, color=color, marker=marker, markersize=4.5, label=words)
        if not numbers:
            axes.set_xticks(at, [printable(str(value)) for value in values])
        elif at.min() > 0 and at.max() / at.min() >= 8:
            axes.set_xscale("log")
            axes.set_xticks(at, [f"{value:g}" for value in at], minor=False)
            axes.xaxis.set_minor_locator(NullLocator())
        axes.set(xlabel=printable(label), ylabel="mean error, m")
        axes.legend()
    return Chart(path, f"Sweep of {table}", f"Mean error by {label}.")


def _sweep_heat_map(
    result: ComparisonResult, table: str, labels: Sequence[str], pipelines: Mapping[str, Mapping[str, Any]], path: Path
) -> Chart:
    down, across = labels[:2]
    rows = _unique_values([values[down] for values in pipelines.values()])
    columns = _unique_values([values[across] for values in pipelines.values()])
    cells: Floats = np.full((len(rows), len(columns)), np.nan)
    for name, values in pipelines.items():
        i, j = rows.index(values[down]), columns.index(values[across])
        cells[i, j] = np.fmin(cells[i, j], _mean_m(result, name))
    with canvas(path, (1.6 + 0.62 * len(columns), 1.1 + 0.42 * len(rows))) as figure:
        axes = figure.add_subplot()
        image = axes.imshow(cells, cmap=_HEAT_COLORMAP, aspect="auto")
        low, high = np.nanmin(cells), np.nanmax(cells)
        for i, j in np.argwhere(np.isfinite(cells)).tolist():
            dark = cells[i, j] < (low + high) / 2
            weight = "bold" if cells[i, j] == low else "normal"
            color = "white" if dark else FOREGROUND
            axes.text(j, i, f"{cells[i, j]:.2f}", ha="center", va="center", color=color, weight=weight)
        axes.set_xticks(range(len(columns)), [printable(str(value)) for value in columns])
        axes.set_yticks(range(len(rows)), [printable(str(value)) for value in rows])
        axes.set(xlabel=printable(across), ylabel=printable(down))
        figure.colorbar(image, label="mean error, m")
    rest = f", the best over {', '.join(labels[2:])}" if len(labels) > 2 else ""
    caption = f"Mean error in metres at all scored waypoints{rest}; the least is bold."
    return Chart(path, f"Sweep of {table}", caption, keeps_colors=True)


def _pareto_chart(result: ComparisonResult, path: Path) -> Chart:
    names = [n for n in result.pipelines if result.metrics[n]["cost"]["tick_us"] and np.isfinite(_mean_m(result, n))]
    cost = [float(result.metrics[name]["cost"]["tick_us"]) for name in names]
    error = [_mean_m(result, name) for name in names]
    front = pareto(cost, error)
    with canvas(path, (5.2, 3.2)) as figure:
        axes = figure.add_subplot()
        style_axes(axes)
        axes.set_xscale("log")
        axes.plot(cost, error, linestyle="none", marker="o", markersize=4, color=MUTED)
        axes.plot(
            [cost[i] for i in front],
            [error[i] for i in front],
            color="#d55e00",
            marker="o",
            markersize=4.5,
            drawstyle="steps-post",
        )
        for i in _annotated(cost, error, front):
            axes.annotate(printable(names[i]), (cost[i], error[i]), (4, 3), textcoords="offset points", fontsize=7)
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set(xlabel="processor time per tick, µs", ylabel="mean error, m")
    caption = "The line joins the pipelines that no other beats in both; names that would overlap are omitted."
    return Chart(path, "Error against cost", caption)


def _annotated(cost: Sequence[float], error: Sequence[float], front: Sequence[int]) -> list[int]:
    """Return the points to name: the front, and others whose names do not overlap."""
    across = np.log(np.array(cost)) / max(1e-9, float(np.ptp(np.log(np.array(cost)))))
    up = np.array(error) / max(1e-9, float(np.ptp(np.array(error))))
    named = list(front)
    for i in range(len(cost)):
        if i not in named and all(abs(across[i] - across[j]) > 0.35 or abs(up[i] - up[j]) > 0.07 for j in named):
            named.append(i)
    return named


def _unique_values(values: Sequence[Any]) -> list[Any]:
    unique = [value for i, value in enumerate(values) if value not in values[:i]]
    return sorted(unique) if all(isinstance(value, (int, float)) for value in unique) else unique


_MIN_BIN_SIZE: Final = 5
_TICKS_M: Final = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
_NOMINAL_LEVELS: Final = np.linspace(0.02, 0.98, 49)


def draw_charts(result: ComparisonResult, folder: Path) -> tuple[Chart, ...]:
    """Draw all figures for which there are samples into ``folder``, which must exist."""
    charts: list[Chart] = []
    all_samples = result.samples[Scope.ALL]
    if len(all_samples) == 0:
        return ()
    if result.comparisons:
        charts.append(_difference_chart(result, folder / "differences.svg"))
    for scope in (Scope.ALL, Scope.COVERED):
        samples = result.samples[scope]
        if scope is Scope.ALL or result.partly_covered:
            path = folder / f"cdf-{scope.value}.svg"
            draw_cdf({name: samples.sample_errors[name].error_m for name in drawn_pipelines(result)}, path)
            where = "all scored" if scope is Scope.ALL else "covered"
            charts.append(Chart(path, f"Errors at {where} waypoints", f"Distribution of {len(samples)} errors."))
    others = [name for name in drawn_pipelines(result) if name != result.baseline]
    if others:
        charts.append(_paired_error_chart(result, all_samples, others, folder / "paired.svg"))
        charts.append(_walk_difference_chart(result, all_samples, others, folder / "walks.svg"))
    between = result.samples[Scope.INTERPOLATED]
    if len(between):
        note = "against truth interpolated between waypoints; bins with fewer than five values are omitted."
        path, name = folder / "time.svg", "Error over time"
        _binned_error_chart(result, path, between, between.t_s, 10.0, "time since the first waypoint, s")
        charts.append(Chart(path, name, f"Mean (line) and third quartile (thin) per 10 s, {note}"))
        path, name = folder / "distance.svg", "Error over distance"
        _binned_error_chart(result, path, between, between.travelled_m, 10.0, "distance since the first waypoint, m")
        charts.append(Chart(path, name, f"Mean (line) and third quartile (thin) per 10 m, {note}"))
    charts.append(_calibration_chart(result, all_samples, folder / "uncertainty.svg"))
    return (*charts, *sweep_charts(result, folder))


@contextmanager
def _axes(path: Path, size_in: tuple[float, float]) -> Iterator[tuple[Figure, Axes]]:
    with canvas(path, size_in) as figure:
        axes = figure.add_subplot()
        style_axes(axes)
        yield figure, axes


def _difference_chart(result: ComparisonResult, path: Path) -> Chart:
    shown = [c for c in result.comparisons if c.metric == result.metric and c.scope != Scope.INTERPOLATED.value]
    if not result.partly_covered:
        shown = [c for c in shown if c.scope == Scope.ALL.value]
    scopes = list(dict.fromkeys(c.scope for c in shown))
    names = list(dict.fromkeys(c.pipeline for c in shown))
    with _axes(path, (6.4, 0.7 + 0.24 * len(shown))) as (_, axes):
        axes.axvline(0.0, color=FOREGROUND, linewidth=0.8)
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
            style_axes(axes)
            draw(axes, name)
            axes.set_title(printable(name))


def _paired_error_chart(result: ComparisonResult, samples: PooledSamples, names: Sequence[str], path: Path) -> Chart:
    base = samples.sample_errors[result.baseline].error_m
    every = np.concatenate([base, *(samples.sample_errors[name].error_m for name in names)])
    low, high = max(0.05, float(every.min()) / 1.3), max(1.0, float(every.max()) * 1.3)
    style = pipeline_styles(result)

    def draw(axes: Axes, name: str) -> None:
        axes.plot([low, high], [low, high], color=FOREGROUND, linewidth=0.8)
        axes.plot(
            np.maximum(base, low),
            np.maximum(samples.sample_errors[name].error_m, low),
            linestyle="none",
            marker="o",
            markersize=2.6,
            markeredgewidth=0,
            alpha=0.55,
            color=style[name].color,
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


def _walk_difference_chart(result: ComparisonResult, samples: PooledSamples, names: Sequence[str], path: Path) -> Chart:
    sizes = np.bincount(samples.walk)
    style = pipeline_styles(result)

    def draw(axes: Axes, name: str) -> None:
        difference_m = samples.sample_errors[name].error_m - samples.sample_errors[result.baseline].error_m
        by_m = np.sort(np.bincount(samples.walk, weights=difference_m) / sizes)
        axes.bar(np.arange(len(by_m)), by_m, width=0.9, color=style[name].color)
        axes.axhline(0.0, color=FOREGROUND, linewidth=0.8)
        axes.set(xlabel="walks, sorted", ylabel="difference, m")
        axes.grid(axis="x", visible=False)
        axes.set_xticks([])

    _panels(path, names, draw, (2.4, 2.0))
    caption = f"Difference in mean error from {result.baseline}, walk by walk: below 0 the error is smaller."
    return Chart(path, "Differences by walk", caption)


def _binned_error_chart(
    result: ComparisonResult, path: Path, samples: PooledSamples, abscissa: Floats, width: float, label: str
) -> None:
    with _axes(path, (6.0, 2.9)) as (figure, axes):
        entries = []
        for name, style in pipeline_styles(result).items():
            found = bin_errors(abscissa, samples.sample_errors[name].error_m, width)
            kept = found.n >= _MIN_BIN_SIZE
            (line,) = axes.plot(
                found.middle[kept], found.mean_m[kept], color=style.color, linestyle=style.dashes, linewidth=1.6
            )
            axes.plot(found.middle[kept], found.p75_m[kept], color=style.color, linestyle=style.dashes, linewidth=0.6)
            entries.append((line, name))
        axes.set(xlabel=label, ylabel="error, m")
        axes.set_xlim(left=0.0)
        axes.set_ylim(bottom=0.0)
        legend(figure, entries, beside=True)


def _calibration_chart(result: ComparisonResult, samples: PooledSamples, path: Path) -> Chart:
    with _axes(path, (3.4, 3.2)) as (figure, axes):
        axes.plot([0, 100], [0, 100], color=MUTED, linewidth=0.8)
        entries: list[tuple[Line2D, str]] = []
        for name, style in pipeline_styles(result).items():
            levels = samples.sample_errors[name].density_level
            held = [100.0 * float(np.mean(levels <= p)) for p in _NOMINAL_LEVELS]
            (line,) = axes.plot(100 * _NOMINAL_LEVELS, held, color=style.color, linestyle=style.dashes, linewidth=1.5)
            entries.append((line, name))
        axes.set(xlim=(0, 100), ylim=(0, 100), aspect="equal")
        axes.set(xlabel="probability of the region, %", ylabel="truths inside, %")
        legend(figure, list(entries), beside=True)
    caption = (
        "Share of truths inside the highest-density region of a given probability; below the diagonal a pipeline is "
        "overconfident."
    )
    return Chart(path, "Uncertainty", caption)
