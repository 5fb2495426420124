"""Errors at waypoints, and where the survey has been."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from tickfix.api import TICK_NS, Truth
from tickfix.evaluation.scoring import Coverage, WalkScore, score_walk

NOWHERE = Coverage([])
POINTS = st.tuples(st.floats(-100, 100), st.floats(-100, 100))


def waypoint(t_ns: int, x: float, y: float, floor: str = "F1") -> Truth:
    return Truth(t_ns=t_ns, floor=floor, xy=np.array([x, y]))


def score(truth: list[Truth], coverage: Coverage = NOWHERE, **tracks: Any) -> WalkScore:
    return score_walk("walk", "F1", truth, tracks, coverage)


def test_the_error_is_that_of_the_last_tick_closed_by_the_waypoint(track_of: Any) -> None:
    track = track_of([(0, 0), (10, 0), (20, 0)], closed_ns=[100, 250, 250])
    truth = [waypoint(t, 0, 0) for t in (99, 100, 249, 250, 10**12)]
    found = score(truth, p=track).pipelines["p"]
    np.testing.assert_array_equal(found.error_m, [np.nan, 0, 0, 20, 20])


def test_a_tick_that_is_due_but_did_not_close_in_time_does_not_count(track_of: Any) -> None:
    track = track_of([(0, 0), (3, 4)], closed_ns=[TICK_NS, 9 * TICK_NS])
    assert score([waypoint(8 * TICK_NS, 3, 4)], p=track).pipelines["p"].error_m == [5.0]
    assert score([waypoint(9 * TICK_NS, 3, 4)], p=track).pipelines["p"].error_m == [0.0]


def test_an_estimate_without_belief_is_no_estimate_and_an_older_one_does_not_stand_in(track_of: Any) -> None:
    track = track_of([(0, 0), None], closed_ns=[1, 2])
    assert track.belief_at(1) is not None
    assert track.belief_at(2) is None
    assert track.belief_at(0) is None


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_belief_that_is_not_finite_is_no_estimate(track_of: Any, bad: float) -> None:
    assert track_of([(bad, 0.0)]).belief_at(TICK_NS) is None


def test_scored_are_the_waypoints_at_which_every_pipeline_has_an_estimate(track_of: Any) -> None:
    early, late = track_of([(0, 0)] * 4), track_of([None, None, (0, 0), (0, 0)])
    found = score([waypoint(k * TICK_NS, 0, 0) for k in range(5)], early=early, late=late)
    np.testing.assert_array_equal(found.scored, [False, False, False, True, True])
    np.testing.assert_array_equal(found.pipelines["early"].estimated, [False, True, True, True, True])
    np.testing.assert_array_equal(found.pipelines["late"].estimated, [False, False, False, True, True])


def test_the_floor_is_right_only_where_an_estimate_names_it(track_of: Any) -> None:
    track = track_of([None, (0, 0), (0, 3)], floors=["F1", "F1", "F2"])
    found = score([waypoint(k * TICK_NS, 0, 0) for k in (1, 2, 3)], p=track).pipelines["p"]
    np.testing.assert_array_equal(found.floor_right, [False, True, False])
    np.testing.assert_array_equal(found.error_m, [np.nan, 0, 3])


def test_waypoints_may_come_in_any_order(track_of: Any) -> None:
    track = track_of([(0, 0), (1, 0)])
    truth = [waypoint(2 * TICK_NS, 0, 0), waypoint(TICK_NS, 0, 0)]
    found = score(truth, p=track)
    np.testing.assert_array_equal(found.t_ns, [TICK_NS, 2 * TICK_NS])
    np.testing.assert_array_equal(found.pipelines["p"].error_m, [0, 1])


def test_a_walk_without_waypoints_and_a_track_without_ticks_are_scored_as_nothing(track_of: Any) -> None:
    assert len(score([], p=track_of([(0, 0)]))) == 0
    assert not score([waypoint(5, 0, 0)], p=track_of([])).scored.any()


def test_covered_is_what_lies_within_three_metres_of_a_survey_walk_of_the_same_floor(track_of: Any) -> None:
    coverage = Coverage([("F1", np.array([[0.0, 0.0], [10.0, 0.0]])), ("F2", np.array([[0.0, 50.0], [10.0, 50.0]]))])
    truth = [
        waypoint(1, 5.0, 3.0),
        waypoint(2, 5.0, 3.001),
        waypoint(3, 13.0, 0.0),
        waypoint(4, 12.2, 2.2),
        waypoint(5, 5.0, 50.0),
        waypoint(6, 5.0, 50.0, "F2"),
        waypoint(7, 5.0, 0.0, "F3"),
    ]
    found = score(truth, coverage, p=track_of([]))
    np.testing.assert_array_equal(found.covered, [True, False, True, False, False, True, False])


def test_a_survey_walk_covers_with_one_waypoint_a_disc_with_a_repeated_one_too_and_with_none_nothing() -> None:
    xy = np.array([[2.9, 0.0], [3.1, 0.0]])
    for way in (np.zeros((1, 2)), np.zeros((2, 2))):
        np.testing.assert_array_equal(Coverage([("F1", way)]).covers("F1", xy), [True, False])
    assert not Coverage([("F1", np.zeros((0, 2)))]).covers("F1", xy).any()


def test_any_survey_walk_will_do() -> None:
    coverage = Coverage([("F1", np.array([[0.0, y], [10.0, y]])) for y in (0.0, 20.0)])
    np.testing.assert_array_equal(coverage.covers("F1", np.array([[5.0, 1], [5, 10], [5, 19]])), [True, False, True])
    assert coverage.covers("F1", np.zeros((0, 2))).shape == (0,)


@given(st.lists(st.tuples(POINTS, POINTS), min_size=1, max_size=8), POINTS)
def test_moving_everything_changes_no_error_and_no_coverage(
    track_of: Any, pairs: list[tuple[tuple[float, float], tuple[float, float]]], offset: tuple[float, float]
) -> None:
    def run(by: Any) -> WalkScore:
        track = track_of([tuple(np.add(place, by)) for _, place in pairs])
        truth = [waypoint(k * TICK_NS, *np.add(place, by)) for k, (place, _) in enumerate(pairs, start=1)]
        way = np.add([place for _, place in pairs], by)
        return score(truth, Coverage([("F1", way)], radius_m=40.0), p=track)

    still, moved = run((0.0, 0.0)), run(offset)
    np.testing.assert_allclose(moved.pipelines["p"].error_m, still.pipelines["p"].error_m, atol=1e-9)
    assert _on_the_edge(pairs) or (moved.covered == still.covered).all()


def _on_the_edge(pairs: list[tuple[tuple[float, float], tuple[float, float]]]) -> bool:
    places = [place for _, place in pairs]
    way = shapely.LineString(places) if len(places) > 1 else shapely.Point(places[0])
    return any(abs(way.distance(shapely.Point(place)) - 40.0) < 1e-6 for place, _ in pairs)


@given(st.permutations(["a", "b", "c"]))
def test_the_order_of_pipelines_is_irrelevant(track_of: Any, order: list[str]) -> None:
    tracks = {
        "a": track_of([(0, 0), (1, 1), None]),
        "b": track_of([None, (2, 2), (3, 3)]),
        "c": track_of([(5, 5), (4, 4), (3, 3)]),
    }
    truth = [waypoint(k * TICK_NS, 0, 0) for k in (1, 2, 3)]
    found, expected = score(truth, **{name: tracks[name] for name in order}), score(truth, **tracks)
    np.testing.assert_array_equal(found.scored, expected.scored)
    np.testing.assert_array_equal(found.scored, [False, True, False])
    for name in order:
        np.testing.assert_array_equal(found.pipelines[name].error_m, expected.pipelines[name].error_m)
