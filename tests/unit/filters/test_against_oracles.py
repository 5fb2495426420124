"""Filters against what they must agree with where the truth is linear and Gaussian."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tickfix.api import TICK_NS, Belief, Context, Fix, Motion, Observation, Prior, displacement
from tickfix.toolkit.particles import systematic_resample
from tickfix_filters.fusion_pf import FusionPf
from tickfix_filters.kalman import Kalman

INDEPENDENT = {"error_correlation": 0.0, "student_t_dof": 1e12, "correlation_time_s": 1e-3}
"""Errors of fixes as textbooks have them: Gaussian, each for itself."""
EVERY = {
    "injection_rate": 0.0,
    "injection_rate_lost": 0.0,
    "reset_distance_m": 1e6,
    "initial_sigma_m": 1e6,
    "point_estimate": "mean",
}
"""Particles that never begin anew."""
FIRST = Fix(t_ns=0, floor="F", xy=np.array([1.0, -2.0]), covariance=9.0 * np.eye(2))
Tick = tuple[Motion, Fix | None]


def made(cls: type[Any], **params: Any) -> Any:
    """Build a filter with those of the parameters that it has."""
    known = {field.name for field in fields(cls.Params)}
    return cls(cls.Params(**{name: value for name, value in params.items() if name in known}), Context())


def linear_walk(seed: int, ticks: int) -> Iterator[Tick]:
    """Yield motion whose heading is known and whose only error is that of the distance, and fixes now and then."""
    rng = np.random.default_rng(seed)
    place = FIRST.xy + 3.0 * rng.normal(size=2)
    for k in range(1, ticks + 1):
        motion = Motion(
            t0_ns=(k - 1) * TICK_NS,
            t1_ns=k * TICK_NS,
            distance_m=float(rng.uniform(0.0, 0.4)),
            heading_rad=float(rng.uniform(-3.0, 3.0)),
            distance_sigma_m=0.15,
            distance_scale_sigma=0.0,
            heading_sigma_rad=0.0,
            heading_bias_sigma_rad=0.0,
            turn_bias_sigma_rad=0.0,
        )
        along = displacement(motion.distance_m + 0.15 * rng.normal(), motion.heading_rad or 0.0)
        place = place + along + 0.2 * np.sqrt(0.2) * rng.normal(size=2)
        fix = None
        if rng.random() < 0.3:
            sigma_m = float(rng.uniform(1.0, 4.0))
            xy = place + sigma_m * rng.normal(size=2)
            fix = Fix(t_ns=k * TICK_NS, floor="F", xy=xy, covariance=sigma_m**2 * np.eye(2))
        yield motion, fix


def beliefs(algorithm: Any, ticks: Iterator[Tick]) -> list[Belief]:
    """Fold a walk that begins at FIRST."""
    state = algorithm.start(Prior(t_ns=0, fix=FIRST), np.random.default_rng(1))
    said = []
    for n, (motion, fix) in enumerate(ticks):
        seen = [] if fix is None else [Observation(t_ns=fix.t_ns, source="test", fix=fix)]
        state, _ = algorithm.step(state, motion, seen, np.random.default_rng([2, n]))
        said.append(algorithm.estimate(state))
    return said


def least_squares(ticks: list[Tick], diffusion_m: float) -> tuple[Any, Any]:
    """Return mean and covariance of the last place by one weighted least-squares problem over all places."""
    n = len(ticks)
    rows, values, weights = [], [], []

    def add(row: Any, value: Any, covariance: Any) -> None:
        rows.append(row)
        values.append(value)
        weights.append(np.linalg.inv(covariance))

    def at(k: int) -> Any:
        block = np.zeros((2, 2 * (n + 1)))
        block[:, 2 * k : 2 * k + 2] = np.eye(2)
        return block

    add(at(0), FIRST.xy, FIRST.covariance)
    for k, (motion, fix) in enumerate(ticks, 1):
        u = displacement(1.0, motion.heading_rad or 0.0)
        q = motion.distance_sigma_m**2 * np.outer(u, u) + diffusion_m**2 * 0.2 * np.eye(2)
        add(at(k) - at(k - 1), motion.distance_m * u, q)
        if fix is not None:
            add(at(k), fix.xy, fix.covariance)
    information = sum(a.T @ w @ a for a, w in zip(rows, weights, strict=True))
    right = sum(a.T @ w @ v for a, w, v in zip(rows, weights, values, strict=True))
    covariance = np.linalg.inv(information)
    return (covariance @ right)[-2:], covariance[-2:, -2:]


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), ticks=st.integers(1, 25), diffusion_m=st.floats(0.02, 0.5))
def test_kalman_is_least_squares_over_the_whole_walk(seed: int, ticks: int, diffusion_m: float) -> None:
    walk = list(linear_walk(seed, ticks))
    belief = beliefs(made(Kalman, diffusion_m=diffusion_m, **INDEPENDENT), iter(walk))[-1]
    mean, covariance = least_squares(walk, diffusion_m)
    np.testing.assert_allclose(belief.xy, mean, atol=1e-6)
    np.testing.assert_allclose(belief.covariance, covariance, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_many_particles_agree_with_kalman_where_all_is_linear_and_gaussian(seed: int) -> None:
    walk = list(linear_walk(seed, 60))
    particles = beliefs(made(FusionPf, particles=20_000, diffusion_m=0.2, **EVERY, **INDEPENDENT), iter(walk))
    exact = beliefs(made(Kalman, diffusion_m=0.2, **INDEPENDENT), iter(walk))
    for one, other in zip(particles, exact, strict=True):
        spread = float(np.sqrt(np.trace(other.covariance)))
        assert np.hypot(*(one.xy - other.xy)) < 0.06 * spread
        np.testing.assert_allclose(one.covariance, other.covariance, atol=0.12 * np.trace(other.covariance))


def test_kalman_promises_what_it_keeps() -> None:
    rng = np.random.default_rng(4)
    squares = []
    for walk in range(150):
        xy, ticks = FIRST.xy + rng.normal(0.0, 3.0, 2), []
        for motion, _ in linear_walk(walk, 40):
            u = displacement(1.0, motion.heading_rad or 0.0)
            xy = xy + (motion.distance_m + 0.15 * rng.normal()) * u + 0.2 * np.sqrt(0.2) * rng.normal(size=2)
            seen = None
            if rng.random() < 0.2:
                seen = Fix(t_ns=motion.t1_ns, floor="F", xy=xy + rng.normal(0, 2.0, 2), covariance=4.0 * np.eye(2))
            ticks.append((motion, seen))
        belief = beliefs(made(Kalman, diffusion_m=0.2, **INDEPENDENT), iter(ticks))[-1]
        off = xy - belief.xy
        squares.append(off @ np.linalg.solve(belief.covariance, off))
    assert np.mean(squares) == pytest.approx(2.0, abs=4 * 2 / np.sqrt(150))  # χ² with two degrees of freedom


@settings(max_examples=30)
@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30).filter(lambda w: sum(w) > 1e-3))
def test_systematic_resampling_is_unbiased_and_off_by_less_than_one(raw: list[float]) -> None:
    weights = np.array(raw) / np.sum(raw)
    n, rng = len(weights), np.random.default_rng(0)
    counts = np.array([np.bincount(systematic_resample(weights, rng), minlength=n) for _ in range(400)])
    assert (np.abs(counts - n * weights) <= 1.0 + 1e-9).all()
    np.testing.assert_allclose(counts.mean(axis=0), n * weights, atol=5 * 0.5 / np.sqrt(400))
    assert not counts[:, weights == 0.0].any() or weights[-1] == 0.0
