"""Scans as phones deliver them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tickfix.api import Recording, Scan
from tickfix.simulation import Building, Receiver, SimulatedWalk, WalkableGrid, random_route, simulate_walk


def scanned(building: Building, grid: WalkableGrid, receiver: Receiver, seed: int = 0) -> SimulatedWalk:
    rng = np.random.default_rng(seed)
    route = random_route(grid, rng, 120.0)
    return simulate_walk(building, route, rng, name="scans", receiver=receiver)


def scans_of(recording: Recording) -> list[Scan]:
    return [event for event in recording.events if isinstance(event, Scan)]


def test_scans_take_from_one_to_four_and_a_half_seconds(building: Building, grid: WalkableGrid) -> None:
    walk = scanned(building, grid, Receiver())
    length = np.array([heard.end_s - heard.begin_s for heard in walk.scans])
    assert len(length) > 20
    assert length.min() >= 1.0 - 1e-9
    assert length.max() <= 4.5 + 1e-9
    assert np.ptp(length) > 2.0


def test_access_points_are_heard_at_their_own_times_within_the_scan(building: Building, grid: WalkableGrid) -> None:
    walk = scanned(building, grid, Receiver(stale_s=0.0))
    for heard in walk.scans:
        assert np.all(heard.heard_s >= heard.begin_s)
        assert np.all(heard.heard_s <= heard.end_s)
    assert np.mean([len(np.unique(heard.heard_s)) / max(1, len(heard.heard_s)) for heard in walk.scans]) > 0.9


def test_scans_arrive_after_their_last_reading(building: Building, grid: WalkableGrid) -> None:
    for event in scans_of(scanned(building, grid, Receiver()).recording):
        assert event.t_ns == event.heard_ns.max()
        assert 0.1e9 <= event.arrival_ns - event.t_ns <= 6e9


def test_an_honest_phone_repeats_nothing(building: Building, grid: WalkableGrid) -> None:
    recording = scanned(building, grid, Receiver(stale_s=0.0)).recording
    heard = [(name, int(t)) for e in scans_of(recording) for name, t in zip(e.transmitters, e.heard_ns, strict=True)]
    assert len(heard) == len(set(heard))


def test_others_repeat_readings_as_they_were_until_they_are_stale(building: Building, grid: WalkableGrid) -> None:
    walk = scanned(building, grid, Receiver(stale_s=8.0, miss=0.3))
    first: dict[tuple[int, float], float] = {}
    repeated, oldest = 0, 0.0
    for heard in walk.scans:
        for ap, t, rssi in zip(heard.access_point.tolist(), heard.heard_s, heard.rssi_dbm, strict=True):
            repeated += (ap, t) in first
            assert first.setdefault((ap, t), rssi) == rssi
            oldest = max(oldest, heard.end_s - t)
    assert repeated > 20
    assert 4.0 < oldest < 8.0


def test_readings_are_whole_decibels_at_or_above_the_sensitivity(building: Building, grid: WalkableGrid) -> None:
    walk = scanned(building, grid, Receiver(sensitivity_dbm=-80.0))
    rssi = np.concatenate([event.rssi_dbm for event in scans_of(walk.recording)])
    assert rssi.min() >= -80.0
    assert np.array_equal(rssi, np.round(rssi))
    deaf = Receiver(sensitivity_dbm=0.0)
    assert sum(map(len, scans_of(scanned(building, grid, deaf).recording))) == 0


def test_gain_shifts_every_reading(building: Building, grid: WalkableGrid) -> None:
    exact = Receiver(sensitivity_dbm=-1000.0, miss=0.0, step_dbm=0.0)
    low, high = (scanned(building, grid, replace(exact, gain_db=gain)).scans for gain in (-3.0, 2.0))
    for a, b in zip(low, high, strict=True):
        assert b.rssi_dbm - a.rssi_dbm == pytest.approx(np.full(len(a.rssi_dbm), 5.0))
