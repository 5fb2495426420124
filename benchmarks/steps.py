"""Steps counted on the hand-held Oxford recordings, beside the steps that switches in both shoes counted.

Run ``python benchmarks/steps.py [FOLDER]``; the folder is ``oxford-step-counter`` of the real recordings, found as the
tests find it. Thresholds of ``multi-threshold`` and ``steps`` are chosen leaving the person out: for the walks of one
person, those that did best on the walks of all others (persons weighing alike). Beside them stands ``steps`` with its
shipped parameters, which nobody fitted to these recordings.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from tickfix.api import Samples
from tickfix.toolkit.step_signal import Extremum, StepDetectorState, StepSignalState, detect_extrema, detect_steps
from tickfix_pdr.multi_threshold import ExtremaState, MultiThresholdParams, StepThresholds, detect_steps_from_extrema
from tickfix_pdr.steps import StepsParams

LOW_PASS_HZ = (1.5, 2.0, 2.5, 3.0, 4.0)
AMPLITUDES = (0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
BETWEEN_S = (0.2, 0.3, 0.4)
Choice = tuple[float, float, float]


@dataclass(frozen=True)
class Walk:
    """A recording: who walked, what the phone felt and how many steps the switches counted."""

    name: str
    person: str
    accelerometer: Samples
    steps: int


def read(folder: Path) -> list[Walk]:
    """Read the hand-held walks; their folders are named phone, person, ground, hold, number."""
    walks = []
    for path in sorted((folder / "optimisation").iterdir()):
        rows = np.loadtxt(path / "accelerometer.csv.gz", delimiter=",", usecols=(2, 3, 4))
        t_ns = np.loadtxt(path / "accelerometer.csv.gz", delimiter=",", usecols=0, dtype=np.int64)
        feet = np.loadtxt(path / "stepcounter.csv.gz", delimiter=",", usecols=(1, 2))
        order = np.unique(t_ns, return_index=True)[1]
        steps = int((np.diff(feet, axis=0) > 0).sum())  # rising edges of both columns
        walks.append(Walk(path.name, path.name.split("_")[1], Samples(t_ns[order], rows[order]), steps))
    return walks


def multi_threshold(walk: Walk) -> Mapping[Choice, int]:
    """Return the steps that ``multi-threshold`` finds with each low-pass, amplitude and time between peaks."""
    counts = {}
    for low_pass_hz in LOW_PASS_HZ:
        extrema: Sequence[Extremum] = detect_extrema(StepSignalState(), walk.accelerometer, low_pass_hz)[1]
        for amplitude, min_peak_interval_s in product(AMPLITUDES, BETWEEN_S):
            thresholds = StepThresholds(amplitude, min_peak_interval_s, MultiThresholdParams().stationary_after_s)
            counts[low_pass_hz, amplitude, min_peak_interval_s] = len(
                detect_steps_from_extrema(ExtremaState(), extrema, thresholds)[1]
            )
    return counts


def steps(walk: Walk) -> Mapping[Choice, int]:
    """Return the steps that the pdr ``steps`` finds with each choice of low-pass, threshold and shortest time."""
    return {choice: count_by_steps(walk, choice) for choice in product(LOW_PASS_HZ, AMPLITUDES, BETWEEN_S)}


def count_by_steps(walk: Walk, choice: Choice) -> int:
    """Return the steps that the pdr ``steps`` finds with one choice."""
    low_pass_hz, threshold, min_step_interval_s = choice
    found = detect_steps(
        StepDetectorState(),
        walk.accelerometer,
        low_pass_hz=low_pass_hz,
        threshold=threshold,
        min_step_interval_s=min_step_interval_s,
    )
    return len(found[1])


def best(walks: Sequence[Walk], counts: Mapping[str, Mapping[Choice, int]]) -> Choice:
    """Return the choice with the least mean error, its own and its neighbours'; persons weigh alike."""
    persons = sorted({walk.person for walk in walks})

    def error(choice: Choice) -> float:
        return float(
            np.mean(
                [
                    np.mean([abs(counts[w.name][choice] / w.steps - 1.0) for w in walks if w.person == person])
                    for person in persons
                ]
            )
        )

    errors = {choice: error(choice) for choice in counts[walks[0].name]}
    grids = (LOW_PASS_HZ, AMPLITUDES, BETWEEN_S)

    def smoothed(choice: Choice) -> float:
        # Few walks fit many choices: one whose neighbours do as well is a choice, one that stands alone is luck.
        near = [
            errors[other]
            for other in errors
            if all(abs(g.index(a) - g.index(b)) <= 1 for g, a, b in zip(grids, choice, other, strict=True))
        ]
        return float(np.mean(near)) + errors[choice]

    return min(errors, key=lambda choice: (smoothed(choice), choice))


def leaving_the_person_out(
    walks: Sequence[Walk], count: Callable[[Walk], Mapping[Choice, int]]
) -> list[tuple[Walk, Choice, int]]:
    """Return each walk with the choice that the other persons' walks made, and the steps found with it."""
    counts = {walk.name: count(walk) for walk in walks}
    choices = {
        person: best([w for w in walks if w.person != person], counts) for person in {walk.person for walk in walks}
    }
    return [(walk, choices[walk.person], counts[walk.name][choices[walk.person]]) for walk in walks]


def main() -> None:
    """Print the table."""
    told = Path(os.environ.get("TICKFIX_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    walks = read(Path(sys.argv[1]) if len(sys.argv) > 1 else told / "oxford-step-counter")
    p = StepsParams()
    shipped = [count_by_steps(walk, (p.low_pass_hz, p.threshold, p.min_step_interval_s)) for walk in walks]
    columns = {
        "multi-threshold": [found for _, _, found in leaving_the_person_out(walks, multi_threshold)],
        "steps": [found for _, _, found in leaving_the_person_out(walks, steps)],
        "steps as shipped": shipped,
    }
    print(f"{'walk':34} {'true':>5}" + "".join(f" {name:>17} {'error':>7}" for name in columns))
    errors = {name: np.array([f / w.steps - 1.0 for f, w in zip(c, walks, strict=True)]) for name, c in columns.items()}
    for i, walk in enumerate(walks):
        shown = "".join(f" {columns[name][i]:17} {errors[name][i]:7.1%}" for name in columns)
        print(f"{walk.name:34} {walk.steps:5}{shown}")
    for name, error in errors.items():
        print(f"{name}: mean |error| {np.abs(error).mean():.1%}, worst {np.abs(error).max():.1%}")
    chosen = {count.__name__: best(walks, {w.name: count(w) for w in walks}) for count in (multi_threshold, steps)}
    print(f"low-pass, amplitude and time between peaks chosen on all walks: {chosen}")


if __name__ == "__main__":
    main()
