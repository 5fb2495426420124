"""The samples of all trials at which every pipeline has an estimate, and the metrics pooled over trials."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tickfix.api import Bools, Floats, Ints, Recording
from tickfix.evaluation.comparison.trial_outcomes import LabelCounts, TrialOutcome
from tickfix.evaluation.comparison.trials import Trial
from tickfix.evaluation.error_metrics import (
    REGION_LEVELS,
    ErrorStatistics,
    circular_error,
    ellipse_level,
    floor_probability,
    penalised_errors,
)
from tickfix.evaluation.paired_statistics import PairedErrors, number_labels
from tickfix.evaluation.scoring import SampleErrors
from tickfix.site.waypoints import assign_chains


class Scope(StrEnum):
    """The samples at which errors are taken, see ``docs/metrics.md``."""

    ALL = "all"
    COVERED = "covered"
    INTERPOLATED = "interpolated"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PooledSamples:
    """The n samples of a scope at which every pipeline has an estimate.

    Attributes:
        trial: (n,) int64, index into the trials.
        walk, chain: (n,) int64, numbers of the walk, whatever the seed, and of its chain, as in ``walks``.
        walks: names of the walks by number; those of grounds that share a name with another have the ground before.
        t_s: (n,) seconds since the walk's first waypoint.
        travelled_m: (n,) way since then.
        sample_errors: by pipeline.
    """

    trial: Ints
    walk: Ints
    chain: Ints
    walks: tuple[str, ...]
    t_s: Floats
    travelled_m: Floats
    sample_errors: Mapping[str, SampleErrors]

    def __len__(self) -> int:
        """Return n."""
        return len(self.trial)

    def paired(self, baseline: str, pipeline: str, errors: Mapping[str, Floats] | None = None) -> PairedErrors:
        """Return the errors of two pipelines, taken from ``errors`` if given."""
        one, two = (self.sample_errors[n].error_m if errors is None else errors[n] for n in (baseline, pipeline))
        return PairedErrors(baseline_m=one, pipeline_m=two, walk=self.walk, chain=self.chain)


def chain_names(trials: Sequence[Trial]) -> Mapping[tuple[str, str], str]:
    """Return the chain of each walk with waypoints, (site, walk) → name; see :mod:`tickfix.site.waypoints`."""
    walks = {(trial.site, trial.walk): _first_outcome(trial) for trial in trials}
    named: dict[tuple[str, str], str] = {}
    for site in dict.fromkeys(trial.site for trial in trials):
        recordings = [
            Recording(name=walk, floor=outcome.floor, events=outcome.truth)
            for (where, walk), outcome in walks.items()
            if where == site
        ]
        named |= {(site, walk): chain for walk, chain in assign_chains(recordings).items()}
    return named


def pool_samples(trials: Sequence[Trial], scope: Scope, use: Sequence[bool] | None = None) -> PooledSamples:
    """Pool the samples of a scope.

    Args:
        trials: all with the same pipelines.
        scope: which points.
        use: which of the trials; all by default.
    """
    named = chain_names(trials)
    kept: list[tuple[int, Ints, TrialOutcome]] = []
    for i, trial in enumerate(trials):
        if use is None or use[i]:
            kept.append((i, np.flatnonzero(scored(trial, scope)), _first_outcome(trial)))
    names = list(trials[0].outcomes) if trials else []
    trial_of = np.concatenate([np.zeros(0, np.int64), *(np.full(len(at), i) for i, at, _ in kept)]).astype(np.int64)
    walk_keys = [(trials[i].site, trials[i].walk) for i in trial_of.tolist()]
    walks = sorted(set(walk_keys))
    shown = [walk for _, walk in walks]
    truths = [
        (outcome.samples if scope is not Scope.INTERPOLATED else outcome.interpolated, at) for _, at, outcome in kept
    ]
    begins = [outcome.samples.t_ns[:1] for _, _, outcome in kept]
    return PooledSamples(
        trial=trial_of,
        walk=number_labels([f"{site}\0{walk}" for site, walk in walk_keys]),
        chain=number_labels([f"{site}\0{named[site, walk]}" for site, walk in walk_keys]),
        walks=tuple(walk if shown.count(walk) == 1 else f"{site}: {walk}" for site, walk in walks),
        t_s=_concatenated([(truth.t_ns[at] - t0) * 1e-9 for (truth, at), t0 in zip(truths, begins, strict=True)]),
        travelled_m=_concatenated([truth.travelled_m[at] for truth, at in truths]),
        sample_errors={
            name: _pool_errors([(trials[i].outcomes[name], at) for i, at, _ in kept], scope) for name in names
        },
    )


def scored(trial: Trial, scope: Scope) -> Bools:
    """Return (m,) bool: the samples of a trial that are in the scope and at which every pipeline has an estimate."""
    outcome = _first_outcome(trial)
    interpolated = scope is Scope.INTERPOLATED
    flags = np.ones(len(outcome.interpolated if interpolated else outcome.samples), dtype=np.bool_)
    if scope is Scope.COVERED:
        flags &= outcome.covered
    for one in trial.outcomes.values():
        flags &= (one.at_interpolated if interpolated else one.at_samples).estimated
    return flags


def _first_outcome(trial: Trial) -> TrialOutcome:
    return next(iter(trial.outcomes.values()))


def _pool_errors(outcomes: Sequence[tuple[TrialOutcome, Ints]], scope: Scope) -> SampleErrors:
    sample_errors = [(o.at_interpolated if scope is Scope.INTERPOLATED else o.at_samples, at) for o, at in outcomes]
    return SampleErrors(
        error_m=_concatenated([one.error_m[at] for one, at in sample_errors]),
        storeys_off=_concatenated([one.storeys_off[at] for one, at in sample_errors]).astype(np.int64),
        nees=_concatenated([one.nees[at] for one, at in sample_errors]),
        density_level=_concatenated([one.density_level[at] for one, at in sample_errors]),
    )


def _concatenated(parts: Sequence[NDArray[Any]]) -> Floats:
    return np.concatenate([np.zeros(0), *parts])


def scope_metrics(sample_errors: SampleErrors) -> dict[str, Any]:
    """Return the metrics of a pipeline at the samples of a scope, by the names of ``docs/metrics.md``."""
    known = sample_errors.nees[np.isfinite(sample_errors.nees)]
    ellipse = ellipse_level(sample_errors.nees)
    regions = {}
    for level in REGION_LEVELS:
        regions[f"ellipse_{100 * level:.0f}"] = _share_true(ellipse <= level)
        regions[f"density_{100 * level:.0f}"] = _share_true(sample_errors.density_level <= level)
    return ErrorStatistics.of(sample_errors.error_m).as_json() | {
        "ipin_m": ErrorStatistics.of(penalised_errors(sample_errors.error_m, sample_errors.storeys_off)).p75_m,
        "ce50_m": circular_error(sample_errors.error_m, 0.50),
        "ce95_m": circular_error(sample_errors.error_m, 0.95),
        "floor_probability": floor_probability(sample_errors.floor_right),
        "nees_mean": float(np.mean(known)) if len(known) else None,
        "nees_median": float(np.median(known)) if len(known) else None,
        **regions,
    }


def whole_track_metrics(outcomes: Sequence[TrialOutcome]) -> dict[str, Any]:
    """Return the metrics of a pipeline's whole tracks, by the names of ``docs/metrics.md``."""
    first = [o.first_position_s for o in outcomes if o.first_position_s is not None]
    minutes = sum(o.violations.moves for o in outcomes) / 300.0
    stationary = sum(o.stationary.stationary_s for o in outcomes) / 60.0
    accelerations = sum(o.smoothness.accelerations for o in outcomes)
    way_m = sum(float(o.samples.travelled_m[-1]) for o in outcomes if len(o.samples))
    return {
        "availability": _share_true(np.concatenate([o.at_samples.estimated for o in outcomes])),
        "availability_interpolated": _share_true(np.concatenate([o.at_interpolated.estimated for o in outcomes])),
        "first_position_s": float(np.median(first)) if first else None,
        "unpositioned_walks": len(outcomes) - len(first),
        "crossings_per_minute": _ratio(sum(o.violations.crossings for o in outcomes), minutes),
        "outside": _ratio(sum(o.violations.outside for o in outcomes), sum(o.violations.positions for o in outcomes)),
        "acceleration_mps2": None
        if not accelerations
        else float(np.sqrt(sum(o.smoothness.squared_mps2 for o in outcomes) / accelerations)),
        "path_ratio": _ratio(sum(o.smoothness.path_m for o in outcomes), way_m),
        "jumps_per_stationary_minute": _ratio(sum(o.stationary.jumps for o in outcomes), stationary),
        "stationary_minutes": stationary,
        "statuses": sum_counts(o.statuses for o in outcomes),
        "reasons": sum_counts(o.reasons for o in outcomes),
        "failures": sum_counts(o.failures for o in outcomes),
    }


