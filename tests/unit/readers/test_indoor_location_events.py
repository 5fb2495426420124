"""Events carry their measured and their logged time, in the order of the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tickfix.api import TICK_NS, Floor, MotionSamples, ReaderError, Recording, Scan, Truth
from tickfix.readers.indoor_location import IndoorLocationReader, level_from_name

T0 = 1_574_559_495_401
MS = 1_000_000


def read(tmp_path: Path, *lines: str) -> Recording:
    path = tmp_path / "walk.txt"
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    return IndoorLocationReader().read(path)


def acc(ms: int, z: float = 9.8) -> str:
    return f"{ms}\tTYPE_ACCELEROMETER\t0\t0\t{z}\t3"


def wifi(ms: int, bssid: str, heard_ms: int, rssi: int = -50) -> str:
    return f"{ms}\tTYPE_WIFI\tshop\t{bssid}\t{rssi}\t2412\t{heard_ms}"


def test_lines_that_share_a_time_are_one_scan_dated_by_its_newest_reading(tmp_path: Path) -> None:
    recording = read(tmp_path, wifi(T0, "aa", T0 - 900), acc(T0 - 3), wifi(T0, "bb", T0 - 20_000, -70), acc(T0 + 1))
    first, scan, last = recording.events
    assert isinstance(scan, Scan)
    assert isinstance(first, MotionSamples)
    assert isinstance(last, MotionSamples)
    assert scan.transmitters == ("aa", "bb")
    assert scan.rssi_dbm.tolist() == [-50.0, -70.0]
    assert scan.heard_ns.tolist() == [(T0 - 900) * MS, (T0 - 20_000) * MS]
    assert (scan.t_ns, scan.arrival_ns, scan.source) == ((T0 - 900) * MS, T0 * MS, "wifi")
    assert (scan.device, scan.session) == ("walk", "walk")


def test_a_reading_slightly_ahead_of_the_log_was_heard_when_it_was_logged(tmp_path: Path) -> None:
    (scan,) = read(tmp_path, wifi(T0, "aa", T0 + 3)).events
    assert scan.t_ns == T0 * MS


def test_a_beacon_is_a_scan_whose_id_tells_beacons_with_one_uuid_apart(tmp_path: Path) -> None:
    line = f"{T0}\tTYPE_BEACON\t9195B3AD\t0\t0\t-56\t-93\t45.0\tE0:78:A3:3D:B5:D6\t{T0}"
    old = f"{T0 + 1}\tTYPE_BEACON\t9195B3AD\t7\t8\t-56\t-81"
    first, second = read(tmp_path, line, old).events
    assert isinstance(first, Scan)
    assert isinstance(second, Scan)
    assert first.transmitters == ("ble:9195B3AD:0:0:E0:78:A3:3D:B5:D6",)
    assert (first.source, first.t_ns, first.rssi_dbm.tolist()) == ("ble", T0 * MS, [-93.0])
    assert second.transmitters == ("ble:9195B3AD:7:8",)


def test_arrival_is_the_running_maximum_of_the_lines_times(tmp_path: Path) -> None:
    recording = read(tmp_path, acc(T0), wifi(T0 + 700, "aa", T0), acc(T0 + 20), acc(T0 + 900))
    assert [e.arrival_ns // MS - T0 for e in recording.events] == [0, 700, 700, 900]
    assert [e.seq for e in recording.events] == [0, 1, 2, 3]


def test_waypoints_stand_where_they_were_logged_and_are_sorted_as_truth(tmp_path: Path) -> None:
    recording = read(
        tmp_path, acc(T0 + 5000), f"{T0 + 4000}\tTYPE_WAYPOINT\t3\t4", f"{T0}\tTYPE_WAYPOINT\t1\t2", acc(T0 + 5001)
    )
    assert [type(e) for e in recording.events] == [MotionSamples, Truth, Truth, MotionSamples]
    assert [t.t_ns // MS - T0 for t in recording.truth] == [0, 4000]
    assert [t.arrival_ns // MS - T0 for t in recording.truth] == [5000, 5000]
    assert recording.truth[0].xy.tolist() == [1.0, 2.0]


def test_truth_leaves_no_trace_in_the_numbering_of_messages(tmp_path: Path) -> None:
    lines = [acc(T0), wifi(T0 + 50, "aa", T0), acc(T0 + 60)]
    with_truth = read(tmp_path, lines[0], f"{T0}\tTYPE_WAYPOINT\t1\t2", *lines[1:]).events
    assert [e.seq for e in with_truth if not isinstance(e, Truth)] == [e.seq for e in read(tmp_path, *lines).events]


def test_a_batch_never_crosses_a_tick_nor_another_event(tmp_path: Path) -> None:
    lines = [acc(T0 + 10 * i, z=i) for i in range(200)]
    lines.insert(77, wifi(T0 + 763, "aa", T0))
    batches = [e for e in read(tmp_path, *lines).events if isinstance(e, MotionSamples)]
    values = np.concatenate([b.sensors["accelerometer"].values[:, 2] for b in batches])
    assert values.tolist() == list(range(200))
    for batch in batches:
        times = batch.sensors["accelerometer"].t_ns
        assert len(set((-(-times // TICK_NS)).tolist())) == 1
        assert batch.arrival_ns == times[-1]
    assert 20 <= len(batches) <= 22


def test_a_rotation_vector_becomes_a_unit_quaternion(tmp_path: Path) -> None:
    lines = [f"{T0}\tTYPE_ROTATION_VECTOR\t0.1\t-0.2\t0.3\t3", f"{T0 + 1}\tTYPE_ROTATION_VECTOR\t0\t0\t1.0000001\t3"]
    (batch,) = read(tmp_path, *lines).events
    assert isinstance(batch, MotionSamples)
    q = batch.sensors["rotation_vector"].values
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-15)
    np.testing.assert_allclose(q[0], [0.1, -0.2, 0.3, np.sqrt(1 - 0.14)])
    assert q[1].tolist() == [0.0, 0.0, 1.0, 0.0]


GEOJSON = """{"type": "FeatureCollection", "features": [
{"type": "Feature", "properties": {}, "geometry": {"type": "MultiPolygon", "coordinates": [
  [[[10, 50], [12, 50], [12, 51], [10, 51], [10, 50]], [[11, 50.5], [11.5, 50.5], [11.5, 50.75], [11, 50.5]]]]}},
{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates":
  [[[10, 50], [10.5, 50], [10.5, 50.5], [10, 50]]]}},
{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates":
  [[[11, 50], [12, 50], [12, 50.4], [11, 50.4], [11, 50]],
   [[11.2, 50.1], [11.8, 50.1], [11.8, 50.3], [11.2, 50.3], [11.2, 50.1]]]}}
]}"""


def floor_folder(tmp_path: Path, info: str | None, plan: str | None, name: str = "B1") -> Path:
    folder = tmp_path / name
    (folder / "path_data_files").mkdir(parents=True)
    (folder / "path_data_files" / "walk.txt").write_text(acc(T0) + "\n", encoding="utf-8")
    if info is not None:
        (folder / "floor_info.json").write_text(info, encoding="utf-8")
    if plan is not None:
        (folder / "geojson_map.json").write_text(plan, encoding="utf-8")
    return folder / "path_data_files" / "walk.txt"


INFO = '{"map_info": {"height": 40, "width": 100}}'


def test_a_floor_is_in_metres_from_its_south_west_corner(tmp_path: Path) -> None:
    floor = IndoorLocationReader().floor(floor_folder(tmp_path, INFO, GEOJSON))
    assert isinstance(floor, Floor)
    assert (floor.name, floor.level, floor.width_m, floor.height_m) == ("B1", -1, 100.0, 40.0)
    np.testing.assert_allclose(floor.outline[0], [[0, 0], [100, 0], [100, 40], [0, 40]], atol=1e-9)
    np.testing.assert_allclose(floor.outline[1], [[50, 20], [75, 20], [75, 30]], atol=1e-9)
    np.testing.assert_allclose(floor.obstacles[0], [[0, 0], [25, 0], [25, 20]], atol=1e-9)


def test_an_obstacle_with_a_hole_is_cut_into_rings_that_leave_the_hole_free(tmp_path: Path) -> None:
    floor = IndoorLocationReader().floor(floor_folder(tmp_path, INFO, GEOJSON))
    assert floor is not None
    rings = [np.concatenate([ring, ring[:1]]) for ring in floor.obstacles[1:]]
    area = sum(abs(np.sum(r[:-1, 0] * r[1:, 1] - r[1:, 0] * r[:-1, 1])) / 2 for r in rings)
    assert area == pytest.approx(50 * 16 - 30 * 8)


@pytest.mark.parametrize(
    ("info", "plan", "named"),
    [
        ("{", GEOJSON, "floor_info.json"),
        ('{"map_info": {"height": -1, "width": 5}}', GEOJSON, "floor_info.json"),
        ("{}", GEOJSON, "floor_info.json"),
        (INFO, "[", "geojson_map.json"),
        (INFO, "[]", "geojson_map.json"),
        (INFO, '{"features": []}', "geojson_map.json"),
        (INFO, '{"features": [{"geometry": {"type": "Point", "coordinates": [1, 2]}}]}', "geojson_map.json"),
    ],
)
def test_a_broken_plan_is_an_error_that_names_the_file(tmp_path: Path, info: str, plan: str, named: str) -> None:
    with pytest.raises(ReaderError, match=named):
        IndoorLocationReader().floor(floor_folder(tmp_path, info, plan))


def test_a_missing_plan_is_no_floor_and_a_missing_part_a_floor_without_geometry(tmp_path: Path) -> None:
    reader = IndoorLocationReader()
    assert reader.floor(floor_folder(tmp_path / "a", None, None)) is None
    for place, info, plan in (("b", INFO, None), ("c", None, GEOJSON)):
        floor = reader.floor(floor_folder(tmp_path / place, info, plan))
        assert floor is not None
        assert floor.outline == ()


def test_recordings_are_found_in_a_file_a_floor_and_a_building(tmp_path: Path) -> None:
    walk = floor_folder(tmp_path / "site", INFO, GEOJSON)
    other = floor_folder(tmp_path / "site", None, None, name="F2")
    (tmp_path / "site" / "notes.txt").write_text("bring tea\n", encoding="utf-8")
    reader = IndoorLocationReader()
    assert list(reader.recordings(walk)) == [walk]
    assert list(reader.recordings(walk.parents[1])) == [walk]
    assert list(reader.recordings(tmp_path / "site")) == [walk, other]
    assert list(reader.recordings(tmp_path / "site" / "notes.txt")) == []
    assert reader.read(other).floor == "F2"


@pytest.mark.parametrize(
    ("name", "level"),
    [("F1", 1), ("B1", -1), ("B12", -12), ("1F", 1), ("L2", 2), ("4", 4), ("2B", -2), ("G", 0), ("BM", 0)],
)
def test_the_level_comes_from_the_floors_name(name: str, level: int) -> None:
    assert level_from_name(name) == level
