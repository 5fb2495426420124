"""Recordings from arrays and files; sites from walks and from tables of fingerprints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import tickfix
from tickfix.api import EventError, MotionSamples, ReaderError, Scan, SiteError, Truth
from tickfix.evaluation.tracks import digest
from tickfix.readers.event_file import write_events
from tickfix.replay.driver import start_at_first_waypoint
from tickfix.simulation import DemoScenario
from tickfix.site import FingerprintTable

RSSI = np.array([[-40.0, -70.0, np.nan], [-70.0, -40.0, -75.0], [np.nan, -75.0, -40.0], [-42.0, -72.0, np.nan]])
PLACES = np.array([[0.0, 0.0], [10.0, 0.0], [5.0, 8.0], [0.0, 0.0]])


def taken_apart(walk: tickfix.Recording) -> tickfix.Recording:
    """Return the walk rebuilt from the arrays that it holds."""
    motion = [event for event in walk.events if isinstance(event, MotionSamples)]

    def sensor(name: str) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[type-arg]
        parts = [event.sensors[name] for event in motion if name in event.sensors]
        return np.concatenate([p.t_ns for p in parts]), np.concatenate([p.values for p in parts])

    names = sorted({name for event in motion for name in event.sensors})
    return tickfix.recording(
        **{name: sensor(name) for name in names},  # type: ignore[arg-type]
        scans=[event for event in walk.events if isinstance(event, Scan)],
        waypoints=walk.truth,
        floor=walk.floor,
        name=walk.name,
    )


def test_a_walk_rebuilt_from_its_arrays_is_tracked_as_well(
    walk: tickfix.Recording, site: tickfix.Site, kalman: tickfix.Track
) -> None:
    again = tickfix.track(taken_apart(walk), site, "kalman")
    assert len(again) == pytest.approx(len(kalman), abs=2)
    assert np.nanmean(again.errors) == pytest.approx(np.nanmean(kalman.errors), abs=0.5)
    final = tickfix.track(taken_apart(walk), site, "kalman", final=True)
    assert np.nanmean(final.errors) == pytest.approx(np.nanmean(kalman.errors), abs=0.5)


def test_seconds_and_nanoseconds_are_told_apart_by_their_type() -> None:
    values = np.tile([0.0, 0.0, 9.81], (4, 1))
    seconds = tickfix.recording(accelerometer=([0.0, 0.1, 0.2, 0.3], values), waypoints=[(0.25, 1, 2, "F2")])
    integers = tickfix.recording(
        accelerometer=(np.array([0, 1, 2, 3]) * 100_000_000, values), waypoints=[(250_000_000, 1.0, 2.0)], floor="F2"
    )
    table = tickfix.recording(accelerometer=np.column_stack([[0.0, 0.1, 0.2, 0.3], values]))
    for walk in (seconds, integers, table):
        motion = [event for event in walk.events if isinstance(event, MotionSamples)]
        assert [event.sensors["accelerometer"].t_ns.tolist() for event in motion] == [
            [0],
            [100_000_000, 200_000_000],
            [300_000_000],
        ]
    for walk in (seconds, integers):
        assert (walk.truth[0].t_ns, walk.truth[0].floor, walk.truth[0].xy.tolist()) == (250_000_000, "F2", [1.0, 2.0])
    start = start_at_first_waypoint(seconds)
    assert start is not None
    assert start.floor == "F2"


def test_events_are_numbered_in_the_order_of_their_arrival_with_truth_last() -> None:
    walk = tickfix.recording(
        pressure=([0.0, 1.0], [1013.0, 1012.9]), scans=[(0.5, {"ap": -60.0})], waypoints=[(0.2, 0.0, 0.0)], floor="F1"
    )
    assert [(type(e).__name__, e.seq) for e in walk.events] == [
        ("MotionSamples", 0),
        ("Truth", 3),
        ("Scan", 1),
        ("MotionSamples", 2),
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"accelerometer": np.zeros((3, 3))}, r"accelerometer: found shape \(3, 3\), expected \(n, 4\)"),
        ({"gyroscope": ([0.0, 1.0], np.zeros((3, 3)))}, r"gyroscope: found times \(2,\) and values \(3, 3\)"),
        ({"magnetometer": ([1.0, 0.0], np.zeros((2, 3)))}, "magnetometer: found a smaller time at index 1"),
        ({"waypoints": [(0.0, 1.0)]}, "waypoints: found 2 columns"),
    ],
)
def test_wrong_shapes_are_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(EventError, match=message):
        tickfix.recording(**arguments)  # type: ignore[arg-type]


def test_reading_one_file_and_a_folder(office: DemoScenario, tmp_path: Path) -> None:
    for walk in office.walks[:2]:
        write_events(tmp_path / f"{walk.recording.name}.events", walk.recording.events)
    first = tickfix.read(tmp_path / f"{office.walks[0].recording.name}.events")
    assert len(first.events) == len(office.walks[0].recording.events)
    assert [walk.name for walk in tickfix.read_all(tmp_path)] == [walk.recording.name for walk in office.walks[:2]]
    assert len(tickfix.read_all([tmp_path, tmp_path])) == 2
    with pytest.raises(ReaderError, match="found 2 recordings, expected one"):
        tickfix.read(tmp_path)
    with pytest.raises(ReaderError, match="no such file"):
        tickfix.read(tmp_path / "missing.txt")


def test_a_survey_of_files_is_that_of_the_recordings(office: DemoScenario, tmp_path: Path) -> None:
    walks = [walk.recording for walk in office.survey[:6]]
    for walk in walks:
        write_events(tmp_path / f"{walk.name}.events", walk.events)
    from_files = tickfix.survey(tmp_path, holdout=0.5, pipelines="wifi")
    from_memory = tickfix.survey(walks, holdout=0.5, pipelines="wifi")
    assert from_files.name == tmp_path.name
    assert [held.walk for held in from_files.held_out] == [held.walk for held in from_memory.held_out] != []
    assert from_files.radio_map.sample_rssi_dbm.tolist() == from_memory.radio_map.sample_rssi_dbm.tolist()
    assert list(from_files.models) == list(from_memory.models) != []
    track = tickfix.track(tickfix.read(from_files.held_out[0].file()), from_files, "wifi")
    assert np.isfinite(track.errors).any()


def test_a_table_becomes_a_radio_map_with_a_point_per_place() -> None:
    radio_map = FingerprintTable.of(RSSI, PLACES, transmitters=["c", "a", "b"]).radio_map()
    assert radio_map.transmitters == ("a", "b", "c")
    assert len(radio_map) == 3
    means = dict(zip(map(tuple, radio_map.point_xy.tolist()), radio_map.mean_matrix().tolist(), strict=True))
    assert means[0.0, 0.0] == pytest.approx([-71.0, np.nan, -41.0], nan_ok=True)
    assert means[5.0, 8.0] == pytest.approx([-75.0, -40.0, np.nan], nan_ok=True)


def test_arrays_frames_and_csv_files_give_one_table(tmp_path: Path) -> None:
    ids = ["aa:01", "aa:02", "aa:03"]
    arrays = FingerprintTable.of(RSSI, PLACES, floors="F2", transmitters=ids, groups=[0, 0, 1, 1])
    frame = pd.DataFrame(RSSI, columns=ids).assign(
        x_m=PLACES[:, 0], y_m=PLACES[:, 1], floor="F2", group=[7, 7, 9, 9], phone="x"
    )
    frame.to_csv(tmp_path / "points.csv", index=False)
    tables = [
        FingerprintTable.from_frame(frame, ignore=["phone"]),
        FingerprintTable.read_csv(tmp_path / "points.csv", ignore=["phone"]),
    ]
    for table in tables:
        assert (table.transmitters, table.floors) == (arrays.transmitters, arrays.floors)
        assert np.array_equal(table.rssi_dbm, RSSI, equal_nan=True)
        assert table.xy.tolist() == PLACES.tolist()
        assert table.groups.tolist() == [0, 0, 1, 1]


def test_a_table_in_other_words_is_understood(tmp_path: Path) -> None:
    """The columns of UJIIndoorLoc [torres2014]: 100 where nothing was heard."""
    file = tmp_path / "uji.csv"
    file.write_text(
        "WAP001,WAP002,LONGITUDE,LATITUDE,FLOOR,USERID\n-61,100,1.5,2.5,0,3\n100,-70,3.0,2.5,1,3\n", "utf-8"
    )
    site = tickfix.site_from_fingerprints(
        file, x="LONGITUDE", y="LATITUDE", floor="FLOOR", ignore=["USERID"], not_heard=100, pipelines="wifi"
    )
    assert site.radio_map.transmitters == ("WAP001", "WAP002")
    assert [floor.name for floor in site.floors] == ["0", "1"]
    assert site.radio_map.sample_rssi_dbm.tolist() == [-61.0, -70.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x_m,y_m,a\n", "found 1 lines"),
        ("x_m,y_m,a\n1,2\n", "line 2 has 2 cells, expected 3"),
        ("x,y,a\n1,2,-40\n", "no column 'x_m' among x, y, a"),
        ("x_m,y_m,a\n1,2,loud\n", "column 'a' holds no numbers"),
        ("x_m,y_m,a\n1,,-40\n", r"row 0 has the place \[1.0, nan\]"),
        ("x_m,y_m,a,a\n1,2,-40,-50\n", "a column stands twice"),
        ("x_m,y_m,a\n1,2,\n", "no reading in 1 rows"),
    ],
)
def test_a_broken_table_is_refused(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "points.csv"
    file.write_text(text, "utf-8")
    with pytest.raises(SiteError, match=message):
        FingerprintTable.read_csv(file).radio_map()


def test_a_site_of_fingerprints_tracks_a_walk(walk: tickfix.Recording, site: tickfix.Site) -> None:
    of_points = tickfix.site_from_fingerprints(site.radio_map, pipelines="wifi")
    track = tickfix.track(walk, of_points, "wifi")
    assert np.nanmedian(track.errors) < 5.0


def test_truth_is_not_tracked_with(walk: tickfix.Recording, site: tickfix.Site) -> None:
    blind = tickfix.Recording(
        name=walk.name, floor=walk.floor, events=tuple(e for e in walk.events if not isinstance(e, Truth))
    )
    assert digest(tickfix.track(blind, site, "wifi")) == digest(tickfix.track(walk, site, "wifi"))
