"""Velocity and orientation by regression, against scipy and on held-out simulated walks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import lstsq

from tickfix.api import TICK_NS, Context, Motion, RadioMap, Survey, TrainedModel, wrap_rad
from tickfix.kernel.determinism import RandomStreams
from tickfix.simulation import SimulatedWalk, demo_building, simulate_survey
from tickfix.site.waypoints import to_survey_walk
from tickfix.toolkit import extreme_learning
from tickfix.toolkit.calibration import samples_between
from tickfix_pdr.elm import ElmParams, ElmPdr
from tickfix_pdr.elm_features import (
    SensorSums,
    assign_folds,
    heading_features,
    merge_sums,
    sum_samples,
    velocity_features,
)

Reckon = Callable[[Any, SimulatedWalk], list[Motion]]
PARAMS = ElmParams(velocity_nodes=(25, 50, 100), heading_nodes=(25, 50, 100))


@pytest.fixture(scope="module")
def surveyed() -> list[SimulatedWalk]:
    """One person's walks through the office; every fourth is held out."""
    return list(simulate_survey(demo_building(3), "F1", np.random.default_rng(1), length_m=45.0))


@pytest.fixture(scope="module")
def survey(surveyed: list[SimulatedWalk]) -> Survey:
    """Three quarters of them."""
    none, nowhere = np.zeros(0, np.int64), np.zeros((0, 2))
    radio = RadioMap(
        floors=("F1",), transmitters=(), point_floor=none, point_xy=nowhere, sample_point=none,
        sample_transmitter=none, sample_rssi_dbm=none, sample_xy=nowhere, sample_t_ns=none, sample_chain=none,
    )  # fmt: skip
    walks = tuple(to_survey_walk(walk.recording, walk.recording.name) for walk in surveyed[::2] + surveyed[1::4])
    return Survey(floors=(), radio_map=radio, walks=walks)


@pytest.fixture(scope="module")
def trained(survey: Survey) -> TrainedModel:
    """What the survey taught."""
    return ElmPdr.train(PARAMS, survey, np.random.default_rng(2))


@pytest.mark.parametrize("activation", ["sigmoid", "hardlim"])
def test_output_weights_solve_the_least_squares_that_scipy_solves(activation: str) -> None:
    rng = np.random.default_rng(4)
    x, t = rng.normal(size=(400, 6)), rng.normal(size=(400, 2))
    fold = np.arange(400) % 10
    chosen = extreme_learning.train_regression(x, t, fold, (20,), activation=activation, ridge=1e-12, rng=rng)
    beta = lstsq(extreme_learning.hidden_outputs(chosen.elm, x), t)[0]
    assert chosen.elm.beta == pytest.approx(beta, abs=1e-6)


def test_folds_by_subtraction_equal_training_without_the_fold() -> None:
    rng = np.random.default_rng(5)
    x, t, ridge = rng.normal(size=(300, 6)), rng.normal(size=(300, 1)), 1e-2
    fold = rng.integers(0, 5, 300)
    chosen = extreme_learning.train_regression(x, t, fold, (10, 30), activation="sigmoid", ridge=ridge, rng=rng)
    h = extreme_learning.hidden_outputs(chosen.elm, x)
    expected = np.zeros_like(t)
    for f in range(5):
        rest = fold != f
        # Ridge regression is least squares with rows √(ridge·n)·I for targets of 0.
        rows = np.vstack([h[rest], np.sqrt(ridge * rest.sum()) * np.eye(h.shape[1])])
        beta = lstsq(rows, np.vstack([t[rest], np.zeros((h.shape[1], 1))]))[0]
        expected[~rest] = h[~rest] @ beta
    assert chosen.held_out == pytest.approx(expected, abs=1e-8)
    assert chosen.mse.min() == pytest.approx(np.mean((expected - t) ** 2), abs=1e-10)


def test_folds_keep_a_chain_together_unless_told_otherwise() -> None:
    walk, chain = np.repeat(np.arange(12), 20), np.arange(12) // 2
    rng = np.random.default_rng(0)
    kept = assign_folds(walk, chain, 10, keep_chains=True, rng=rng)
    assert all(len(set(kept[chain[walk] == c])) == 1 for c in range(6))
    assert len(set(kept)) == 6
    assert len(set(assign_folds(walk, chain, 10, keep_chains=False, rng=rng)[:20])) > 3


