"""Whole recordings, surveys and the demo."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tickfix.api import MotionSamples, Recording, Scan, Truth
from tickfix.simulation import (
    Building,
    DemoScenario,
    LoggingSettings,
    SimulatedWalk,
    WalkableGrid,
    Walker,
    draw_phone,
    random_route,
    simulate_demo,
    simulate_walk,
    simulate_walks,
)


def digest(recording: Recording) -> str:
    total = hashlib.sha256()
    for event in recording.events:
        total.update(repr((type(event).__name__, event.t_ns, event.arrival_ns, event.seq, event.device)).encode())
        if isinstance(event, MotionSamples):
            for sensor, samples in event.sensors.items():
                total.update(sensor.encode() + samples.t_ns.tobytes() + samples.values.tobytes())
        elif isinstance(event, Scan):
            total.update(repr(event.transmitters).encode() + event.rssi_dbm.tobytes() + event.heard_ns.tobytes())
        elif isinstance(event, Truth):
            total.update(event.xy.tobytes())
    return total.hexdigest()


@pytest.fixture(scope="module")
def shown() -> DemoScenario:
    return simulate_demo(seed=0)


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(building: Building) -> None:
    def run(seed: int) -> list[str]:
        people = simulate_walks(building, "F1", np.random.default_rng(seed), count=2, length_m=30.0)
        return [digest(walk.recording) for walk in people]

    assert run(1) == run(1)
    assert not set(run(1)) & set(run(2))


def test_more_walks_leave_the_first_ones_as_they_are(building: Building) -> None:
    one, three = (
        list(simulate_walks(building, "F1", np.random.default_rng(3), count=n, length_m=20.0)) for n in (1, 3)
    )
    assert digest(one[0].recording) == digest(three[0].recording)


def test_another_phone_is_carried_along_the_same_walk(building: Building, grid: WalkableGrid) -> None:
    route = random_route(grid, np.random.default_rng(0), 30.0)
    phones = [draw_phone(np.random.default_rng(i)) for i in range(2)]
    a, b = (simulate_walk(building, route, np.random.default_rng(5), name="x", phone=phone) for phone in phones)
    assert np.array_equal(a.trajectory.xy, b.trajectory.xy)
    assert digest(a.recording) != digest(b.recording)


def test_events_stand_in_the_order_of_arrival_and_none_arrives_before_it_was_measured(perfect: SimulatedWalk) -> None:
    arrivals = [event.arrival_ns for event in perfect.recording.events]
    assert arrivals == sorted(arrivals)
    assert all(event.arrival_ns > event.t_ns for event in perfect.recording.events)


def test_messages_are_counted_without_gap_and_taps_after_them(perfect: SimulatedWalk) -> None:
    messages = [e.seq for e in perfect.recording.events if not isinstance(e, Truth)]
    taps = [e.seq for e in perfect.recording.events if isinstance(e, Truth)]
    assert messages == list(range(len(messages)))
    assert taps == list(range(len(messages), len(messages) + len(taps)))
    assert {event.device for event in perfect.recording.events} == {"perfect"}


def test_batches_may_overtake_each_other_on_a_slow_net(building: Building, grid: WalkableGrid) -> None:
    rng = np.random.default_rng(1)
    route = random_route(grid, rng, 20.0)
    walk = simulate_walk(building, route, rng, name="slow", logging=LoggingSettings(batch_s=0.05, latency_s=(0.0, 0.4)))
    measured = [e.t_ns for e in walk.recording.events if isinstance(e, MotionSamples)]
    assert measured != sorted(measured)


def test_waypoints_lie_on_the_true_way_at_their_time(perfect: SimulatedWalk) -> None:
    truth = perfect.recording.truth
    xy = perfect.trajectory.xy_at((np.array([t.t_ns for t in truth]) - perfect.t_ns[0]) * 1e-9)
    assert np.allclose([t.xy for t in truth], xy, atol=1e-6)
    assert np.allclose(truth[0].xy, perfect.trajectory.xy[0])
    assert np.allclose(truth[-1].xy, perfect.trajectory.xy[-1], atol=0.02)
    assert np.diff([t.t_ns for t in truth]).min() > 1e9


def test_batches_cover_the_walk_without_loss(perfect: SimulatedWalk) -> None:
    n = sum(len(e.sensors["accelerometer"]) for e in perfect.recording.events if isinstance(e, MotionSamples))
    assert n == int(perfect.trajectory.t_s[-1] * 50.0)


def test_an_unknown_floor_is_refused(building: Building) -> None:
    with pytest.raises(ValueError, match="floor: found 'F9', expected one of F1"):
        list(simulate_walks(building, "F9", np.random.default_rng(0)))


def test_the_demo_is_a_surveyed_floor_and_walks_of_others(shown: DemoScenario) -> None:
    assert 12 <= len(shown.survey) <= 20
    assert len(shown.walks) == 5
    recordings = [walk.recording for walk in (*shown.survey, *shown.walks)]
    assert len({recording.name for recording in recordings}) == len(recordings)
    assert all(recording.floor == "F1" for recording in recordings)
    assert all(len(walk.recording.truth) > 10 for walk in shown.walks)


def test_demo_recordings_follow_each_other_with_breaks_of_over_a_minute(shown: DemoScenario) -> None:
    walks = (*shown.survey, *shown.walks)
    breaks = [after.t_ns[0] - before.t_ns[-1] for before, after in pairwise(walks)]
    assert min(breaks) > 60e9


def test_settings_are_values() -> None:
    assert replace(Walker(), speed_mps=1.0) == Walker(speed_mps=1.0)
