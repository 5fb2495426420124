"""Challengers beside the primary pipeline, compared as they run.

Where truth comes in, every walk (a device, from its first message to its last) gives one paired difference of mean
errors, since errors within a walk are alike. Where none does, there remain how surprised each pipeline is by its fixes,
and how far apart they are.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from tickfix.api import Truth
from tickfix.drivers.live.anytime import AnytimeMean
from tickfix.drivers.live.saying import Saying

_KEPT: Final = 64
WRONG_FLOOR_M: Final = 15.0
"""Added to the error on a wrong floor, as at the IPIN competitions."""


@dataclass(slots=True)
class _Mean:
    total: float = 0.0
    count: int = 0

    def add(self, value: float) -> None:
        self.total += value
        self.count += 1

    @property
    def value(self) -> float | None:
        return self.total / self.count if self.count else None


@dataclass(slots=True)
class _Walk:
    said: dict[str, deque[Saying]] = field(default_factory=dict)
    errors: dict[str, _Mean] = field(default_factory=dict)


@dataclass(slots=True)
class _Score:
    error: _Mean = field(default_factory=_Mean)
    innovation: _Mean = field(default_factory=_Mean)
    surprise: _Mean = field(default_factory=_Mean)
    apart: _Mean = field(default_factory=_Mean)
    difference: AnytimeMean = field(default_factory=AnytimeMean)


class Contest:
    """Scores pipelines against the one that was primary when the contest began.

    Args:
        names: of the pipelines.
        baseline: whom the others are compared with.
    """

    def __init__(self, names: Sequence[str], baseline: str) -> None:
        """Begin with nothing seen."""
        self._names = tuple(names)
        self._baseline = baseline
        self._walks: dict[str, _Walk] = {}
        self._scores = {name: _Score() for name in names}

    def said(self, published: Sequence[Saying]) -> None:
        """Take note of estimates that closed a tick, all pipelines' of it."""
        by_tick: dict[tuple[str, int], dict[str, Saying]] = {}
        for estimate in published:
            walk = self._walks.setdefault(estimate.device, _Walk())
            walk.said.setdefault(estimate.pipeline, deque(maxlen=_KEPT)).append(estimate)
            by_tick.setdefault((estimate.device, estimate.tick), {})[estimate.pipeline] = estimate
            score = self._scores[estimate.pipeline]
            if estimate.innovation_m is not None:
                score.innovation.add(estimate.innovation_m)
            if estimate.gate is not None:
                score.surprise.add(estimate.gate)
        for estimates in by_tick.values():
            reference = estimates.get(self._baseline)
            for name, estimate in estimates.items():
                distance_m = _apart(estimate, reference)
                if name != self._baseline and distance_m is not None:
                    self._scores[name].apart.add(distance_m)

    def truth(self, truth: Truth) -> None:
        """Score what was said last by then; a waypoint counts when every pipeline has said something."""
        walk = self._walks.get(truth.device)
        if walk is None:
            return
        errors: dict[str, float] = {}
        for name in self._names:
            error_m = _error(walk.said.get(name, deque()), truth)
            if error_m is None:
                return
            errors[name] = error_m
        for name, error_m in errors.items():
            self._scores[name].error.add(error_m)
            walk.errors.setdefault(name, _Mean()).add(error_m)

    def finish(self, device: str) -> None:
        """A walk is over: it gives one difference for each challenger."""
        walk = self._walks.pop(device, None)
        reference = None if walk is None else walk.errors.get(self._baseline, _Mean()).value
        if walk is None or reference is None:
            return
        for name, mean in walk.errors.items():
            if name != self._baseline and mean.value is not None:
                self._scores[name].difference.add(mean.value - reference)

    def report(self) -> dict[str, Any]:
        """Return what is known so far, by pipeline; the interval is 95 %, whenever it is looked at."""
        return {
            name: {
                "against": "" if name == self._baseline else self._baseline,
                "error_m": score.error.value,
                "waypoints": score.error.count,
                "walks": score.difference.count,
                "difference_m": score.difference.mean if score.difference.count else None,
                "interval_m": None if score.difference.interval is None else list(score.difference.interval),
                "innovation_m": score.innovation.value,
                "normalised_innovation": score.surprise.value,
                "apart_m": score.apart.value,
            }
            for name, score in self._scores.items()
        }


def _apart(one: Saying, other: Saying | None) -> float | None:
    if other is None or one.xy is None or other.xy is None or one.floor != other.floor:
        return None
    return math.dist(one.xy, other.xy)


def _error(said: Sequence[Saying], truth: Truth) -> float | None:
    """Return the error of the newest estimate of a tick no later than the waypoint, in metres."""
    by_then = [(s.floor, s.xy) for s in said if s.t_ns <= truth.t_ns and s.xy is not None]
    if not by_then:
        return None
    floor, xy = by_then[-1]
    penalty_m = 0.0 if floor == truth.floor else WRONG_FLOOR_M
    return math.dist(xy, truth.xy.tolist()) + penalty_m
