"""Availability, smoothness, jumps, walls and cost of whole tracks, against values computed by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tickfix.api import Floor
from tickfix.evaluation.track_metrics import (
    StageCost,
    StageTimer,
    WallViolations,
    count_stationary_jumps,
    count_wall_violations,
    floor_geometries,
    is_stationary,
    smoothness,
    time_to_first_position_s,
    track_positions,
)
from tickfix.kernel import Pipeline, Stage

S = 1_000_000_000


def test_the_first_position_counts_from_when_it_was_known(track_of: Any) -> None:
    track = track_of([None, (0, 0)], closed_ns=[5 * S, 7 * S])
    assert time_to_first_position_s(track, 4 * S) == pytest.approx(3.0)
    assert time_to_first_position_s(track_of([None, None]), 0) is None


def test_accelerations_are_second_differences_of_ticks_in_a_row(track_of: Any) -> None:
    # Moves 0.2 m, then 0.4 m a tick: from 1 to 2 m/s in 0.2 s. The gap joins nothing.
    found = smoothness(track_positions(track_of([(0, 0), (0.2, 0), (0.6, 0), None, (9, 9), (9, 10)])))
    assert found.accelerations == 1
    assert found.squared_mps2 == pytest.approx(25.0)
    assert found.path_m == pytest.approx(1.6)


def test_a_change_of_floor_is_no_way_and_no_acceleration(track_of: Any) -> None:
    found = smoothness(track_positions(track_of([(0, 0), (0, 0), (5, 0), (5, 0)], floors=["F1", "F1", "F2", "F2"])))
    assert (found.accelerations, found.squared_mps2, found.path_m) == (0, 0.0, 0.0)


def test_a_track_of_one_place_or_none_is_perfectly_smooth(track_of: Any) -> None:
    for where in ([], [None], [(1, 1)]):
        assert smoothness(track_positions(track_of(where))).accelerations == 0


def test_standing_is_a_second_of_hardly_varying_acceleration() -> None:
    t_ns = np.arange(0, 6 * S, S // 50)
    wave = np.where(t_ns < 3 * S, 3.0 * np.sin(2 * np.pi * 2.0 * t_ns * 1e-9), 0.0)
    still = is_stationary(t_ns, 9.81 + wave, np.array([2 * S, 3 * S, 4 * S, 5 * S, 20 * S]))
    # At 3 s the second before was all walking; at 20 s nothing was measured.
    assert still.tolist() == [False, False, True, True, False]
    assert not is_stationary(np.zeros(0, np.int64), np.zeros(0), np.array([1])).any()


def test_a_deviation_of_half_a_metre_per_second_squared_parts_standing_from_walking() -> None:
    t_ns, at = np.arange(0, S, S // 50), np.array([S])
    square = np.where(np.arange(50) % 2, 1.0, -1.0)
    assert is_stationary(t_ns, 9.8 + 0.49 * square, at).all()
    assert not is_stationary(t_ns, 9.8 + 0.51 * square, at).any()


def test_jumps_in_a_row_are_one_and_only_standing_ticks_can_jump(track_of: Any) -> None:
    hops = [(0, 0)] * 6 + [(1.5, 0)] * 12 + [(1.5, 0.9)] * 12 + [(9, 9)] * 6
    track = track_positions(track_of(hops))
    found = count_stationary_jumps(track, np.ones(36, dtype=bool))
    assert (found.jumps, found.stationary_s) == (2, pytest.approx(7.2))  # 0.9 m is no jump
    walking = np.ones(36, dtype=bool)
    walking[30:] = False
    assert count_stationary_jumps(track, walking).jumps == 1
    assert count_stationary_jumps(track_positions(track_of([])), np.zeros(0, dtype=bool)).jumps == 0


def test_a_change_of_floor_while_standing_is_a_jump(track_of: Any) -> None:
    track = track_positions(track_of([(0, 0)] * 12, floors=["F1"] * 6 + ["F2"] * 6))
    assert count_stationary_jumps(track, np.ones(12, dtype=bool)).jumps == 1


ROOM = Floor(
    name="F1",
    outline=(np.array([[0.0, 0], [10, 0], [10, 10], [0, 10]]),),
    obstacles=(np.array([[4.0, 4], [6, 4], [6, 6], [4, 6]]),),
    walls=np.array([[[8.0, 0.0], [8.0, 3.0]]]),
)


def test_walls_crossed_and_places_outside_are_counted_on_floors_with_a_plan(track_of: Any) -> None:
    drawn = floor_geometries([ROOM, Floor(name="F2")])
    assert list(drawn) == ["F1"]
    # Through the wall; around its end; into the obstacle; out of it; through the outline.
    way = [(7, 1), (9, 1), (9, 4), (7, 4), (5, 5), (7, 7), (7, 11), (7, 11)]
    assert count_wall_violations(track_positions(track_of(way)), drawn) == WallViolations(
        moves=7, crossings=4, positions=8, outside=3
    )
    elsewhere = track_positions(track_of(way, floors=["F2"] * 8))
    assert count_wall_violations(elsewhere, drawn) == WallViolations(moves=0, crossings=0, positions=0, outside=0)


class Slow:
    """An algorithm whose every call takes 3 µs of a clock of its own."""

    State = int

    def __init__(self, clock: list[int]) -> None:
        self.clock = clock

    def start(self, *_: Any) -> int:
        self.clock[0] += 3000
        return 0

    step = estimate = start


def test_the_meter_charges_shared_stages_to_every_pipeline() -> None:
    clock = [0]
    pdr, filter_ = Stage("pdr", "a", "a", Slow(clock)), Stage("filter", "b", "b", Slow(clock))
    scans = Stage("fingerprint", "c", "c", Slow(clock))
    one, two = Pipeline("one", filter_, pdr=pdr, fingerprint=scans), Pipeline("two", filter_, pdr=pdr)
    meter = StageTimer([one, two], lambda: clock[0])
    assert meter.pipelines[0].pdr is not None
    assert meter.pipelines[1].pdr is not None
    assert meter.pipelines[0].pdr.algorithm is meter.pipelines[1].pdr.algorithm
    assert meter.pipelines[0].filter.algorithm.State is int
    for algorithm in (meter.pipelines[0].pdr.algorithm, meter.pipelines[0].filter.algorithm):
        algorithm.start()
        algorithm.step(0)
    assert meter.pipelines[0].fingerprint is not None
    meter.pipelines[0].fingerprint.algorithm.step(0)
    meter.pipelines[0].filter.algorithm.estimate(0)
    assert meter.cost(one, 10) == StageCost(pdr_ns=6000, fingerprint_ns=3000, filter_ns=9000, ticks=10, scans=1)
    assert meter.cost(two, 10) == StageCost(pdr_ns=6000, filter_ns=9000, ticks=10)
    assert meter.cost(one, 10).per_tick_us == pytest.approx(1.8)
    assert meter.cost(one, 10).per_fix_us == pytest.approx(3.0)
    assert (meter.cost(two, 0).per_tick_us, meter.cost(two, 1).per_fix_us) == (None, None)
