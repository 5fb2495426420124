"""The points of all trials together: where every pipeline has an estimate, and what each of them said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tickfix.api import Bools, Floats, Ints, Recording
from tickfix.evaluation.comparison.outcome import Outcome
from tickfix.evaluation.comparison.trial import Trial
from tickfix.evaluation.metrics.pointwise import Pointwise
from tickfix.evaluation.statistics.samples import Paired, numbered
from tickfix.site.holdout import chains


class Scope(StrEnum):
    """At which points figures are taken, see ``docs/metrics.md``."""

    ALL = "all"
    COVERED = "covered"
    INTERPOLATED = "interpolated"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Points:
    """The n points of a scope at which every pipeline has an estimate.

    Attributes:
        trial: (n,) int64, index into the trials.
        walk, chain: (n,) int64, numbers of the walk, whatever the seed, and of its chain, as in ``walks``.
        walks: names of the walks by number; those of grounds that share a name with another have the ground before.
        t_s: (n,) seconds since the walk's first waypoint.
        travelled_m: (n,) way since then.
        said: by pipeline.
    """

    trial: Ints
    walk: Ints
    chain: Ints
    walks: tuple[str, ...]
    t_s: Floats
    travelled_m: Floats
    said: Mapping[str, Pointwise]

    def __len__(self) -> int:
        """Return n."""
        return len(self.trial)

    def paired(self, baseline: str, pipeline: str, errors: Mapping[str, Floats] | None = None) -> Paired:
        """Return the errors of two pipelines, or those of ``errors`` in their place."""
        one, two = (self.said[n].error_m if errors is None else errors[n] for n in (baseline, pipeline))
        return Paired(baseline_m=one, pipeline_m=two, walk=self.walk, chain=self.chain)


def chain_names(trials: Sequence[Trial]) -> Mapping[tuple[str, str], str]:
    """Return the chain of each walk with waypoints, (ground, walk) → name; see :mod:`tickfix.site.holdout`."""
    walks = {(trial.ground, trial.walk): _first(trial) for trial in trials}
    named: dict[tuple[str, str], str] = {}
    for ground in dict.fromkeys(trial.ground for trial in trials):
        recordings = [
            Recording(name=walk, floor=outcome.floor, events=outcome.truth)
            for (where, walk), outcome in walks.items()
            if where == ground
        ]
        named |= {(ground, walk): chain for walk, chain in chains(recordings).items()}
    return named


def points_of(trials: Sequence[Trial], scope: Scope, use: Sequence[bool] | None = None) -> Points:
    """Bring the points of a scope together.

    Args:
        trials: all with the same pipelines.
        scope: which points.
        use: which of the trials; all by default.
    """
    named = chain_names(trials)
    kept: list[tuple[int, Ints, Outcome]] = []
    for i, trial in enumerate(trials):
        if use is None or use[i]:
            kept.append((i, np.flatnonzero(scored(trial, scope)), _first(trial)))
    names = list(trials[0].outcomes) if trials else []
    trial_of = np.concatenate([np.zeros(0, np.int64), *(np.full(len(at), i) for i, at, _ in kept)]).astype(np.int64)
    owners = [(trials[i].ground, trials[i].walk) for i in trial_of.tolist()]
    walks = sorted(set(owners))
    shown = [walk for _, walk in walks]
    truths = [(outcome.points if scope is not Scope.INTERPOLATED else outcome.between, at) for _, at, outcome in kept]
    begins = [outcome.points.t_ns[:1] for _, _, outcome in kept]
    return Points(
        trial=trial_of,
        walk=numbered([f"{ground}\0{walk}" for ground, walk in owners]),
        chain=numbered([f"{ground}\0{named[ground, walk]}" for ground, walk in owners]),
        walks=tuple(walk if shown.count(walk) == 1 else f"{ground}: {walk}" for ground, walk in walks),
        t_s=_joined([(truth.t_ns[at] - t0) * 1e-9 for (truth, at), t0 in zip(truths, begins, strict=True)]),
        travelled_m=_joined([truth.travelled_m[at] for truth, at in truths]),
        said={name: _said([(trials[i].outcomes[name], at) for i, at, _ in kept], scope) for name in names},
    )


def scored(trial: Trial, scope: Scope) -> Bools:
    """Tell for each point of a trial whether the scope has it and every pipeline an estimate there: (m,) bool."""
    outcome = _first(trial)
    between = scope is Scope.INTERPOLATED
    flags = np.ones(len(outcome.between if between else outcome.points), dtype=np.bool_)
    if scope is Scope.COVERED:
        flags &= outcome.covered
    for one in trial.outcomes.values():
        flags &= (one.at_between if between else one.at_points).estimated
    return flags


def _first(trial: Trial) -> Outcome:
    return next(iter(trial.outcomes.values()))


def _said(outcomes: Sequence[tuple[Outcome, Ints]], scope: Scope) -> Pointwise:
    said = [(o.at_between if scope is Scope.INTERPOLATED else o.at_points, at) for o, at in outcomes]
    return Pointwise(
        error_m=_joined([one.error_m[at] for one, at in said]),
        floors_off=_joined([one.floors_off[at] for one, at in said]).astype(np.int64),
        nees=_joined([one.nees[at] for one, at in said]),
        density_level=_joined([one.density_level[at] for one, at in said]),
    )


def _joined(parts: Sequence[NDArray[Any]]) -> Floats:
    return np.concatenate([np.zeros(0), *parts])