def test_it_beats_a_constant_on_held_out_walks_of_the_surveyor(
    trained: TrainedModel, surveyed: list[SimulatedWalk], reckon: Reckon
) -> None:
    pdr = ElmPdr(PARAMS, Context(), trained)
    errors, constant, headings = [], [], []
    for walk in surveyed[3::4]:
        motions = reckon(pdr, walk)
        middle_s = (np.array([motion.t1_ns for motion in motions]) - walk.t_ns[0]) * 1e-9 - 0.1
        true = np.interp(middle_s, walk.trajectory.t_s, walk.trajectory.speed_mps)
        errors.append(np.array([motion.distance_m / 0.2 for motion in motions]) - true)
        constant.append(true)
        told = np.array([motion.heading_rad for motion in motions], dtype=np.float64)
        off = wrap_rad(told - walk.trajectory.heading_at(middle_s))[true > 0.3]
        headings.append(off[np.isfinite(off)])
    assert np.std(np.concatenate(constant)) > np.sqrt(np.mean(np.concatenate(errors) ** 2))
    assert np.sqrt(np.mean(np.concatenate(headings) ** 2)) < np.radians(45.0), "104° is no better than a constant"


def test_a_window_of_several_ticks_is_felt_as_one(survey: Survey) -> None:
    motion = survey.walks[0].motion
    starts = motion.t0_ns + TICK_NS * np.arange(40)
    ticks = [sum_samples(samples_between(motion, t, t + TICK_NS)) for t in starts.tolist()]
    for k in range(36):
        once = sum_samples(samples_between(motion, int(starts[k]), int(starts[k]) + 5 * TICK_NS))
        turned = SensorSums(ticks[k + 1].sums * np.repeat([1.0, -1.0], [9, 4]), ticks[k + 1].counts)  # −q is q
        several = merge_sums([ticks[k], turned, *ticks[k + 2 : k + 5]])
        assert velocity_features(several) == pytest.approx(velocity_features(once))
        assert heading_features(several, as_vector=True) == pytest.approx(heading_features(once, as_vector=True))


def test_it_regresses_windows_of_the_length_it_was_trained_with(
    survey: Survey, surveyed: list[SimulatedWalk], reckon: Reckon
) -> None:
    params = ElmParams(window_ms=600, velocity_nodes=(50,), heading_nodes=(50,), stationary_threshold_mps2=0.0)
    pdr = ElmPdr(params, Context(), ElmPdr.train(params, survey, np.random.default_rng(2)))
    motions = reckon(pdr, surveyed[3])
    samples = to_survey_walk(surveyed[3].recording, "w").motion
    for motion in motions[20:60]:
        x = velocity_features(sum_samples(samples_between(samples, motion.t1_ns - 3 * TICK_NS, motion.t1_ns)))
        assert x is not None
        expected = np.clip(pdr._velocity(x[None])[0, 0], 0.0, 3.0) * 0.2
        assert motion.distance_m == pytest.approx(expected, abs=1e-9)


def test_a_window_of_broken_ticks_is_refused() -> None:
    with pytest.raises(ValueError, match="found 500, expected a multiple of 200"):
        ElmParams(window_ms=500)


def test_the_same_stream_trains_the_same_model(survey: Survey, trained: TrainedModel) -> None:
    again = ElmPdr.train(PARAMS, survey, np.random.default_rng(2))
    assert {name: value.tobytes() for name, value in again.items()} == {
        name: value.tobytes() for name, value in trained.items()
    }


def test_it_can_be_trained_with_the_stream_of_a_survey(survey: Survey) -> None:
    # The kernel's counter-based generators cannot spawn others.
    ElmPdr.train(replace(PARAMS, heading_nodes=(25,)), survey, RandomStreams(0, "survey").at(0, 0, "pdr-elm"))


def test_without_a_model_it_says_to_survey_again() -> None:
    with pytest.raises(ValueError, match="survey again with this configuration"):
        ElmPdr(ElmParams(), Context(), None)


def test_a_survey_without_walks_is_refused_with_what_is_needed(survey: Survey) -> None:
    empty = Survey(floors=(), radio_map=survey.radio_map, walks=())
    with pytest.raises(ValueError, match="found 0 windows"):
        ElmPdr.train(ElmParams(), empty, np.random.default_rng(0))
