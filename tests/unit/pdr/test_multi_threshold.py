"""The multi-threshold steps, lengths and headings of [wang2015] by hand-computed cases and against simulated truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tickfix.api import TICK_NS, Context, Motion, MotionSamples, Samples, wrap_rad
from tickfix.simulation import SimulatedWalk
from tickfix.toolkit.calibration import samples_between
from tickfix.toolkit.step_signal import Extremum, StepSignalState, detect_extrema
from tickfix_pdr.multi_threshold import (
    ExtremaState,
    HybridWeights,
    MultiThreshold,
    MultiThresholdParams,
    StepThresholds,
    detect_steps_from_extrema,
    hybrid_heading,
)

Reckon = Callable[[Any, SimulatedWalk], list[Motion]]
THRESHOLDS = StepThresholds(amplitude=1.0, min_peak_interval_s=0.2, stationary_after_s=1.5)
WEIGHTS = HybridWeights(alpha=2.0, beta=1.0, gamma=1.0, theta_c=0.3, theta_m=0.1)


def extrema(*seconds_and_values: tuple[float, float]) -> list[Extremum]:
    """Return peaks for positive, valleys for negative values."""
    return [Extremum(round(s * 1e9), a, a > 0.0) for s, a in seconds_and_values]


def steps(*seconds_and_values: tuple[float, float]) -> list[tuple[float, float, float]]:
    """Return (time, acc_max, acc_min) of the steps found."""
    found = detect_steps_from_extrema(ExtremaState(), extrema(*seconds_and_values), THRESHOLDS)[1]
    return [(step.t_ns * 1e-9, step.acc_max, step.acc_min) for step in found]


def test_a_true_peak_and_a_true_valley_make_a_step() -> None:
    assert steps((1.0, 2.0), (1.25, -1.5), (1.5, 2.5), (1.75, -2.0)) == [(1.25, 2.0, -1.5), (1.75, 2.5, -2.0)]


def test_a_low_peak_and_a_shallow_valley_are_false() -> None:
    assert steps((1.0, 0.9), (1.25, -1.5)) == []
    assert steps((1.0, 1.5), (1.25, -0.9)) == []


def test_a_peak_too_soon_after_a_valley_or_a_peak_is_false() -> None:
    # 0.08 s after the valley, under ½·0.2 s; then 0.15 s after the last peak, under 0.2 s: no second step either way.
    assert len(steps((1.0, 2.0), (1.25, -1.5), (1.33, 3.0), (1.5, -1.5))) == 1
    assert len(steps((1.0, 2.0), (1.1, -1.5), (1.15, 2.0), (1.35, -1.5))) == 1


def test_of_two_peaks_in_a_row_a_later_higher_one_takes_the_place() -> None:
    assert steps((1.0, 2.0), (1.25, 3.0), (1.5, -1.5)) == [(1.5, 3.0, -1.5)]
    assert steps((1.0, 2.0), (1.25, 1.8), (1.5, -1.5)) == [(1.5, 2.0, -1.5)]
    assert steps((1.0, 2.0), (1.1, 3.0), (1.5, -1.5)) == [(1.5, 2.0, -1.5)], "Δt_p under 0.2 s: eq. (4) fails"


def test_a_second_deeper_valley_is_no_second_step_but_moves_the_next_peak() -> None:
    rows = ((1.0, 2.0), (1.2, -1.5), (1.4, -2.0), (1.48, 2.0), (1.7, -2.0))
    assert len(steps(*rows)) == 1, "the peak at 1.48 s is 0.08 s after the valley that counts"


def test_who_stood_begins_anew() -> None:
    assert steps((1.0, 2.0), (4.0, -1.5)) == [], "a valley seconds after a peak is not its valley"


def test_extrema_of_a_raw_wave_lie_where_the_wave_turns() -> None:
    t = np.arange(0.0, 3.0, 0.01)
    a = np.stack([0 * t, 0 * t, 9.81 + 2.0 * np.sin(2.0 * np.pi * t)], axis=1)
    found = detect_extrema(StepSignalState(), Samples(np.rint(t * 1e9).astype(np.int64), a), 0.0)[1]
    times = [(e.t_ns * 1e-9, e.peak) for e in found if e.t_ns > 0]
    assert [peak for _, peak in times] == [True, False, True, False, True, False]
    assert [s for s, _ in times] == pytest.approx([0.25, 0.75, 1.25, 1.75, 2.25, 2.75], abs=0.03)


@pytest.mark.parametrize(
    ("theta_m", "theta_m_before", "theta_g", "expected"),
    [
        # agree and steady: α·θ_{k−1} + β·θ_m + γ·θ_g = direction of 2·(0 rad) + 0.2 rad + 0.1 rad
        (0.2, 0.15, 0.1, math.atan2(math.sin(0.2) + math.sin(0.1), 2.0 + math.cos(0.2) + math.cos(0.1))),
        (0.4, 0.1, 0.2, 0.3),  # agree, the compass jumps: the middle of θ_m and θ_g, weighing alike
        (1.0, 0.95, 0.3, 0.0),  # a steady compass that disagrees: θ_{k−1} alone
        # disagree, and the compass jumps: α·θ_{k−1} + γ·θ_g
        (2.0, 0.5, 0.6, math.atan2(math.sin(0.6), 2.0 + math.cos(0.6))),
    ],
)
def test_each_branch_of_equation_8(theta_m: float, theta_m_before: float, theta_g: float, expected: float) -> None:
    assert hybrid_heading(0.0, theta_m, theta_m_before, theta_g, WEIGHTS) == pytest.approx(expected, abs=1e-12)


def test_the_mean_of_headings_is_taken_on_the_circle() -> None:
    south = math.pi
    theta = hybrid_heading(south, -south + 0.1, south - 0.3, south - 0.1, WEIGHTS)
    assert wrap_rad(theta - south) == pytest.approx(0.0, abs=1e-12)


def test_a_step_is_as_long_as_equation_7_says() -> None:
    t_ns = np.arange(TICK_NS // 10, 40 * TICK_NS, TICK_NS // 10)
    a = np.zeros((len(t_ns), 3))
    a[:, 2] = 9.81 + 3.0 * np.sin(2.0 * np.pi * 1.8 * t_ns * 1e-9)
    pdr, samples = MultiThreshold(MultiThresholdParams(low_pass_hz=0.0, length_factor=0.5), Context()), None
    state, last = pdr.start(), None
    for k in range(1, 40):
        samples = samples_between(
            MotionSamples(sensors={"accelerometer": Samples(t_ns, a)}), (k - 1) * TICK_NS, k * TICK_NS
        )
        state, motion = pdr.step(state, samples)
        last = motion if motion.steps else last
    assert last is not None
    assert last.distance_m == pytest.approx(0.5 * 6.0**0.25, rel=0.02)
    assert last.heading_rad is None, "neither compass nor gyroscope"


def test_steps_and_way_of_simulated_walks_are_right(walks: list[SimulatedWalk], reckon: Reckon) -> None:
    pdr = MultiThreshold(MultiThresholdParams(), Context())
    for walk in walks:
        motions = reckon(pdr, walk)
        assert sum(motion.steps for motion in motions) == pytest.approx(len(walk.steps), rel=0.05)
        assert motions[-1].travelled_m == pytest.approx(walk.trajectory.distance_m[-1], rel=0.12)


def test_the_heading_follows_simulated_turns(walks: list[SimulatedWalk], reckon: Reckon) -> None:
    pdr = MultiThreshold(MultiThresholdParams(), Context())
    for walk in walks:
        motions = reckon(pdr, walk)
        t_s = (np.array([motion.t1_ns for motion in motions]) - walk.t_ns[0]) * 1e-9
        told = np.array([motion.heading_rad for motion in motions], dtype=np.float64)
        walking = np.interp(t_s, walk.trajectory.t_s, walk.trajectory.speed_mps) > 0.3
        error = wrap_rad(told - walk.trajectory.heading_at(t_s))[walking]
        error = wrap_rad(error - np.angle(np.exp(1j * error).mean()))  # map north and the hold stay unknown here
        assert np.sqrt(np.mean(error**2)) < np.radians(12.0)
