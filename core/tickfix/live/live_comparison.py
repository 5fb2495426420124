"""Pipelines compared with the primary one while they run.

Errors at true waypoints, NIS and divergence, with an interval that is valid at any time [waudby-smith2024, Theorem
2.2].
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from tickfix.api import Truth
from tickfix.live.protocol import EncodedEstimate

_MIN_VALUES: Final = 20
_TIGHTEST_COUNT: Final = 100


class AnytimeMean:
    """A running mean with its confidence sequence.

    The half width after n values is σ̂ · √(2 (n ρ² + 1) / (n² ρ²) · ln(√(n ρ² + 1) / α)), with ρ² chosen so that the
    sequence is tightest near n = 100.

    Args:
        alpha: 1 minus the confidence.
    """

    def __init__(self, alpha: float = 0.05) -> None:
        """Begin with no value."""
        self._alpha = alpha
        log_term = -2.0 * math.log(alpha)
        self._rho2 = (log_term + math.log(log_term + 1.0)) / _TIGHTEST_COUNT
        self.count = 0
        self.mean = 0.0
        self._sum_squares = 0.0

    def add(self, value: float) -> None:
        """Take a value in (Welford's recursion)."""
        self.count += 1
        step = value - self.mean
        self.mean += step / self.count
        self._sum_squares += step * (value - self.mean)

    @property
    def interval(self) -> tuple[float, float] | None:
        """Where the mean lies, None before there are twenty values."""
        n = self.count
        if n < _MIN_VALUES:
            return None
        grown = n * self._rho2 + 1.0
        width = math.sqrt(2.0 * grown / (n * n * self._rho2) * math.log(math.sqrt(grown) / self._alpha))
        half = math.sqrt(self._sum_squares / (n - 1)) * width
        return self.mean - half, self.mean + half


_ESTIMATES_KEPT: Final = 64
WRONG_FLOOR_M: Final = 15.0
"""Added to the error on a wrong floor, as at the IPIN competitions."""


@dataclass(slots=True)
class _RunningMean:
    total: float = 0.0
    count: int = 0

    def add(self, value: float) -> None:
        self.total += value
        self.count += 1

    @property
    def value(self) -> float | None:
        return self.total / self.count if self.count else None


@dataclass(slots=True)
class _WalkState:
    estimates: dict[str, deque[EncodedEstimate]] = field(default_factory=dict)
    errors: dict[str, _RunningMean] = field(default_factory=dict)


@dataclass(slots=True)
class _PipelineScore:
    error: _RunningMean = field(default_factory=_RunningMean)
    innovation: _RunningMean = field(default_factory=_RunningMean)
    nis: _RunningMean = field(default_factory=_RunningMean)
    divergence: _RunningMean = field(default_factory=_RunningMean)
    difference: AnytimeMean = field(default_factory=AnytimeMean)


class LiveComparison:
    """Scores pipelines against the one that was primary when the contest began.

    Args:
        names: of the pipelines.
        baseline: whom the others are compared with.
    """

    def __init__(self, names: Sequence[str], baseline: str) -> None:
        """Begin with nothing seen."""
        self._names = tuple(names)
        self._baseline = baseline
        self._walks: dict[str, _WalkState] = {}
        self._scores = {name: _PipelineScore() for name in names}

    def estimates(self, published: Sequence[EncodedEstimate]) -> None:
        """Record the estimates of all pipelines for ticks that closed."""
        by_tick: dict[tuple[str, int], dict[str, EncodedEstimate]] = {}
        for estimate in published:
            walk = self._walks.setdefault(estimate.device, _WalkState())
            walk.estimates.setdefault(estimate.pipeline, deque(maxlen=_ESTIMATES_KEPT)).append(estimate)
            by_tick.setdefault((estimate.device, estimate.tick), {})[estimate.pipeline] = estimate
            score = self._scores[estimate.pipeline]
            if estimate.innovation_m is not None:
                score.innovation.add(estimate.innovation_m)
            if estimate.nis is not None:
                score.nis.add(estimate.nis)
        for estimates in by_tick.values():
            reference = estimates.get(self._baseline)
            for name, estimate in estimates.items():
                distance_m = _divergence_m(estimate, reference)
                if name != self._baseline and distance_m is not None:
                    self._scores[name].divergence.add(distance_m)

    def truth(self, truth: Truth) -> None:
        """Score the last estimates before a waypoint; it counts only if every pipeline has one."""
        walk = self._walks.get(truth.device)
        if walk is None:
            return
        errors: dict[str, float] = {}
        for name in self._names:
            error_m = _error_m(walk.estimates.get(name, deque()), truth)
            if error_m is None:
                return
            errors[name] = error_m
        for name, error_m in errors.items():
            self._scores[name].error.add(error_m)
            walk.errors.setdefault(name, _RunningMean()).add(error_m)

    def finish(self, device: str) -> None:
        """A walk is over: it gives one difference for each challenger."""
        walk = self._walks.pop(device, None)
        reference = None if walk is None else walk.errors.get(self._baseline, _RunningMean()).value
        if walk is None or reference is None:
            return
        for name, mean in walk.errors.items():
            if name != self._baseline and mean.value is not None:
                self._scores[name].difference.add(mean.value - reference)

    def report(self) -> dict[str, Any]:
        """Return what is known so far, by pipeline; the interval is 95 %, whenever it is looked at."""
        return {
            name: {
                "baseline": "" if name == self._baseline else self._baseline,
                "error_m": score.error.value,
                "waypoints": score.error.count,
                "walks": score.difference.count,
                "difference_m": score.difference.mean if score.difference.count else None,
                "interval_m": None if score.difference.interval is None else list(score.difference.interval),
                "innovation_m": score.innovation.value,
                "nis": score.nis.value,
                "divergence_m": score.divergence.value,
            }
            for name, score in self._scores.items()
        }


def _divergence_m(one: EncodedEstimate, other: EncodedEstimate | None) -> float | None:
    if other is None or one.xy is None or other.xy is None or one.floor != other.floor:
        return None
    return math.dist(one.xy, other.xy)


def _error_m(estimates: Sequence[EncodedEstimate], truth: Truth) -> float | None:
    """Return the error of the newest estimate of a tick no later than the waypoint, in metres."""
    by_then = [(s.floor, s.xy) for s in estimates if s.t_ns <= truth.t_ns and s.xy is not None]
    if not by_then:
        return None
    floor, xy = by_then[-1]
    penalty_m = 0.0 if floor == truth.floor else WRONG_FLOOR_M
    return math.dist(xy, truth.xy.tolist()) + penalty_m
