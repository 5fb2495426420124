"""What the motion sensors of a perfect, and of a real phone say."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import find_peaks
from scipy.spatial.transform import Rotation

from tickfix.api import Floats, MotionSamples, Recording, wrap_rad
from tickfix.simulation import (
    Building,
    Magnetism,
    Phone,
    PhoneHold,
    SimulatedWalk,
    WalkableGrid,
    Walker,
    assemble_building,
    draw_phone,
    perfect_phone,
    random_route,
    simulate_walk,
)
from tickfix.simulation.phone_sensors import heading_of_attitude

NORTH_RAD = 0.3
PITCH_RAD = 0.7


def samples(recording: Recording, sensor: str) -> tuple[Floats, Floats]:
    """Return times in seconds since the recording's epoch and values of one sensor."""
    batches = [e.sensors[sensor] for e in recording.events if isinstance(e, MotionSamples)]
    t = np.concatenate([batch.t_ns for batch in batches])
    order = np.argsort(t)
    return t[order], np.concatenate([batch.values for batch in batches])[order]


def true_heading(walk: SimulatedWalk, t_ns: Floats) -> Floats:
    return walk.trajectory.heading_at((t_ns - walk.t_ns[0]) * 1e-9)


def test_the_rotation_vector_of_a_perfect_phone_tells_the_heading_from_magnetic_north(perfect: SimulatedWalk) -> None:
    t, quaternions = samples(perfect.recording, "rotation_vector")
    assert np.allclose(np.linalg.norm(quaternions, axis=1), 1.0)
    heading = heading_of_attitude(quaternions) + NORTH_RAD
    assert np.abs(wrap_rad(heading - true_heading(perfect, t))).max() < 1e-6


def test_a_perfect_gyroscope_integrates_to_the_heading(perfect: SimulatedWalk) -> None:
    t, rate = samples(perfect.recording, "gyroscope")
    # Clockwise turns are negative about the vertical, which a phone pitched by 40° feels in y and z.
    about_vertical = rate[:, 1] * np.sin(PITCH_RAD) + rate[:, 2] * np.cos(PITCH_RAD)
    turned = -np.cumsum(about_vertical[1:] * np.diff(t) * 1e-9)
    heading = true_heading(perfect, t)
    assert np.abs(heading[0] + turned - heading[1:]).max() < 1e-3


def test_gyroscope_and_rotation_vector_agree_for_a_swaying_hand(building: Building, grid: WalkableGrid) -> None:
    rng = np.random.default_rng(4)
    route = random_route(grid, rng, 30.0)
    walk = simulate_walk(building, route, rng, name="swaying", phone=perfect_phone())
    t, rate = samples(walk.recording, "gyroscope")
    rotations = Rotation.from_quat(samples(walk.recording, "rotation_vector")[1])
    turns = (rotations[:-1].inv() * rotations[1:]).as_rotvec()
    assert np.allclose(turns, rate[1:] * np.diff(t)[:, None] * 1e-9, atol=1e-6)
    assert rate.std() > 0.05


def test_gravity_is_what_the_accelerometer_feels_on_average(perfect: SimulatedWalk) -> None:
    t, acceleration = samples(perfect.recording, "accelerometer")
    assert np.linalg.norm(acceleration, axis=1).mean() == pytest.approx(9.81, abs=0.15)
    still = (t - perfect.t_ns[0]) * 1e-9 < 1.0
    expected = 9.81 * np.array([0.0, np.sin(PITCH_RAD), np.cos(PITCH_RAD)])
    assert np.allclose(acceleration[still], expected, atol=1e-6)


def test_the_acceleration_has_one_peak_a_step(perfect: SimulatedWalk) -> None:
    _, acceleration = samples(perfect.recording, "accelerometer")
    peaks, _ = find_peaks(np.linalg.norm(acceleration, axis=1), prominence=0.3)
    assert abs(len(peaks) - len(perfect.steps)) <= 2


def test_weinbergs_formula_finds_the_distance(perfect: SimulatedWalk) -> None:
    t, acceleration = samples(perfect.recording, "accelerometer")
    norm = np.linalg.norm(acceleration, axis=1)
    seconds = (t - perfect.t_ns[0]) * 1e-9
    ends = perfect.steps.t_s
    lengths = [0.43 * np.ptp(norm[(seconds > a) & (seconds <= b)]) ** 0.25 for a, b in pairwise(ends) if b - a < 0.7]
    full = np.diff(ends) < 0.7
    assert np.sum(lengths) == pytest.approx(perfect.steps.length_m[1:][full].sum(), rel=0.06)


