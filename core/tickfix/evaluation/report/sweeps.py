"""Figures of a sweep: error over one parameter, or two, and error against cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from tickfix.api import Floats
from tickfix.evaluation.comparison.points import Scope
from tickfix.evaluation.comparison.result import Result
from tickfix.evaluation.report.chart import Chart, quiet
from tickfix.evaluation.style import INK, QUIET, canvas, printable

_SEQUENTIAL: Final = "cividis"
"""Made for the colour-blind: J. Nuñez, C. Anderton, R. Renslow (2018)."""


def sweep_charts(result: Result, folder: Path) -> tuple[Chart, ...]:
    """Draw a figure for each swept table, and error against cost where there are at least three pipelines."""
    charts = []
    tables: dict[str, dict[str, Mapping[str, Any]]] = {}
    for name, sweep in result.provenance.get("sweeps", {}).items():
        if name in result.pipelines:
            tables.setdefault(sweep["table"], {})[name] = sweep["values"]
    for i, (table, pipelines) in enumerate(tables.items()):
        labels = [label for label in next(iter(pipelines.values())) if _varies(label, pipelines)]
        if len(labels) == 1:
            charts.append(_line(result, table, labels[0], pipelines, folder / f"sweep-{i}.svg"))
        elif labels:
            charts.append(_heat(result, table, labels, pipelines, folder / f"sweep-{i}.svg"))
    if len(result.pipelines) > 2:
        charts.append(_front(result, folder / "cost.svg"))
    return tuple(charts)


def pareto(cost: Sequence[float], error: Sequence[float]) -> tuple[int, ...]:
    """Return the numbers of the points that no other beats in both, by growing cost."""
    front: list[int] = []
    for i in sorted(range(len(cost)), key=lambda i: (cost[i], error[i])):
        if not front or error[i] < error[front[-1]]:
            front.append(i)
    return tuple(front)


def _varies(label: str, pipelines: Mapping[str, Mapping[str, Any]]) -> bool:
    return len({str(values[label]) for values in pipelines.values()}) > 1


def _mean_m(result: Result, name: str) -> float:
    found = result.figures[name][Scope.ALL.value]["mean_m"]
    return float("nan") if found is None else float(found)


def _line(result: Result, table: str, label: str, pipelines: Mapping[str, Mapping[str, Any]], path: Path) -> Chart:
    values = [values[label] for values in pipelines.values()]
    numbers = all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values)
    at = np.array(values, dtype=float) if numbers else np.arange(len(values), dtype=float)
    order = np.argsort(at, kind="stable")
    names = [list(pipelines)[i] for i in order]
    with canvas(path, (4.2, 2.9)) as figure:
        axes = figure.add_subplot()
        quiet(axes)
        for scope, color, marker, words in (
            (Scope.ALL, "#0072b2", "o", "all scored"),
            (Scope.COVERED, "#d55e00", "s", "covered"),
        ):
            if scope is Scope.ALL or result.partly_covered:
                means = [result.figures[name][scope.value]["mean_m"] for name in names]
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


def _heat(
    result: Result, table: str, labels: Sequence[str], pipelines: Mapping[str, Mapping[str, Any]], path: Path
) -> Chart:
    down, across = labels[:2]
    rows = _ordered([values[down] for values in pipelines.values()])
    columns = _ordered([values[across] for values in pipelines.values()])
    cells: Floats = np.full((len(rows), len(columns)), np.nan)
    for name, values in pipelines.items():
        i, j = rows.index(values[down]), columns.index(values[across])
        cells[i, j] = np.fmin(cells[i, j], _mean_m(result, name))
    with canvas(path, (1.6 + 0.62 * len(columns), 1.1 + 0.42 * len(rows))) as figure:
        axes = figure.add_subplot()
        image = axes.imshow(cells, cmap=_SEQUENTIAL, aspect="auto")
        low, high = np.nanmin(cells), np.nanmax(cells)
        for i, j in np.argwhere(np.isfinite(cells)).tolist():
            dark = cells[i, j] < (low + high) / 2
            weight = "bold" if cells[i, j] == low else "normal"
            color = "white" if dark else INK
            axes.text(j, i, f"{cells[i, j]:.2f}", ha="center", va="center", color=color, weight=weight)
        axes.set_xticks(range(len(columns)), [printable(str(value)) for value in columns])
        axes.set_yticks(range(len(rows)), [printable(str(value)) for value in rows])
        axes.set(xlabel=printable(across), ylabel=printable(down))
        figure.colorbar(image, label="mean error, m")
    rest = f", the best over {', '.join(labels[2:])}" if len(labels) > 2 else ""
    return Chart(path, f"Sweep of {table}", f"Mean error in metres at all scored waypoints{rest}; the least is bold.")


def _front(result: Result, path: Path) -> Chart:
    names = [n for n in result.pipelines if result.figures[n]["cost"]["tick_us"] and np.isfinite(_mean_m(result, n))]
    cost = [float(result.figures[name]["cost"]["tick_us"]) for name in names]
    error = [_mean_m(result, name) for name in names]
    front = pareto(cost, error)
    with canvas(path, (5.2, 3.2)) as figure:
        axes = figure.add_subplot()
        quiet(axes)
        axes.set_xscale("log")
        axes.plot(cost, error, linestyle="none", marker="o", markersize=4, color=QUIET)
        axes.plot(
            [cost[i] for i in front],
            [error[i] for i in front],
            color="#d55e00",
            marker="o",
            markersize=4.5,
            drawstyle="steps-post",
        )
        for i in _named(cost, error, front):
            axes.annotate(printable(names[i]), (cost[i], error[i]), (4, 3), textcoords="offset points", fontsize=7)
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set(xlabel="processor time per tick, µs", ylabel="mean error, m")
    caption = "The line joins the pipelines that no other beats in both; where names would overlap, some are left out."
    return Chart(path, "Error against cost", caption)


def _named(cost: Sequence[float], error: Sequence[float], front: Sequence[int]) -> list[int]:
    """Return the points to name: the front, and others whose names do not lie on one another."""
    across = np.log(np.array(cost)) / max(1e-9, float(np.ptp(np.log(np.array(cost)))))
    up = np.array(error) / max(1e-9, float(np.ptp(np.array(error))))
    named = list(front)
    for i in range(len(cost)):
        if i not in named and all(abs(across[i] - across[j]) > 0.35 or abs(up[i] - up[j]) > 0.07 for j in named):
            named.append(i)
    return named


def _ordered(values: Sequence[Any]) -> list[Any]:
    unique = [value for i, value in enumerate(values) if value not in values[:i]]
    return sorted(unique) if all(isinstance(value, (int, float)) for value in unique) else unique
