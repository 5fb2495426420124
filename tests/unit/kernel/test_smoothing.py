"""A filter that smooths: a Rauch-Tung-Striebel smoother in the kernel against batch least squares."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from lab import Folded, delayed, fold
from streams import published, settled

from tickfix.api import TICK_NS, Belief, Estimate, Fix, Motion, Observation, PluginError, Prior, Report, Rng
from tickfix.api.arrays import Floats
from tickfix.kernel import Kernel, KernelSettings, Pipeline, Stage

FIRST_TICK, TICKS = 5_000, 60
HORIZON_S = 2.0
SETTINGS = KernelSettings(horizon_s=HORIZON_S, strict=True)
DT_S = 1e-9 * TICK_NS
F = np.array([[1.0, DT_S], [0.0, 1.0]])
Q = 0.5 * np.array([[DT_S**3 / 3, DT_S**2 / 2], [DT_S**2 / 2, DT_S]])
R = 4.0
START = np.diag([R, 2.0])
"""Covariance of position (m) and velocity (m/s) along one axis after the first fix."""


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Mean (2, 2) of position and velocity (rows) along x and y (columns), covariance (2, 2) of either axis."""

    mean: Floats
    covariance: Floats
    predicted_mean: Floats
    predicted_covariance: Floats


class ConstantVelocity:
    """A Kalman filter of a point with nearly constant velocity; fixes have a standard deviation of 2 m."""

    State = Moments

    def __init__(self, lag_s: Any, fails_at: int | None = None) -> None:
        self.lag_s = lag_s
        self._fails_at = fails_at

    def start(self, prior: Prior, rng: Rng) -> Moments | None:
        if prior.fix is None:
            return None
        mean = np.stack([prior.fix.xy, np.zeros(2)])
        return Moments(mean, START, mean, START)

    def step(
        self, state: Moments, motion: Motion, observations: Sequence[Observation], rng: Rng
    ) -> tuple[Moments, Report]:
        if self._fails_at is not None and motion.t1_ns == self._fails_at * TICK_NS:
            raise ArithmeticError("on purpose")
        predicted, p = F @ state.mean, F @ state.covariance @ F.T + Q
        mean, covariance = predicted, p
        for observation in observations:
            assert observation.fix is not None
            gain = covariance[:, :1] / (covariance[0, 0] + R)
            mean = mean + gain * (observation.fix.xy - mean[0])
            covariance = covariance - gain @ covariance[:1]
        return Moments(mean, covariance, predicted, p), Report(used=len(observations))

    def estimate(self, state: Moments) -> Belief:
        return self._belief(state.mean, state.covariance)

    def smooth(self, states: Sequence[Moments]) -> Belief:
        mean, covariance = states[-1].mean, states[-1].covariance
        for here, after in reversed(list(pairwise(states))):
            gain = here.covariance @ F.T @ np.linalg.inv(after.predicted_covariance)
            mean = here.mean + gain @ (mean - after.predicted_mean)
            covariance = here.covariance + gain @ (covariance - after.predicted_covariance) @ gain.T
        return self._belief(mean, covariance)

    @staticmethod
    def _belief(mean: Floats, covariance: Floats) -> Belief:
        return Belief(floor="F", xy=mean[0], covariance=covariance[0, 0] * np.eye(2))


def pipeline(lag_s: Any, fails_at: int | None = None, name: str = "toy") -> Pipeline:
    return Pipeline(name, Stage("filter", "cv", f"cv {lag_s} {fails_at}", ConstantVelocity(lag_s, fails_at)))


def walk() -> list[Fix]:
    """Return a fix in every second tick or so of a walk around a curve."""
    rng = np.random.default_rng(7)
    fixes = []
    for k in range(TICKS):
        if k % 2 == 0 or k == TICKS - 1:
            xy = np.array([k * 0.2, 3 * math.sin(k / 15)]) + 2.0 * rng.standard_normal(2)
            fixes.append(Fix(t_ns=(FIRST_TICK + k) * TICK_NS - 1_000, floor="F", xy=xy, device="d"))
    return fixes


