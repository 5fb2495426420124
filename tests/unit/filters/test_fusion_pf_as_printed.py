"""``fusion-pf`` with the preset jiang2015 against the Kalman filter, which is exact here, and as section 7 tells it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from walks import walk

from tickfix.api import TICK_NS, Context, Fix, Motion, Observation, Prior
from tickfix.testing import FilterContract
from tickfix_filters.fusion_model import FusionPfParams
from tickfix_filters.fusion_pf import FusionPf

FIRST = Fix(t_ns=0, floor="F", xy=[1.0, -2.0], covariance=0.6 * np.eye(2))


class TestAsPrinted(FilterContract):
    """The kit, on the preset as well."""

    algorithm = FusionPf
    params = FusionPf.presets["jiang2015"].values


def seen(k: int, xy: np.ndarray) -> Observation:
    return Observation(t_ns=k * TICK_NS, source="test", fix=Fix(t_ns=k * TICK_NS, floor="F", xy=xy))


def printed(particles: int) -> FusionPf:
    return FusionPf(FusionPfParams(**FusionPf.presets["jiang2015"].values | {"particles": particles}), Context())


def begun(pf: FusionPf, rng: np.random.Generator) -> object:
    return pf.start(Prior(t_ns=0, fix=FIRST), rng)


@pytest.mark.parametrize("every", [1, 5, 1000])
def test_many_particles_are_the_kalman_filter(every: int) -> None:
    rng = np.random.default_rng(every)
    pf = printed(40_000)
    motions, places = walk(6.0, lambda t: 0.3 * t)
    state = begun(pf, rng)
    m, P = np.array(FIRST.xy), np.array(FIRST.covariance)
    for k, motion in enumerate(motions, 1):
        z = places[k] + FIRST.xy + rng.normal(0, 0.3, 2)
        state, report = pf.step(state, motion, [seen(k, z)] if k % every == 0 else [], rng)
        m, P = m + places[k] - places[k - 1], P + 0.1 * np.eye(2)
        K = P @ np.linalg.inv(P + 0.25 * np.eye(2))
        m, P = m + K @ ((z if k % every == 0 else m) - m), (np.eye(2) - K) @ P
        assert state.xy.mean(axis=0) == pytest.approx(m, abs=0.04)
        assert np.cov(state.xy.T) == pytest.approx(P, abs=0.02)
        assert report.used == (k % every == 0)


def test_without_fixes_the_place_is_the_motion_result() -> None:
    rng = np.random.default_rng(0)
    pf = printed(5000)
    motions, places = walk(20.0, lambda t: 0.1 * t)
    state = begun(pf, rng)
    traces = []
    for motion in motions:
        state, _ = pf.step(state, motion, [], rng)
        traces.append(np.trace(pf.estimate(state).covariance))
    assert np.hypot(*(pf.estimate(state).xy - FIRST.xy - places[-1])) < 0.4
    assert traces[-1] > traces[20] > traces[5]  # 20 s without a fix are not told as sure


def test_with_a_fix_the_motion_result_is_not_used() -> None:
    pf = printed(40_000)
    rng = np.random.default_rng(0)
    state = begun(pf, rng)
    still = Motion(t0_ns=0, t1_ns=TICK_NS, heading_rad=0.0)
    after, report = pf.step(state, still, [seen(1, np.array([2.0, -2.0]))], rng)
    K = (FIRST.covariance + 0.1 * np.eye(2)) @ np.linalg.inv(FIRST.covariance + 0.35 * np.eye(2))
    assert pf.estimate(after).xy == pytest.approx(FIRST.xy + K @ [1.0, 0.0], abs=0.03)
    assert report.innovation_m == pytest.approx(1.0, abs=0.02)


def test_a_fix_far_away_leaves_finite_weights_and_draws_the_particles_towards_it() -> None:
    pf = printed(100)
    rng = np.random.default_rng(0)
    state = begun(pf, rng)
    still = Motion(t0_ns=0, t1_ns=TICK_NS, heading_rad=0.0)
    for k in range(1, 200):
        state, _ = pf.step(
            state, replace(still, t0_ns=(k - 1) * TICK_NS, t1_ns=k * TICK_NS), [seen(k, [80.0, 0.0])], rng
        )
    assert np.hypot(*(pf.estimate(state).xy - [80.0, 0.0])) < 2.0


def test_motion_can_weigh_only_if_it_is_said_how_sharply() -> None:
    with pytest.raises(ValueError, match="fix_sigma_m: found 0"):
        FusionPfParams(weight_without_fix="motion")