def cost_metrics(outcomes: Sequence[TrialOutcome]) -> dict[str, float | None]:
    """Return the processor time of a pipeline, by the names of ``docs/metrics.md``."""
    costs = [o.cost for o in outcomes]
    spent = {name: sum(getattr(cost, name) for cost in costs) for name in ("pdr_ns", "fingerprint_ns", "filter_ns")}
    ticks, scans = sum(cost.ticks for cost in costs), sum(cost.scans for cost in costs)
    return {
        "tick_us": _ratio(sum(spent.values()) * 1e-3, ticks),
        "pdr_us": _ratio(spent["pdr_ns"] * 1e-3, ticks),
        "filter_us": _ratio(spent["filter_ns"] * 1e-3, ticks),
        "fix_us": _ratio(spent["fingerprint_ns"] * 1e-3, scans),
    }


def seed_deviation(samples: PooledSamples, trials: Sequence[Trial], pipeline: str) -> float | None:
    """Return the standard deviation of the mean error from seed to seed, metres; None with one seed."""
    seeds = np.array([trials[i].seed for i in samples.trial.tolist()])
    means = [float(np.mean(samples.sample_errors[pipeline].error_m[seeds == seed])) for seed in np.unique(seeds)]
    return float(np.std(means, ddof=1)) if len(means) > 1 else None


def sum_counts(many: Iterable[LabelCounts]) -> Mapping[str, int]:
    """Return the sum of counts, key by key."""
    total: Counter[str] = Counter()
    for counts in many:
        total.update(dict(counts))
    return dict(sorted(total.items()))


def _share_true(flags: Any) -> float | None:
    return float(np.mean(flags)) if len(flags) else None


def _ratio(amount: float, of: float) -> float | None:
    return float(amount / of) if of else None
