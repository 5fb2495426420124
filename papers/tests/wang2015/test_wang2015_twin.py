"""The twin of [wang2015]: what the text prints of its site is so."""

from __future__ import annotations

import numpy as np
import pytest

from tickfix.api import TICK_NS, Context, Scan
from tickfix_fingerprint.topology_knn import derive_topology
from tickfix_maps.regions import Regions, RegionsParams
from tickfix_papers.wang2015 import twin
from tickfix_papers.wang2015.twin import FIX_S, Twin, draw_twin, stand_at_points


@pytest.fixture(scope="module")
def drawn() -> Twin:
    return draw_twin(77)


def test_people_points_and_access_points_are_in_corridors_and_hall_and_no_room_is_free() -> None:
    effective = Regions(RegionsParams(), Context(floor=twin.floor_plan()))
    assert effective.contains(twin.reference_points()).all()
    aps = np.array([ap.xy for ap in twin.access_points()])
    assert len(aps) == 60
    assert effective.contains(aps).all()
    assert not effective.contains(np.array([[30.0, 3.0], [30.0, 28.0], [12.0, 15.0], [45.0, 15.0]])).any()


def test_corridors_are_lines_of_points_and_the_hall_a_lattice() -> None:
    xy = twin.reference_points()
    gsss = derive_topology(xy, np.zeros(len(xy), np.int64), 100.0).gsss
    hall = (np.abs(xy[:, 0] - 28.2) < 4.0) & (np.abs(xy[:, 1] - 15.7) < 6.5)
    assert hall.sum() == 12
    assert gsss[hall].min() > 2
    far = np.abs(xy[:, 0] - 28.2) > 7.0
    straight = far & (np.abs(xy[:, 0] - 1.2) > 4.0) & (np.abs(xy[:, 0] - 58.2) > 4.0)
    assert set(gsss[straight].tolist()) == {2}


def test_about_ten_access_points_are_heard_at_a_reference_point() -> None:
    building = twin.draw_building(np.random.default_rng(1))
    points = twin.reference_points()
    radio_map = stand_at_points(building, points, np.random.default_rng(2))
    assert len(radio_map) == len(points)
    assert 8.0 < len(radio_map.sample_point) / (8 * len(points)) < 12.0


def test_the_walk_is_scanned_every_two_seconds_and_lasts_past_the_last_gross_error(drawn: Twin) -> None:
    begin_ns = int(drawn.walk.t_ns[0])
    scans = [event for event in drawn.walk.recording.events if isinstance(event, Scan)]
    epochs_ns = begin_ns + round(FIX_S * 1e9) * np.arange(1, len(scans) + 1)
    early_ns = epochs_ns - np.array([scan.t_ns for scan in scans])
    assert early_ns.min() >= 0
    assert early_ns.max() < TICK_NS
    assert FIX_S * len(scans) > 90.0


def test_the_same_seed_walks_the_same_walk(drawn: Twin) -> None:
    again = draw_twin(77)
    np.testing.assert_array_equal(again.walk.trajectory.xy, drawn.walk.trajectory.xy)
    np.testing.assert_array_equal(again.radio_map.sample_rssi_dbm, drawn.radio_map.sample_rssi_dbm)


def test_the_radio_map_holds_nothing_of_the_calibration_walks(drawn: Twin) -> None:
    assert len(drawn.calibration) == 3
    assert drawn.radio_map.sample_t_ns.max() < min(int(walk.t_ns[0]) for walk in drawn.calibration)
