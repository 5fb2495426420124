"""The odometer that [wang2015] simulates, against the dead reckoning that it reads."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tickfix.api import Context, Motion, displacement
from tickfix.simulation import SimulatedWalk
from tickfix_pdr.multi_threshold import MultiThreshold, MultiThresholdParams
from tickfix_pdr.pseudo_odometry import PseudoOdometry, PseudoOdometryParams

Reckon = Callable[[Any, SimulatedWalk], list[Motion]]


def test_it_tells_a_way_every_two_seconds_only(walks: list[SimulatedWalk], reckon: Reckon) -> None:
    motions = reckon(PseudoOdometry(PseudoOdometryParams(), Context()), walks[0])
    told = [k for k, motion in enumerate(motions) if motion.distance_m > 0.0]
    assert len(told) > 10
    assert {k % 10 for k in told} == {9}, "2 s are ten ticks"


def test_each_way_is_the_difference_of_the_cumulative_distance(walks: list[SimulatedWalk], reckon: Reckon) -> None:
    fine = reckon(MultiThreshold(MultiThresholdParams(), Context()), walks[0])
    motions = reckon(PseudoOdometry(PseudoOdometryParams(), Context()), walks[0])
    for k in range(9, len(motions), 10):
        before = fine[k - 10].travelled_m if k > 9 else 0.0
        assert motions[k].distance_m == pytest.approx(fine[k].travelled_m - before, abs=1e-9)
        assert motions[k].travelled_m == pytest.approx(fine[k].travelled_m, abs=1e-9)
        assert motions[k].distance_sigma_m == pytest.approx(
            np.sqrt(sum(m.distance_sigma_m**2 for m in fine[max(k - 9, 0) : k + 1])), abs=1e-12
        )


def test_the_heading_of_a_way_is_that_of_the_sum_of_its_steps(walks: list[SimulatedWalk], reckon: Reckon) -> None:
    fine = reckon(MultiThreshold(MultiThresholdParams(), Context()), walks[0])
    motions = reckon(PseudoOdometry(PseudoOdometryParams(), Context()), walks[0])
    k = next(k for k in range(19, len(motions), 10) if motions[k].distance_m > 1.0)
    steps = [displacement(m.distance_m, m.heading_rad or 0.0) for m in fine[k - 9 : k + 1]]
    way = np.sum(steps, axis=0)
    heading = motions[k].heading_rad
    assert heading is not None
    assert displacement(1.0, heading) == pytest.approx(way / np.hypot(*way), abs=1e-9)


def test_the_period_is_a_parameter(walks: list[SimulatedWalk], reckon: Reckon) -> None:
    motions = reckon(PseudoOdometry(PseudoOdometryParams(period_s=1.0), Context()), walks[0])
    assert {k % 5 for k, motion in enumerate(motions) if motion.distance_m > 0.0} == {4}
