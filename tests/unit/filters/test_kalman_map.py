"""The Kalman/map filter against least squares over all fixes at once, and with a map in its loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tickfix.api import TICK_NS, Bools, Context, Fix, Floats, Motion, Observation, Report
from tickfix_filters.kalman_map import KalmanMap, KalmanMapParams, KalmanMapState

RNG = np.random.default_rng(0)


class Corridor:
    """A map with one walkway, y = 0, to which everything is corrected that left |y| ≤ 1 m."""

    def contains(self, xy: Floats) -> Bools:
        return np.abs(xy[:, 1]) <= 1.0

    def crosses(self, a: Floats, b: Floats) -> Bools:
        return ~(self.contains(a) & self.contains(b))

    def nearest_free(self, xy: Floats) -> Floats:
        return np.column_stack([xy[:, 0], np.clip(xy[:, 1], -1.0, 1.0)])

    def snap(self, previous: Floats | None, xy: Floats) -> Floats:
        return xy if abs(xy[1]) <= 1.0 else np.array([xy[0] if previous is None else 0.5 * (xy + previous)[0], 0.0])


def fix(t_s: float, x: float, y: float, floor: str = "F") -> Fix:
    return Fix(t_ns=round(t_s * 1e9), floor=floor, xy=[x, y], covariance=[[4.0, 1.0], [1.0, 3.0]])


def run(kmf: KalmanMap, fixes: list[Fix]) -> tuple[KalmanMapState, list[Report]]:
    """Fold fixes tick by tick until the last of them."""
    state, reports = kmf.begin(fixes[0], RNG), []
    waiting = fixes[1:]
    tick = fixes[0].t_ns // TICK_NS
    while waiting:
        tick += 1
        due = [f for f in waiting if f.t_ns <= tick * TICK_NS]
        waiting = waiting[len(due) :]
        motion = Motion.unknown((tick - 1) * TICK_NS, tick * TICK_NS)
        seen = [Observation(t_ns=f.t_ns, source="test", fix=f) for f in due]
        state, report = kmf.step(state, motion, seen, RNG)
        reports.append(report)
    return state, reports


def least_squares(fixes: list[Fix], a: float, v0: float) -> tuple[Floats, Floats]:
    """Return the last X and its covariance that explain all fixes best: first state and accelerations unknown."""
    n = len(fixes)
    steps = np.diff([f.t_ns for f in fixes]) * 1e-9
    unknowns = 4 + 2 * (n - 1)
    X = np.eye(4, unknowns)  # the state as a linear function of all unknowns
    rows, values = [], []

    def ask(row: Floats, value: Floats, covariance: Floats) -> None:
        white = np.linalg.inv(np.linalg.cholesky(covariance))
        rows.append(white @ row)
        values.append(white @ value)

    ask(X[2:], np.zeros(2), v0**2 * np.eye(2))
    ask(X[:2], fixes[0].xy, fixes[0].covariance)
    for k, (dt, f) in enumerate(zip(steps, fixes[1:], strict=True)):
        A = np.eye(4) + dt * np.eye(4, k=2)
        X = A @ X
        acceleration = np.zeros((2, unknowns))
        acceleration[[0, 1], [4 + 2 * k, 5 + 2 * k]] = 1.0
        X = X + np.vstack([0.5 * dt**2 * np.eye(2), dt * np.eye(2)]) @ acceleration
        ask(acceleration, np.zeros(2), a**2 * np.eye(2))
        ask(X[:2], f.xy, f.covariance)
    J = np.vstack(rows)
    solution = np.linalg.lstsq(J, np.concatenate(values), rcond=None)[0]
    return X @ solution, X @ np.linalg.inv(J.T @ J) @ X.T


@pytest.mark.parametrize("seed", range(5))
def test_without_a_map_it_is_the_least_squares_solution_over_all_fixes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.3, 4.0, 12))
    fixes = [fix(s, *rng.normal([0.8 * s, 0.3 * s], 2.0)) for s in t]
    kmf = KalmanMap(KalmanMapParams(acceleration_mps2=0.3), Context())
    state, _ = run(kmf, fixes)
    X, P = least_squares(fixes, 0.3, 1.0)
    assert state.x == pytest.approx(X, abs=1e-8)
    assert state.p == pytest.approx(P, abs=1e-8)


def test_the_preset_has_the_printed_numbers() -> None:
    values = KalmanMap.presets["sun2013"].values
    kmf = KalmanMap(KalmanMapParams(**values), Context())
    state = kmf.begin(fix(0, 0, 0), RNG)
    assert state.p[:2, :2].tolist() == [[6.0, 0.0], [0.0, 6.0]]
    assert values["acceleration_mps2"] == 0.05


def test_the_prediction_is_corrected_by_the_map_before_the_fix_corrects_it() -> None:
    params = KalmanMapParams(fix_variance_m2=6.0, acceleration_mps2=0.05)
    begun = KalmanMap(params, Context()).begin(fix(0, 0, 0), RNG)
    heading_out = replace(begun, x=np.array([0.0, 0.5, 0.0, 1.0]))
    plain, mapped = (KalmanMap(params, Context(maps=maps)) for maps in ({}, {"F": Corridor()}))
    free, _ = plain.update(heading_out, fix(2, 1, 0), RNG)
    held, report = mapped.update(heading_out, fix(2, 1, 0), RNG)
    S = begun.p[0, 0] + 4.0 * begun.p[2, 2] + 0.25 * 0.05**2 * 16.0
    K = S / (S + 6.0)
    assert free.x[1] == pytest.approx(2.5 + K * (0.0 - 2.5))
    assert held.x[1] == pytest.approx(0.0)  # eq. (15): U' = 0 and the fix says so too
    assert held.x[3] == pytest.approx(1.0)  # eq. (14): V is kept, and there was no innovation along y
    assert held.p == pytest.approx(free.p)
    assert report.innovation_m == pytest.approx(1.0)


def test_between_fixes_it_tells_the_prediction_and_keeps_the_state() -> None:
    kmf = KalmanMap(KalmanMapParams(), Context())
    state, _ = run(kmf, [fix(0, 0, 0), fix(2, 2, 0), fix(4, 4, 0)])
    later = kmf.predict(state, Motion.unknown(state.now_ns, state.now_ns + 3_000_000_000), RNG)
    now, then = kmf.estimate(state), kmf.estimate(later)
    assert then.xy == pytest.approx(now.xy + 3.0 * state.x[2:])
    assert np.trace(then.covariance) > np.trace(now.covariance)
    assert later.x is state.x


def test_it_does_not_walk_on_for_ever_when_fixes_end() -> None:
    kmf = KalmanMap(KalmanMapParams(max_extrapolation_s=5.0), Context())
    state, _ = run(kmf, [fix(0, 0, 0), fix(2, 2, 0), fix(4, 4, 0)])
    later = kmf.predict(state, Motion.unknown(state.now_ns, state.now_ns + 60_000_000_000), RNG)
    assert kmf.estimate(later).xy == pytest.approx(state.x[:2] + 5.0 * state.x[2:])


def test_two_fixes_of_one_instant_and_one_that_is_older_are_folded_without_time_between_them() -> None:
    kmf = KalmanMap(KalmanMapParams(), Context())
    state = kmf.begin(fix(2, 0, 0), RNG)
    once, _ = kmf.update(state, fix(2, 1, 1), RNG)
    twice, _ = kmf.update(once, fix(1, 1, 1), RNG)
    assert np.trace(twice.p) < np.trace(once.p) < np.trace(state.p)
    assert twice.last_fix_ns == state.last_fix_ns


def test_it_follows_to_another_floor_once_several_fixes_say_so() -> None:
    kmf = KalmanMap(KalmanMapParams(), Context())
    state, reports = run(kmf, [fix(0, 0, 0), *(fix(s, 9, 9, "G") for s in (1, 2, 3))])
    assert state.hysteresis.floor == "G"
    assert state.x[:2].tolist() == [9.0, 9.0]
    assert [r.gated for r in reports if r.used or r.gated] == [1, 1, 0]
