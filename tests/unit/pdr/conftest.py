"""Simulated walks, and dead reckoning run over them as the kernel runs it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tickfix.api import TICK_NS, Motion, MotionSamples
from tickfix.simulation import SimulatedWalk, demo_building, simulate_walks
from tickfix.site.waypoints import to_survey_walk
from tickfix.toolkit.calibration import samples_between


@pytest.fixture(scope="session")
def walks() -> list[SimulatedWalk]:
    """People of their own gait with phones of their own."""
    return list(simulate_walks(demo_building(3), "F1", np.random.default_rng(9), count=4))


@pytest.fixture(scope="session")
def reckon() -> Callable[[Any, SimulatedWalk], list[Motion]]:
    """Return what runs a pdr over a walk: the motion of every tick."""

    def run(pdr: Any, walk: SimulatedWalk) -> list[Motion]:
        samples: MotionSamples = to_survey_walk(walk.recording, walk.recording.name).motion
        state, motions = pdr.start(), []
        for k in range(samples.t0_ns // TICK_NS, -(-samples.t1_ns // TICK_NS) + 1):
            state, motion = pdr.step(state, samples_between(samples, (k - 1) * TICK_NS, k * TICK_NS))
            motions.append(motion)
        return motions

    return run
