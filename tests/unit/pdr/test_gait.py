"""Steps counted times a default length."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tickfix.api import Context, Motion, RadioMap, Survey
from tickfix.simulation import SimulatedWalk
from tickfix.site.waypoints import to_survey_walk
from tickfix_pdr.gait import Gait, GaitParams

Reckon = Callable[[Any, SimulatedWalk], list[Motion]]


def test_every_step_is_as_long_as_the_default(walks: list[SimulatedWalk], reckon: Reckon) -> None:
    motions = reckon(Gait(GaitParams(step_length_m=0.6), Context()), walks[0])
    steps = sum(motion.steps for motion in motions)
    assert steps == pytest.approx(len(walks[0].steps), rel=0.05)
    assert motions[-1].travelled_m == pytest.approx(0.6 * steps)


def test_the_survey_teaches_the_drawings_north_but_no_step_length(walks: list[SimulatedWalk]) -> None:
    none = np.zeros(0, np.int64)
    radio = RadioMap(
        floors=("F1",), transmitters=(), point_floor=none, point_xy=np.zeros((0, 2)), sample_point=none,
        sample_transmitter=none, sample_rssi_dbm=none, sample_xy=np.zeros((0, 2)), sample_t_ns=none, sample_chain=none,
    )  # fmt: skip
    training_data = tuple(to_survey_walk(walk.recording, walk.recording.name) for walk in walks)
    survey = Survey(floors=(), radio_map=radio, walks=training_data)
    trained = Gait.train(GaitParams(), survey, np.random.default_rng(0))
    assert set(trained) == {"heading_offset_rad"}
    # The demo's magnetic north lies 12° clockwise of the drawing's.
    assert float(trained["heading_offset_rad"]) == pytest.approx(np.radians(12.0), abs=np.radians(8.0))