def test_the_magnetometer_points_north_and_down(perfect: SimulatedWalk) -> None:
    _, field = samples(perfect.recording, "magnetometer")
    _, quaternions = samples(perfect.recording, "rotation_vector")
    world = Rotation.from_quat(quaternions).apply(field)
    expected = 48.0 * np.array([0.0, np.cos(1.13), -np.sin(1.13)])
    assert np.allclose(world, expected, atol=1e-6)


def test_a_disturbed_field_pulls_the_rotation_vector(building: Building, grid: WalkableGrid) -> None:
    disturbed = assemble_building(
        building.floors, building.access_points, np.random.default_rng(1), magnetism=Magnetism(disturbance_ut=5.0)
    )
    rng = np.random.default_rng(2)
    route = random_route(grid, rng, 60.0)
    walker = Walker(hold=PhoneHold(sway_rad=0.0, wander_rad=0.0))
    walk = simulate_walk(disturbed, route, rng, name="pulled", walker=walker, phone=perfect_phone())
    t, quaternions = samples(walk.recording, "rotation_vector")
    error = wrap_rad(heading_of_attitude(quaternions) - true_heading(walk, t))
    assert 0.02 < error.std() + abs(error.mean()) < 0.5
    assert np.abs(np.diff(error)).max() < 0.02


def test_a_phone_held_askew_points_beside_the_way(building: Building, grid: WalkableGrid) -> None:
    rng = np.random.default_rng(6)
    walker = Walker(hold=PhoneHold(yaw_rad=0.2, sway_rad=0.0, wander_rad=0.0))
    route = random_route(grid, rng, 20.0)
    walk = simulate_walk(building, route, rng, name="askew", walker=walker, phone=perfect_phone())
    t, quaternions = samples(walk.recording, "rotation_vector")
    assert np.allclose(wrap_rad(heading_of_attitude(quaternions) + NORTH_RAD - true_heading(walk, t)), 0.2, atol=1e-6)


def test_biases_and_noise_are_as_set(building: Building, grid: WalkableGrid) -> None:
    phone = replace(
        perfect_phone(), gyroscope_bias_rad_s=(0.01, -0.02, 0.03), accelerometer_noise_mps2=0.1, hard_iron_ut=(3, 0, 0)
    )
    route = random_route(grid, np.random.default_rng(8), 20.0)
    exact, real = (
        simulate_walk(building, route, np.random.default_rng(9), name="x", phone=p) for p in (perfect_phone(), phone)
    )
    apart = {s: samples(real.recording, s)[1] - samples(exact.recording, s)[1] for s in Phone().sensors[:3]}
    assert np.allclose(apart["gyroscope"], [0.01, -0.02, 0.03])
    assert np.allclose(apart["magnetometer"], [3, 0, 0])
    assert apart["accelerometer"].std() == pytest.approx(0.1, rel=0.05)


def test_times_jitter_around_the_rate_and_never_run_backwards(building: Building, grid: WalkableGrid) -> None:
    rng = np.random.default_rng(3)
    phone = replace(draw_phone(rng), jitter_s=0.002, dropouts_per_s=0.1)
    route = random_route(grid, rng, 60.0)
    walk = simulate_walk(building, route, rng, name="jitter", phone=phone)
    gaps = np.diff(samples(walk.recording, "accelerometer")[0]) * 1e-9
    assert gaps.min() > 0
    assert np.median(gaps) == pytest.approx(0.02, abs=0.001)
    assert 0.1 < gaps.max() < 2.0


def test_a_phone_without_a_compass_sends_none(building: Building, grid: WalkableGrid) -> None:
    rng = np.random.default_rng(3)
    phone = replace(Phone(), sensors=("accelerometer", "gyroscope"))
    walk = simulate_walk(building, random_route(grid, rng, 10.0), rng, name="bare", phone=phone)
    heard = {sensor for e in walk.recording.events if isinstance(e, MotionSamples) for sensor in e.sensors}
    assert heard == {"accelerometer", "gyroscope"}
