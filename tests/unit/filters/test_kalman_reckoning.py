"""The Kalman filter behind dead reckoning against least squares over all places at once."""

from __future__ import annotations

import numpy as np
import pytest
from walks import errors, fixes, fold, walk

from tickfix.api import Context, Floats
from tickfix_filters.kalman_reckoning import KalmanReckoning, KalmanReckoningParams

PARAMS = KalmanReckoningParams(acceleration_mps2=0.7, position_sigma_m=0.4, speed_sigma_mps=0.9)


def least_squares(places: Floats, p: KalmanReckoningParams) -> Floats:
    """Return the last X (4,): the first state and the accelerations of every tick are unknown."""
    n, T = len(places) - 1, 0.2
    A, G = np.eye(4), np.zeros((4, 2))
    A[[0, 1], [2, 3]] = T
    G[[0, 1, 2, 3], [0, 1, 0, 1]] = [T**2 / 2, T**2 / 2, T, T]
    X = np.eye(4, 4 + 2 * n)
    first = [p.position_sigma_m] * 2 + [p.speed_sigma_mps] * 2
    rows, values = [X / np.array(first)[:, None]], [np.array([*places[0], 0.0, 0.0]) / first]
    for k in range(n):
        a = np.zeros((2, 4 + 2 * n))
        a[:, 4 + 2 * k : 6 + 2 * k] = np.eye(2)
        X = A @ X + G @ a
        rows += [a / p.acceleration_mps2, X[:2] / p.position_sigma_m]
        values += [np.zeros(2), places[k + 1] / p.position_sigma_m]
    unknown: Floats = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values))[0]
    return X @ unknown


def test_it_is_the_least_squares_solution_of_all_reckoned_places() -> None:
    motions, places = walk(8.0, lambda t: np.sin(t) + 0.3 * t)
    seen = fixes(places, np.random.default_rng(0), sigma_m=0.5, every=1000)
    state, _ = fold(KalmanReckoning(PARAMS, Context()), motions, seen, np.random.default_rng(1))[-1]
    assert state.x == pytest.approx(least_squares(places + seen[0].xy, PARAMS), abs=1e-8)


def test_it_smooths_and_later_fixes_change_nothing() -> None:
    rng = np.random.default_rng(2)
    headings = 0.4 * rng.standard_normal(1000)
    motions, places = walk(60.0, lambda t: float(headings[round(5 * t)]))
    kf = KalmanReckoning(KalmanReckoningParams(), Context())
    seen = fixes(places, rng, sigma_m=0.1, every=1000)
    folded = fold(kf, motions, seen, rng)
    told = np.array([kf.estimate(state).xy for state, _ in folded])
    bends, true_bends = (np.hypot(*np.diff(way, 2, axis=0).T).mean() for way in (told, places))
    assert bends < 0.3 * true_bends
    assert errors(kf, folded, places).max() < 0.6
    more = fixes(places, rng, every=20) | seen
    assert np.array_equal(fold(kf, motions, more, rng)[-1][0].x, folded[-1][0].x)