def least_squares(fixes: Sequence[Fix], last: int) -> tuple[Floats, Floats]:
    """Return positions (n, 2) and variances (n,) of the ticks up to ``last`` given all fixes up to it."""
    n = last - FIRST_TICK + 1
    information, vector = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2))
    information[:2, :2] += np.linalg.inv(START)
    vector[:2] += np.linalg.inv(START) @ np.stack([fixes[0].xy, np.zeros(2)])
    for k in range(n - 1):
        change = np.hstack([-F, np.eye(2)])
        information[2 * k : 2 * k + 4, 2 * k : 2 * k + 4] += change.T @ np.linalg.inv(Q) @ change
    for fix in fixes[1:]:
        k = -(-fix.t_ns // TICK_NS) - FIRST_TICK
        if k < n:
            information[2 * k, 2 * k] += 1 / R
            vector[2 * k] += fix.xy / R
    return np.linalg.solve(information, vector)[::2], np.diag(np.linalg.inv(information))[::2]


def assert_close(estimate: Estimate, position: Floats, variance: float) -> None:
    assert estimate.belief is not None
    np.testing.assert_allclose(estimate.belief.xy, position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.diag(estimate.belief.covariance), variance, rtol=0, atol=1e-9)


def smoothed(folded: Folded) -> list[Estimate]:
    return folded.smoothed.get(("d", "toy"), [])


@pytest.mark.parametrize("lag_s", [0.0, 1.0, 60.0])
def test_smoothed_beliefs_are_those_of_least_squares_over_the_lag(lag_s: float) -> None:
    fixes = walk()
    track = settled(fold([pipeline(lag_s)], fixes, SETTINGS))
    last = FIRST_TICK + TICKS - 1
    assert [e.tick for e in track] == list(range(FIRST_TICK, last + 1))
    for estimate in track:
        positions, variances = least_squares(fixes, min(estimate.tick + round(lag_s / DT_S), last))
        n = estimate.tick - FIRST_TICK
        assert_close(estimate, positions[n], variances[n])


def test_every_tick_is_smoothed_by_one_last_revision_and_published_as_before() -> None:
    fixes = delayed(walk(), seed=1)
    folded, plain = (fold([pipeline(1.0)], fixes, SETTINGS), fold([unsmoothed()], fixes, SETTINGS))
    assert [e.tick for e in smoothed(folded)] == [e.tick for e in settled(folded)]
    newest = {e.tick: e.revision for e in (*published(folded), *folded.revised[("d", "toy")])}
    assert max(newest.values()) > 0
    assert [e.revision for e in smoothed(folded)] == [newest[e.tick] + 1 for e in smoothed(folded)]
    assert folded.said("d", "toy") == plain.said("d", "toy")
    assert smoothed(plain) == []


def unsmoothed() -> Pipeline:
    """Return the same filter without the ability."""
    filtering = type("Filtering", (), {m: getattr(ConstantVelocity, m) for m in ("start", "step", "_belief")})
    algorithm: Any = filtering()
    algorithm.State, algorithm._fails_at = Moments, None
    algorithm.estimate = lambda state: ConstantVelocity._belief(state.mean, state.covariance)
    return Pipeline("toy", Stage("filter", "cv", "cv", algorithm))


def test_neither_order_nor_restarts_nor_thin_checkpoints_nor_company_change_the_smoothed_track() -> None:
    fixes = walk()
    in_order = fold([pipeline(1.0)], fixes, SETTINGS)
    expected = in_order.settled_as("d", "toy")
    for seed in range(5):
        late = delayed(fixes, seed)
        thin = KernelSettings(horizon_s=HORIZON_S, strict=True, checkpoint_mb=1e-6, repack=True)
        kept = fold([pipeline(1.0)], late, thin, restarts=range(3, len(late), 4))
        assert kept.settled_as("d", "toy") == expected
        assert [e.tick for e in smoothed(kept)] == [e.tick for e in smoothed(in_order)]
        company = [pipeline(1.0), pipeline(3.0, name="longer")]
        assert fold(company, late, SETTINGS).settled_as("d", "toy") == expected


def test_smoothing_does_not_look_past_a_tick_at_which_the_filter_failed() -> None:
    fixes, failed = walk(), FIRST_TICK + 31
    folded = fold([pipeline(60.0, failed)], fixes, KernelSettings(horizon_s=HORIZON_S))
    positions, variances = least_squares(fixes, failed - 1)
    for estimate in settled(folded)[: failed - FIRST_TICK]:
        n = estimate.tick - FIRST_TICK
        assert_close(estimate, positions[n], variances[n])
    assert failed not in [e.tick for e in smoothed(folded)]
    assert len(smoothed(folded)) == TICKS - 1


@pytest.mark.parametrize("lag_s", [None, -1.0, math.nan, 61.0, "1 s", True])
def test_a_lag_out_of_range_is_refused_with_the_range(lag_s: Any) -> None:
    with pytest.raises(PluginError, match="from 0 to 60"):
        Kernel([pipeline(lag_s)], SETTINGS)
