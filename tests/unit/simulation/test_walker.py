"""Walking: course, steps and gait."""

from __future__ import annotations

import numpy as np
import pytest

from tickfix.api import displacement
from tickfix.simulation import (
    Route,
    SimulatedWalk,
    Trajectory,
    TrueSteps,
    WalkableGrid,
    Walker,
    draw_walker,
    random_route,
    walk_route,
)


def walked(grid: WalkableGrid, walker: Walker | None = None) -> tuple[Route, Trajectory, TrueSteps]:
    rng = np.random.default_rng(0)
    route = random_route(grid, rng, 80.0)
    return route, *walk_route(route, walker or Walker(), rng)


def test_the_walk_begins_and_ends_with_its_route_at_rest(grid: WalkableGrid) -> None:
    route, trajectory, _ = walked(grid)
    assert np.allclose(trajectory.xy[[0, -1]], route.xy[[0, -1]], atol=1e-6)
    assert trajectory.speed_mps[[0, -1]].tolist() == [0.0, 0.0]
    assert trajectory.distance_m[-1] == pytest.approx(route.length_m)


def test_true_steps_along_true_headings_give_the_true_way(grid: WalkableGrid) -> None:
    _, trajectory, steps = walked(grid)
    edges = np.concatenate([[0.0], steps.t_s])
    # A step from a stop begins when the stop ends: its heading is the one held halfway along its way.
    ways = np.interp(edges, trajectory.t_s, trajectory.distance_m)
    moving, first = np.unique(trajectory.distance_m, return_index=True)
    middle = np.interp((ways[:-1] + ways[1:]) / 2.0, moving, trajectory.heading_rad[first])
    end = trajectory.xy[0] + displacement(steps.length_m, middle).sum(axis=0)
    assert steps.length_m.sum() == pytest.approx(trajectory.distance_m[-1], abs=1e-6)
    assert np.hypot(*(end - trajectory.xy[-1])) < 0.5


def test_speed_integrated_along_the_heading_gives_every_place(grid: WalkableGrid) -> None:
    _, trajectory, _ = walked(grid)
    ds, heading = np.diff(trajectory.distance_m), (trajectory.heading_rad[:-1] + trajectory.heading_rad[1:]) / 2.0
    xy = trajectory.xy[0] + np.cumsum(displacement(ds, heading), axis=0)
    assert np.abs(xy - trajectory.xy[1:]).max() < 0.25


def test_nobody_turns_or_accelerates_faster_than_they_can(grid: WalkableGrid) -> None:
    _, trajectory, _ = walked(grid, Walker(turn_rad_s=2.0, acceleration_mps2=0.9))
    dt = np.diff(trajectory.t_s)
    assert np.abs(np.diff(trajectory.heading_rad) / dt).max() < 2.0 * 1.3
    assert np.abs(np.diff(trajectory.speed_mps) / dt).max() < 0.9 * 1.05


def test_step_length_over_cadence_is_the_persons_walk_ratio(grid: WalkableGrid) -> None:
    _, _, steps = walked(grid, Walker(walk_ratio_ms=0.36, step_jitter=0.0, pauses_per_m=0.0))
    duration = np.diff(steps.t_s)
    steady = duration < 0.62
    assert np.median(steps.length_m[1:][steady] * duration[steady]) == pytest.approx(0.36, rel=0.03)


def test_steps_swing_as_weinberg_says(grid: WalkableGrid) -> None:
    _, _, steps = walked(grid, Walker(weinberg_k=0.45, swing_jitter=0.0))
    full = steps.swing_mps2 > 1.0
    assert np.allclose(0.45 * steps.swing_mps2[full] ** 0.25, steps.length_m[full])


def test_pauses_stand_still_on_a_whole_step(perfect: SimulatedWalk) -> None:
    trajectory = perfect.trajectory
    still = (trajectory.speed_mps == 0) & (trajectory.t_s > 2) & (trajectory.t_s < trajectory.t_s[-1] - 2)
    assert still.sum() > 200
    assert np.allclose(trajectory.phase[still], np.round(trajectory.phase[still]), atol=1e-6)
    assert np.all(trajectory.swing_mps2[still] < 1e-6)


def test_a_sharp_corner_is_turned_on_the_spot() -> None:
    corner = Route("F1", np.array([[0.0, 0.0], [0.0, 5.0], [5.0, 5.0]]))
    trajectory, _ = walk_route(corner, Walker(pauses_per_m=0.0, turn_rad_s=2.0), np.random.default_rng(0))
    turning = (trajectory.heading_rad > 0.01) & (trajectory.heading_rad < np.pi / 2 - 0.01)
    assert np.allclose(trajectory.xy[turning], [0.0, 5.0], atol=1e-3)
    assert turning.sum() / 200.0 == pytest.approx(np.pi / 4.0, abs=0.05)


def test_people_differ() -> None:
    rng = np.random.default_rng(0)
    people = [draw_walker(rng) for _ in range(20)]
    assert len({person.speed_mps for person in people}) == 20
    assert all(np.radians(30) <= person.hold.pitch_rad <= np.radians(50) for person in people)


def test_a_line_of_one_point_is_no_route() -> None:
    with pytest.raises(ValueError, match="expected at least two points"):
        Route("F1", np.zeros((1, 2)))
