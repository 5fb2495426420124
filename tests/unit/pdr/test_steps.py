"""Pdr ``steps`` on simulated walks, whose truth is known, and on recorded ones with switches under the feet."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tickfix.api import TICK_NS, Context, Floats, Motion, MotionSamples, Samples, wrap_rad
from tickfix.simulation import (
    Magnetism,
    SimulatedWalk,
    draw_phone,
    draw_walker,
    office_building,
    random_route,
    simulate_walk,
    walkable_grid,
)
from tickfix_pdr.steps import StepsParams, StepsPdr


def motions(sensors: dict[str, Samples], **params: float) -> Iterator[Motion]:
    """Fold samples tick by tick."""
    pdr = StepsPdr(StepsParams(**params), Context())
    state = pdr.start()
    heard = [s.t_ns for s in sensors.values()]
    first, last = min(int(t[0]) for t in heard), max(int(t[-1]) for t in heard)
    for tick in range(first // TICK_NS, -(-last // TICK_NS) + 1):
        t0_ns, t1_ns = (tick - 1) * TICK_NS, tick * TICK_NS
        within = {}
        for name, samples in sensors.items():
            a, b = np.searchsorted(samples.t_ns, [t0_ns, t1_ns], side="right")
            if b > a:
                within[name] = Samples(samples.t_ns[a:b], samples.values[a:b])
        state, motion = pdr.step(state, MotionSamples(sensors=within, t0_ns=t0_ns, t1_ns=t1_ns))
        yield motion


def sensors_of(walk: SimulatedWalk) -> dict[str, Samples]:
    """Join a recording's batches."""
    batches = [event for event in walk.recording.events if isinstance(event, MotionSamples)]
    batches.sort(key=lambda batch: batch.t0_ns)
    return {
        name: Samples(
            np.concatenate([b.sensors[name].t_ns for b in batches if name in b.sensors]),
            np.concatenate([b.sensors[name].values for b in batches if name in b.sensors]),
        )
        for name in sorted({name for b in batches for name in b.sensors})
    }


@pytest.fixture(scope="module", params=range(4))
def walk(request: pytest.FixtureRequest) -> SimulatedWalk:
    """Walks of four people with four phones in an undisturbed field that points north."""
    building = office_building(
        np.random.default_rng(1), width_m=48.0, height_m=30.0, magnetism=Magnetism(north_rad=0.0, disturbance_ut=0.0)
    )
    rng = np.random.default_rng(request.param)
    route = random_route(walkable_grid(building.floors[0]), rng, 70.0)
    walker, phone = draw_walker(rng), draw_phone(rng)
    return simulate_walk(building, route, rng, name="walk", walker=walker, phone=phone)


def test_steps_are_counted_within_eight_per_cent(walk: SimulatedWalk) -> None:
    counted = sum(motion.steps for motion in motions(sensors_of(walk)))
    assert counted == pytest.approx(len(walk.steps.t_s), rel=0.08, abs=2)


def test_the_way_has_its_length_within_a_third(walk: SimulatedWalk) -> None:
    walked_m = sum(motion.distance_m for motion in motions(sensors_of(walk)))
    assert walked_m == pytest.approx(float(walk.trajectory.distance_m[-1]), rel=0.34)


@pytest.mark.parametrize("without", [(), ("rotation_vector",), ("rotation_vector", "gyroscope")])
def test_the_heading_is_that_of_the_walk(walk: SimulatedWalk, without: tuple[str, ...]) -> None:
    sensors = {name: samples for name, samples in sensors_of(walk).items() if name not in without}
    errors = []
    for motion in motions(sensors):
        if motion.steps and motion.heading_rad is not None:
            middle_s = (0.5 * (motion.t0_ns + motion.t1_ns) - walk.t_ns[0]) * 1e-9
            true = float(walk.trajectory.heading_at(np.array(middle_s - 0.3)))
            errors.append(float(wrap_rad(motion.heading_rad - true)))
    assert len(errors) > 40
    off = float(np.angle(np.exp(1j * np.array(errors)).mean()))  # how the phone is held: constant
    spread = np.abs(wrap_rad(np.array(errors) - off))
    assert float(np.median(spread)) < 0.2
    assert abs(off) < 0.6


def heading_spread_rad(walk: SimulatedWalk, sensors: dict[str, Samples], gyroscope_time_constant_s: float) -> float:
    """Return the standard deviation of the steps' headings, apart from how the phone is held."""
    errors = []
    for motion in motions(sensors, gyroscope_time_constant_s=gyroscope_time_constant_s):
        if motion.steps and motion.heading_rad is not None:
            middle_s = (0.5 * (motion.t0_ns + motion.t1_ns) - walk.t_ns[0]) * 1e-9
            errors.append(motion.heading_rad - float(walk.trajectory.heading_at(np.array(middle_s - 0.3))))
    off = np.angle(np.exp(1j * np.array(errors)).mean())
    return float(np.std(wrap_rad(np.array(errors) - off)))


