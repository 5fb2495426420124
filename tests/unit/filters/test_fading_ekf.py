"""The fading-factor filter against a plain Kalman filter, its factor by hand, and gross errors as in the paper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from walks import errors, fixes, fold, walk

from tickfix.api import TICK_NS, Context, Fix, Motion
from tickfix_filters.fading_ekf import FadingEkf, FadingEkfParams, accumulate_motion, correct_by_fix, initial_state

GROSS = {200: (10.0, 0.0), 300: (10.0, 0.0), 400: (0.0, 10.0)}  # [wang2015] table 5: at 40, 60 and 80 s


def turning(t_s: float) -> float:
    return 0.5 * np.pi * (int(t_s / 15.0) % 4)


def ekf(**params: object) -> FadingEkf:
    return FadingEkf(FadingEkfParams(**params), Context())  # type: ignore[arg-type]


@pytest.mark.parametrize("every", [5, 10])
def test_without_fading_and_heading_it_is_a_plain_kalman_filter(every: int) -> None:
    rng = np.random.default_rng(1)
    motions, places = walk(40.0, lambda t: 0.7)
    seen = fixes(places, rng, 2.0, every)
    plain = ekf(fading="off", min_heading_speed_mps=100.0)  # always slower than that: no heading row
    folded = fold(plain, motions, seen, rng)
    t, p = 0.2 * every, plain.params
    A = np.eye(4) + t * np.eye(4, k=2)
    G = np.vstack([0.5 * t**2 * np.eye(2), t * np.eye(2)])
    H = np.diag([1.0, 1.0, t, t])
    R = np.diag([4.0, 4.0, *[0.5 * t * p.odometry_sigma_m**2] * 2])
    x, P = np.array([*seen[0].xy, 0.0, 0.0]), np.diag([4.0, 4.0, 1.0, 1.0])
    for k in sorted(seen)[1:]:
        x, P = A @ x, A @ P @ A.T + p.acceleration_mps2**2 * G @ G.T
        z = np.array([*seen[k].xy, *(places[k] - places[k - every])])
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x, P = x + K @ (z - H @ x), (np.eye(4) - K @ H) @ P
        state = folded[k][0].ekf
        assert state.X[[1, 0, 3, 2]] == pytest.approx(x, abs=1e-9)
        assert state.P[[1, 0, 3, 2]][:, [1, 0, 3, 2]] == pytest.approx(P, abs=1e-9)


def test_lambda_is_the_ratio_of_the_traces_of_the_place() -> None:
    params = FadingEkfParams(delta_s_m=100.0)
    state = initial_state(np.zeros(2), np.eye(2), params)
    north = Motion(t0_ns=0, t1_ns=10 * TICK_NS, distance_m=0.0, heading_rad=0.0)
    after, _ = correct_by_fix(accumulate_motion(state, north), np.array([6.0, 8.0]), np.eye(2), params)
    # P = I, v = 0 with σ 1 m/s, t = 2 s: M = (1 + 4)·I, H Q Hᵀ = 0.25·4·I, R = I, Σ_V̄ = v vᵀ.
    assert after.lam == pytest.approx((100.0 - 2.0 - 2.0) / 10.0)


def test_lambda_by_the_pseudo_inverse_divides_by_the_rank() -> None:
    params = FadingEkfParams(delta_s_m=100.0, fading="pinv")
    state = initial_state(np.zeros(2), np.eye(2), params)
    north = Motion(t0_ns=0, t1_ns=10 * TICK_NS, distance_m=0.0, heading_rad=0.0)
    after, _ = correct_by_fix(accumulate_motion(state, north), np.array([6.0, 8.0]), np.eye(2), params)
    t = 2.0
    H = np.vstack([np.eye(4)[[0, 1]], t * np.eye(4)[[3, 2]]])
    A = np.eye(4) + t * np.eye(4, k=2)
    G = np.vstack([0.5 * t**2 * np.eye(2), t * np.eye(2)])
    v = np.array([8.0, 6.0, 0.0, 0.0])
    N = np.outer(v, v) - H @ (0.25 * G @ G.T) @ H.T - np.diag([1.0, 1.0, 0.25, 0.25])
    M = H @ A @ A.T @ H.T
    assert np.linalg.matrix_rank(M) == 4
    assert after.lam == pytest.approx(np.trace(N @ np.linalg.inv(M)) / 4)


def test_lambda_stays_one_while_residuals_are_as_expected_and_when_the_test_fails() -> None:
    params = FadingEkfParams()
    state = initial_state(np.zeros(2), np.eye(2), params)
    moved = accumulate_motion(state, Motion(t0_ns=0, t1_ns=10 * TICK_NS, distance_m=1.0, heading_rad=0.0))
    assert correct_by_fix(moved, np.array([0.0, 1.0]), np.eye(2), params)[0].lam == 1.0
    bad, outcome = correct_by_fix(moved, np.array([0.0, 30.0]), np.eye(2), params)
    assert outcome.go_and_back
    assert outcome.used
    assert bad.lam == 1.0


def test_the_heading_row_wraps_and_is_left_out_near_standstill() -> None:
    params = FadingEkfParams(fading="off")
    state = replace(initial_state(np.zeros(2), np.eye(2), params), X=np.array([0.0, 0.0, -1.0, 0.01]))
    south = Motion(t0_ns=0, t1_ns=5 * TICK_NS, distance_m=1.0, heading_rad=-np.pi + 0.01)
    after, _ = correct_by_fix(accumulate_motion(state, south), np.array([0.0, -1.0]), np.eye(2), params)
    assert after.X[2:] == pytest.approx([-1.0, 0.0], abs=0.03)
    still = replace(state, X=np.array([0.0, 0.0, 0.01, 0.0]))
    east = Motion(t0_ns=0, t1_ns=5 * TICK_NS, distance_m=0.0, heading_rad=1.5)
    rested, _ = correct_by_fix(accumulate_motion(still, east), np.zeros(2), np.eye(2), params)
    assert abs(rested.X[3]) < 1e-12


def gross_errors(seed: int, **params: object) -> np.ndarray:
    """Return the errors (3,) at the three fixes that are 10 m off, metres."""
    rng = np.random.default_rng(seed)
    motions, places = walk(100.0, turning)
    wpo = ekf(**params)
    return errors(wpo, fold(wpo, motions, fixes(places, rng, gross=GROSS), rng), places)[list(GROSS)]


def test_three_gross_errors_hurt_as_in_table_6_and_not_when_such_fixes_are_dropped() -> None:
    kept = np.mean([gross_errors(seed) for seed in range(10)])
    rejected_fixes = np.mean([gross_errors(seed, reject_go_and_back=True) for seed in range(10)])
    assert 2.0 < kept < 6.0  # the paper's WPO: 3.1 to 4.8 m
    assert rejected_fixes < 1.5


def test_a_bad_fix_and_the_one_after_it_fail_the_test_and_no_other() -> None:
    motions, places = walk(60.0, turning)
    seen = fixes(places, np.random.default_rng(0), 0.3, gross={200: (10.0, 0.0)})
    wpo = ekf(reject_go_and_back=True)
    folded = fold(wpo, motions, seen, np.random.default_rng(0))
    assert [k for k, (_, report) in enumerate(folded) if report.reasons] == [200, 210]
    assert [k for k, (_, report) in enumerate(folded) if report.gated] == [200, 210]


def test_fixes_that_always_fail_the_test_do_not_lock_the_filter_out() -> None:
    motions, places = walk(60.0, turning)
    seen = fixes(places, np.random.default_rng(0), 8.0)
    wpo = ekf(reject_go_and_back=True, max_rejected_fixes=3)
    used = [
        report.used for k, (_, report) in enumerate(fold(wpo, motions, seen, np.random.default_rng(0))) if k in seen
    ]
    assert sum(used) >= len(seen) // 4 - 1


def test_between_fixes_the_place_is_dead_reckoned() -> None:
    motions, places = walk(3.0, turning)
    wpo = ekf()
    first = Fix(t_ns=0, floor="F", xy=[0.0, 0.0], covariance=np.eye(2))
    folded = fold(wpo, motions, {0: first}, np.random.default_rng(0))
    assert errors(wpo, folded, places).max() < 1e-9
    traces = [np.trace(wpo.estimate(state).covariance) for state, _ in folded]
    assert (np.diff(traces) > 0).all()


def test_without_a_compass_it_follows_the_fixes_alone() -> None:
    rng = np.random.default_rng(0)
    motions, places = walk(60.0, lambda t: 0.7)
    blind = [replace(m, heading_rad=None) for m in motions]
    wpo = ekf()
    assert errors(wpo, fold(wpo, blind, fixes(places, rng), rng), places)[50:].mean() < 1.5
