"""All figures of a pipeline over all trials, apart from those that ``tickfix replay`` prints as well."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from tickfix.evaluation.comparison.outcome import Counts, Outcome
from tickfix.evaluation.comparison.points import Points
from tickfix.evaluation.comparison.trial import Trial
from tickfix.evaluation.figures import Figures
from tickfix.evaluation.metrics.circular import circular_error, floor_probability
from tickfix.evaluation.metrics.penalised import penalised_errors
from tickfix.evaluation.metrics.pointwise import Pointwise
from tickfix.evaluation.metrics.regions import LEVELS, ellipse_level


def scope_figures(said: Pointwise) -> dict[str, Any]:
    """Return the figures of a pipeline at the points of a scope, by the names of ``docs/metrics.md``."""
    known = said.nees[np.isfinite(said.nees)]
    ellipse = ellipse_level(said.nees)
    regions = {}
    for level in LEVELS:
        regions[f"ellipse_{100 * level:.0f}"] = _share(ellipse <= level)
        regions[f"density_{100 * level:.0f}"] = _share(said.density_level <= level)
    return Figures.of(said.error_m).as_json() | {
        "ipin_m": Figures.of(penalised_errors(said.error_m, said.floors_off)).p75_m,
        "ce50_m": circular_error(said.error_m, 0.50),
        "ce95_m": circular_error(said.error_m, 0.95),
        "floor_probability": floor_probability(said.floor_right),
        "nees_mean": float(np.mean(known)) if len(known) else None,
        "nees_median": float(np.median(known)) if len(known) else None,
        **regions,
    }


def track_figures(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return the figures of a pipeline's whole tracks, by the names of ``docs/metrics.md``."""
    first = [o.first_position_s for o in outcomes if o.first_position_s is not None]
    minutes = sum(o.violations.moves for o in outcomes) / 300.0
    standing = sum(o.standing.standing_s for o in outcomes) / 60.0
    accelerations = sum(o.smoothness.accelerations for o in outcomes)
    way_m = sum(float(o.points.travelled_m[-1]) for o in outcomes if len(o.points))
    return {
        "availability": _share(np.concatenate([o.at_points.estimated for o in outcomes])),
        "availability_between": _share(np.concatenate([o.at_between.estimated for o in outcomes])),
        "first_position_s": float(np.median(first)) if first else None,
        "never_positioned": len(outcomes) - len(first),
        "crossings_per_minute": _ratio(sum(o.violations.crossings for o in outcomes), minutes),
        "outside": _ratio(sum(o.violations.outside for o in outcomes), sum(o.violations.positions for o in outcomes)),
        "acceleration_mps2": None
        if not accelerations
        else float(np.sqrt(sum(o.smoothness.squared_mps2 for o in outcomes) / accelerations)),
        "path_ratio": _ratio(sum(o.smoothness.path_m for o in outcomes), way_m),
        "jumps_per_standing_minute": _ratio(sum(o.standing.jumps for o in outcomes), standing),
        "standing_minutes": standing,
        "statuses": counted(o.statuses for o in outcomes),
        "reasons": counted(o.reasons for o in outcomes),
        "failures": counted(o.failures for o in outcomes),
    }


def cost_figures(outcomes: Sequence[Outcome]) -> dict[str, float | None]:
    """Return what a pipeline cost, by the names of ``docs/metrics.md``."""
    costs = [o.cost for o in outcomes]
    spent = {name: sum(getattr(cost, name) for cost in costs) for name in ("pdr_ns", "fingerprint_ns", "filter_ns")}
    ticks, scans = sum(cost.ticks for cost in costs), sum(cost.scans for cost in costs)
    return {
        "tick_us": _ratio(sum(spent.values()) * 1e-3, ticks),
        "pdr_us": _ratio(spent["pdr_ns"] * 1e-3, ticks),
        "filter_us": _ratio(spent["filter_ns"] * 1e-3, ticks),
        "fix_us": _ratio(spent["fingerprint_ns"] * 1e-3, scans),
    }


def seed_spread(points: Points, trials: Sequence[Trial], pipeline: str) -> float | None:
    """Return the standard deviation of the mean error from seed to seed, metres; None with one seed."""
    seeds = np.array([trials[i].seed for i in points.trial.tolist()])
    means = [float(np.mean(points.said[pipeline].error_m[seeds == seed])) for seed in np.unique(seeds)]
    return float(np.std(means, ddof=1)) if len(means) > 1 else None


def counted(many: Iterable[Counts]) -> Mapping[str, int]:
    """Return counts added up."""
    total: Counter[str] = Counter()
    for counts in many:
        total.update(dict(counts))
    return dict(sorted(total.items()))


def _share(flags: Any) -> float | None:
    return float(np.mean(flags)) if len(flags) else None


def _ratio(amount: float, of: float) -> float | None:
    return float(amount / of) if of else None