def test_the_gyroscope_carries_the_heading_through_a_disturbed_field() -> None:
    building = office_building(
        np.random.default_rng(1), width_m=48.0, height_m=30.0, magnetism=Magnetism(north_rad=0.0, disturbance_ut=15.0)
    )
    carried, followed = [], []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        route = random_route(walkable_grid(building.floors[0]), rng, 70.0)
        walker, phone = draw_walker(rng), draw_phone(rng)
        walk = simulate_walk(building, route, rng, name="walk", walker=walker, phone=phone)
        carried.append(heading_spread_rad(walk, sensors_of(walk), 40.0))
        followed.append(heading_spread_rad(walk, sensors_of(walk), 0.0))
    assert np.mean(carried) < 0.8 * np.mean(followed), (carried, followed)


def test_a_tick_without_gyroscope_samples_does_not_throw_the_heading(walk: SimulatedWalk) -> None:
    sensors = sensors_of(walk)
    gyroscope, rotation = sensors["gyroscope"], sensors["rotation_vector"]
    x, y, z, w = rotation.values.T
    sin, cos = np.sin(0.5), np.cos(0.5)
    turned = np.column_stack([cos * x - sin * y, cos * y + sin * x, cos * z + sin * w, cos * w - sin * z])
    bent = (rotation.t_ns - rotation.t_ns[0] > 10_000_000_000)[:, None]  # by one radian, after ten seconds
    sensors["rotation_vector"] = Samples(rotation.t_ns, np.where(bent, turned, rotation.values))
    heard = (gyroscope.t_ns - gyroscope.t_ns[0]) % 4_000_000_000 > 400_000_000
    gaps = {**sensors, "gyroscope": Samples(gyroscope.t_ns[heard], gyroscope.values[heard])}
    whole, gapped = (
        np.array([m.heading_rad for m in motions(s) if m.heading_rad is not None])[: 15 * 5] for s in (sensors, gaps)
    )
    assert float(np.abs(wrap_rad(gapped - whole)).max()) < 0.5


def test_the_heading_is_told_to_change_less_where_a_gyroscope_carries_it(walk: SimulatedWalk) -> None:
    sensors = sensors_of(walk)
    without = {name: samples for name, samples in sensors.items() if name != "gyroscope"}
    carried = {m.turn_bias_sigma_rad for m in motions(sensors) if m.steps == 1}
    compass = {m.turn_bias_sigma_rad for m in motions(without) if m.steps == 1}
    assert carried == {StepsParams().gyroscope_bias_random_walk_rad}
    assert compass == {StepsParams().heading_bias_random_walk_rad}


def test_the_gyroscope_alone_tells_how_the_walk_turns(walk: SimulatedWalk) -> None:
    sensors = {name: s for name, s in sensors_of(walk).items() if name in ("accelerometer", "gyroscope")}
    moved = list(motions(sensors))
    assert all(motion.heading_rad is None for motion in moved)
    turned = sum(motion.turn_rad for motion in moved)
    heading = walk.trajectory.heading_rad
    minutes = (walk.trajectory.t_s[-1] - walk.trajectory.t_s[0]) / 60.0
    assert turned == pytest.approx(float(heading[-1] - heading[0]), abs=0.5 + 0.6 * minutes)


def read(path: Path) -> Floats:
    with gzip.open(path, "rt") as lines:
        return np.loadtxt(lines, delimiter=",")


def recorded(folder: Path) -> tuple[int, int]:
    """Return true and counted steps of an Oxford recording: a step is when a foot's switch closes."""
    switches, raw = read(folder / "stepcounter.csv.gz"), read(folder / "accelerometer.csv.gz")
    true = sum(int((np.diff(switches[:, foot]) > 0).sum()) for foot in (1, 2))
    t_ns, at = np.unique(raw[:, 0].astype(np.int64), return_index=True)
    accelerometer = Samples(t_ns, raw[at, 2:5])
    inside = (t_ns >= int(switches[0, 0])) & (t_ns <= int(switches[-1, 0]))
    accelerometer = Samples(t_ns[inside], accelerometer.values[inside])
    return true, sum(motion.steps for motion in motions({"accelerometer": accelerometer}))


def test_steps_of_recorded_walks_are_counted_within_ten_per_cent_on_average(data_dir: Path) -> None:
    base = data_dir / "oxford-step-counter" / "optimisation"
    folders = sorted(path.parent for path in base.glob("*/stepcounter.csv.gz"))
    if not folders:
        pytest.skip(f"no recordings of steps in {base}")
    counts = np.array([recorded(folder) for folder in folders], float)
    accuracy = 1.0 - np.abs(counts[:, 1] - counts[:, 0]) / counts[:, 0]
    found = {folder.name: row for folder, row in zip(folders, counts.astype(int).tolist(), strict=True)}
    assert accuracy.mean() > 0.9, found
    assert accuracy.min() > 0.6, found
