"""The figures of a report as CSV, for other tools."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from tickfix.evaluation.comparison.points import Scope, chain_names
from tickfix.evaluation.comparison.result import Result

_POINTS = ("site", "walk", "chain", "seed", "time_s", "way_m", "floor", "x_m", "y_m", "covered", "pipeline")
_SAID = ("error_m", "storeys_off", "nees", "density_level")


def write_csv(result: Result, folder: Path) -> None:
    """Write ``points.csv``, a line per waypoint and pipeline, ``figures.csv`` and ``comparisons.csv``."""
    _write(folder / "points.csv", (*_POINTS, *_SAID), _points(result))
    _write(folder / "figures.csv", ("pipeline", "group", "figure", "value"), _figures(result))
    plain = [
        {name: value for name, value in c.as_json().items() if name not in ("interval_m", "worse_on")}
        | {"low_m": c.interval.low_m, "high_m": c.interval.high_m}
        for c in result.comparisons
    ]
    columns = list(plain[0]) if plain else ["pipeline"]
    _write(folder / "comparisons.csv", columns, ([row[name] for name in columns] for row in plain))


def _points(result: Result) -> Iterator[list[Any]]:
    chains = chain_names(result.trials)
    for trial in result.trials:
        for name, outcome in trial.outcomes.items():
            truth, said = outcome.points, outcome.at_points
            for i in range(len(truth)):
                yield [
                    trial.ground,
                    trial.walk,
                    chains.get((trial.ground, trial.walk), ""),
                    trial.seed,
                    (int(truth.t_ns[i]) - int(truth.t_ns[0])) * 1e-9,
                    float(truth.travelled_m[i]),
                    truth.floors[i],
                    *truth.xy[i].tolist(),
                    int(outcome.covered[i]),
                    name,
                    *(_known(said, column, i) for column in ("error_m", "floors_off", "nees", "density_level")),
                ]


def _known(said: Any, column: str, i: int) -> Any:
    value = getattr(said, column)[i].item()
    return "" if value != value or (column == "floors_off" and value < 0) else value  # noqa: PLR0124 - NaN


def _figures(result: Result) -> Iterator[tuple[Any, ...]]:
    groups = [*(scope.value for scope in Scope), "tracks", "cost"]
    for name, group in chain.from_iterable(((name, group) for group in groups) for name in result.pipelines):
        for figure, value in result.figures[name][group].items():
            if not isinstance(value, dict):
                yield name, group, figure, "" if value is None else value


def _write(path: Path, columns: Sequence[str], rows: Any) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
