"""Truth at waypoints and between them."""

from __future__ import annotations

import numpy as np
import pytest

from tickfix.api import Truth
from tickfix.evaluation.scoring import samples_at_waypoints, samples_between_waypoints

S = 1_000_000_000
T0 = 1_574_559_495 * S


def truth(*rows: tuple[float, float, float, str]) -> list[Truth]:
    return [Truth(t_ns=T0 + round(t * S), floor=floor, xy=np.array([x, y])) for t, x, y, floor in rows]


WALK = truth((4, 3, 4, "F1"), (0, 0, 0, "F1"), (6, 3, 10, "F1"), (9, 1, 1, "F2"), (11, 3, 1, "F2"))


def test_waypoints_come_in_time_order_with_the_way_walked_on_each_floor() -> None:
    points = samples_at_waypoints(WALK)
    assert points.t_ns.tolist() == [T0 + t * S for t in (0, 4, 6, 9, 11)]
    assert points.floors == ("F1", "F1", "F1", "F2", "F2")
    assert points.travelled_m.tolist() == [0, 5, 11, 11, 13]  # the stairs count nothing


def test_between_waypoints_truth_is_linear_in_time_and_never_crosses_floors() -> None:
    points = samples_between_waypoints(WALK)
    assert [(t - T0) // S for t in points.t_ns.tolist()] == [1, 2, 3, 5, 10]
    assert points.floors == ("F1", "F1", "F1", "F1", "F2")
    assert points.xy == pytest.approx(np.array([[0.75, 1], [1.5, 2], [2.25, 3], [3, 7], [2, 1]]))
    assert points.travelled_m == pytest.approx([1.25, 2.5, 3.75, 8, 12])


@pytest.mark.parametrize("rows", [(), ((3, 1, 1, "F1"),)])
def test_fewer_than_two_waypoints_have_nothing_between(rows: tuple[tuple[float, float, float, str], ...]) -> None:
    assert len(samples_between_waypoints(truth(*rows))) == 0
    assert len(samples_at_waypoints(truth(*rows))) == len(rows)
