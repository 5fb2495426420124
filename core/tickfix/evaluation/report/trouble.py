"""The worst walks, and what went wrong there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tickfix.evaluation.comparison.points import Scope, scored
from tickfix.evaluation.comparison.trial import Trial


@dataclass(frozen=True, slots=True, kw_only=True)
class Trouble:
    """One pipeline on one walk.

    Attributes:
        mean_m: of the errors at scored waypoints.
        worst_m, worst_s: the greatest of them, and when it was, seconds since the first waypoint.
        covered: whether the survey had been there.
        floor: on which the estimate was wrong, empty where it was right.
        words: what the pipeline said of itself then.
    """

    pipeline: str
    mean_m: float
    worst_m: float
    worst_s: float
    worst_point: int
    covered: bool
    floor: str
    words: str


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WorstWalk:
    """A walk with the trouble that each pipeline had on it."""

    trial: Trial
    troubles: tuple[Trouble, ...]

    @property
    def mean_m(self) -> float:
        """Mean error of the pipeline that was worst."""
        return max((trouble.mean_m for trouble in self.troubles), default=0.0)


def worst_walks(trials: Sequence[Trial]) -> tuple[WorstWalk, ...]:
    """Return every walk once, with the seed that was worst, the walk with the greatest mean error first.

    Walks of which no waypoint was scored come last.
    """
    worst: dict[tuple[str, str], WorstWalk] = {}
    for trial in trials:
        walk = WorstWalk(trial=trial, troubles=_troubles(trial))
        name = (trial.ground, trial.walk)
        if name not in worst or walk.mean_m > worst[name].mean_m:
            worst[name] = walk
    return tuple(sorted(worst.values(), key=lambda walk: (-walk.mean_m, walk.trial.ground, walk.trial.walk)))


def _troubles(trial: Trial) -> tuple[Trouble, ...]:
    kept = np.flatnonzero(scored(trial, Scope.ALL))
    if len(kept) == 0:
        return ()
    found = []
    for name, outcome in trial.outcomes.items():
        said = outcome.at_points
        i = int(kept[np.argmax(said.error_m[kept])])
        found.append(
            Trouble(
                pipeline=name,
                mean_m=float(np.mean(said.error_m[kept])),
                worst_m=float(said.error_m[i]),
                worst_s=float(outcome.points.t_ns[i] - outcome.points.t_ns[0]) * 1e-9,
                worst_point=i,
                covered=bool(outcome.covered[i]),
                floor="" if said.floor_right[i] else "wrong floor",
                words=str(outcome.diagnoses[i]),
            )
        )
    return tuple(found)
