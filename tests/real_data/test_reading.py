"""Every real recording is read without rejects and surveyed into a site that comes back from disk."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from tickfix.api import MotionSamples, Scan
from tickfix.readers.indoor_location import IndoorLocationReader
from tickfix.site import load_site, save_site
from tickfix.site.survey_builder import read_floor_plans, survey_recordings


@pytest.mark.parametrize(
    ("name", "walks", "waypoints", "wifi_scans", "level", "height_m", "held_out"),
    [("F1", 106, 742, 1689, 1, 176.44, 25), ("F2", 102, 699, 1563, 2, 176.66, 32)],
)
def test_a_floor_of_the_mall_is_read_and_surveyed(
    data_dir: Path,
    tmp_path: Path,
    name: str,
    walks: int,
    waypoints: int,
    wifi_scans: int,
    level: int,
    height_m: float,
    held_out: int,
) -> None:
    reader = IndoorLocationReader()
    folder = data_dir / "indoor-location-20" / "site1" / name
    recordings = [reader.read(path) for path in reader.recordings(folder)]
    assert len(recordings) == walks
    assert sum(len(recording.truth) for recording in recordings) == waypoints
    counts: Counter[str] = Counter()
    for recording in recordings:
        assert recording.rejected == {}
        assert recording.floor == name
        arrivals = [event.arrival_ns for event in recording.events]
        assert arrivals == sorted(arrivals)
        samples: Counter[str] = Counter()
        for event in recording.events:
            if isinstance(event, MotionSamples):
                samples.update({sensor: len(one) for sensor, one in event.sensors.items()})
            elif isinstance(event, Scan):
                counts[event.source] += 1
                assert (event.rssi_dbm < 0).all()
                assert (event.heard_ns <= event.arrival_ns).all()
        duration_s = (recording.truth[-1].t_ns - recording.truth[0].t_ns) / 1e9
        assert set(samples.values()) == {samples["accelerometer"]}
        assert samples.keys() == {"accelerometer", "gyroscope", "magnetometer", "rotation_vector"}
        assert samples["accelerometer"] > 45 * duration_s
    assert counts["wifi"] == wifi_scans

    floors, problems = read_floor_plans(reader, recordings)
    assert problems == ()
    assert floors[0].level == level
    assert floors[0].height_m == pytest.approx(height_m, abs=0.01)
    ring = floors[0].outline[0]
    assert np.concatenate(floors[0].outline).min(axis=0) == pytest.approx([0, 0], abs=1e-6)
    assert len(ring) > 10

    site = survey_recordings(recordings, floors, holdout=0.3).site
    assert len(site.held_out) == held_out
    assert {held.walk for held in site.held_out}.isdisjoint(track.walk for track in site.survey_tracks)
    assert {held.chain for held in site.held_out}.isdisjoint(track.chain for track in site.survey_tracks)
    tracks = {track.walk: track for track in site.survey_tracks}
    assert len(tracks) == walks - held_out
    radio = site.radio_map
    cells = np.floor(radio.point_xy / 2.0)
    assert len(np.unique(cells, axis=0)) == len(radio), "one reference point per cell of 2 m"
    assert (np.floor(radio.sample_xy / 2.0) == cells[radio.sample_point]).all()
    assert (radio.sample_xy >= 0).all()
    assert (radio.sample_xy <= [floors[0].width_m, floors[0].height_m]).all()
    save_site(site, tmp_path / "site")
    again = load_site(tmp_path / "site")
    assert again.radio_map.sample_xy.tobytes() == radio.sample_xy.tobytes()
    assert again.held_out == site.held_out
    assert again.held_out[0].file() == site.held_out[0].path
