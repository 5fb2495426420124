"""What a track said at points of truth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tickfix.api import TICK_NS, Truth
from tickfix.evaluation.scoring import NO_ESTIMATE, errors_at_samples, samples_at_waypoints, storeys_apart


def test_error_floor_and_nees_at_each_point(track_of: Any) -> None:
    track = track_of([None, (3, 4), (6, 8)], floors=["F1", "F1", "F3"], sigma_m=5.0)
    truth = [Truth(t_ns=k * TICK_NS, floor="F1", xy=np.zeros(2)) for k in (1, 2, 3)]
    found = errors_at_samples(track, samples_at_waypoints(truth), {"F1": 1, "F2": 2, "F3": 3})
    assert found.error_m[1:].tolist() == [5.0, 10.0]
    assert np.isnan(found.error_m[0])
    assert found.storeys_off.tolist() == [NO_ESTIMATE, 0, 2]
    assert found.nees[1] == pytest.approx(1.0)  # (3² + 4²) / 5²
    assert np.isnan(found.nees[[0, 2]]).all()
    assert found.density_level[1:] == pytest.approx([1 - np.exp(-0.5), 1.0])
    assert found.estimated.tolist() == [False, True, True]
    assert found.floor_right.tolist() == [False, True, False]


def test_floors_that_differ_are_at_least_one_storey_apart() -> None:
    levels = {"F1": 1, "F4": 4, "mezzanine": 1}
    assert storeys_apart("F1", "F1", levels) == 0
    assert storeys_apart("F4", "F1", levels) == 3
    assert storeys_apart("F1", "mezzanine", levels) == 1
    assert storeys_apart("F1", "unheard of", levels) == 1
