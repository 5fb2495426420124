"""Sinks: estimates into files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pluggy
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tickfix.api import API_VERSION, Belief, Component, Estimate, Status, hooks
from tickfix.sinks import plugin
from tickfix.sinks.file_sinks import GeoJsonSink, JsonLinesSink

BELIEF = Belief(
    floor="F1",
    xy=np.array([0.1 + 0.2, -2.0]),
    covariance=np.array([[4.0, 0.5], [0.5, 1.0]]),
    floor_probabilities=(("F1", 0.75), ("F2", 0.25)),
    mixture=(Component(weight=1.0, floor="F1", xy=np.array([1.0, 2.0]), covariance=np.eye(2)),),
    speed_mps=1.25,
)
ESTIMATE = Estimate(
    device="phone",
    pipeline="fusion",
    epoch=0,
    tick=1,
    t_ns=200_000_000,
    status=Status.TRACKING,
    belief=BELIEF,
    motion_age_ns=5,
    reasons=("recovered",),
)
WAITING = replace(ESTIMATE, status=Status.INITIALISING, belief=None)


def at(tick: int, x: float, **changes: Any) -> Estimate:
    belief = replace(BELIEF, xy=np.array([x, 0.0]), floor=changes.pop("floor", "F1"))
    return replace(ESTIMATE, tick=tick, belief=belief, **changes)


def strictly(text: str) -> Any:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def lines(path: Path, estimates: Sequence[Estimate]) -> list[Any]:
    with JsonLinesSink(path) as sink:
        for estimate in estimates:
            sink.write(estimate)
    return [strictly(line) for line in path.read_text(encoding="utf-8").splitlines()]


def features(path: Path, estimates: Sequence[Estimate], geometry: str) -> list[Any]:
    with GeoJsonSink(path) as sink:
        for estimate in estimates:
            sink.write(estimate)
    document = strictly(path.read_text(encoding="utf-8"))
    assert document["type"] == "FeatureCollection"
    assert document["coordinate_reference"]["unit"] == "metre"
    return [f for f in document["features"] if f["geometry"]["type"] == geometry]


def test_a_line_says_all_that_the_estimate_says(tmp_path: Path) -> None:
    assert lines(tmp_path / "out.jsonl", [ESTIMATE]) == [
        {
            "device": "phone",
            "pipeline": "fusion",
            "epoch": 0,
            "tick": 1,
            "t_ns": 200_000_000,
            "revision": 0,
            "status": "tracking",
            "motion_age_ns": 5,
            "observation_age_ns": None,
            "innovation_m": None,
            "nis": None,
            "failed_by": "",
            "reasons": ["recovered"],
            "floor": "F1",
            "x_m": 0.30000000000000004,
            "y_m": -2.0,
            "covariance_m2": [[4.0, 0.5], [0.5, 1.0]],
            "floor_probabilities": {"F1": 0.75, "F2": 0.25},
            "mixture": [{"weight": 1.0, "floor": "F1", "x_m": 1.0, "y_m": 2.0, "covariance_m2": [[1, 0], [0, 1]]}],
            "speed_mps": 1.25,
            "heading_rad": None,
        }
    ]


def test_diagnostics_are_written_where_there_are_some(tmp_path: Path) -> None:
    told, plain = lines(tmp_path / "out.jsonl", [replace(ESTIMATE, diagnostics={"ess": 81.5}), ESTIMATE])
    assert told == plain | {"diagnostics": {"ess": 81.5}}


def test_a_line_without_belief_has_the_same_keys(tmp_path: Path) -> None:
    with_belief, without = lines(tmp_path / "out.jsonl", [ESTIMATE, WAITING])
    assert list(with_belief) == list(without)
    assert without["x_m"] is None


def test_certainty_about_the_floor_is_written_out(tmp_path: Path) -> None:
    certain = replace(ESTIMATE, belief=replace(BELIEF, floor_probabilities=()))
    assert lines(tmp_path / "out.jsonl", [certain])[0]["floor_probabilities"] == {"F1": 1.0}


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50)
@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(allow_nan=False, allow_infinity=False))
def test_floats_are_written_in_full(tmp_path: Path, x: float, nis: float) -> None:
    line = lines(tmp_path / "out.jsonl", [replace(at(1, x), nis=nis)])[0]
    assert np.array([line["x_m"], line["nis"]]).tobytes() == np.array([x, nis]).tobytes()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_never_reach_json(tmp_path: Path, bad: float) -> None:
    belief = replace(BELIEF, covariance=np.full((2, 2), bad), floor_probabilities=(("F1", bad),), speed_mps=bad)
    odd = replace(ESTIMATE, belief=belief, nis=np.float64(bad))
    line = lines(tmp_path / "out.jsonl", [odd, at(2, bad)])
    assert line[0]["nis"] is None
    assert line[0]["covariance_m2"] == [[None, None], [None, None]]
    assert line[1]["x_m"] is None
    points = features(tmp_path / "out.geojson", [odd, at(2, bad)], "Point")
    assert len(points) == 1


def test_numpy_scalars_are_written_as_numbers(tmp_path: Path) -> None:
    odd = replace(ESTIMATE, nis=np.float64(1.5), tick=np.int64(7))  # type: ignore[arg-type]
    assert lines(tmp_path / "out.jsonl", [odd])[0]["tick"] == 7


def test_a_collection_has_a_point_for_each_position_and_one_way_for_each_device_and_pipeline(tmp_path: Path) -> None:
    estimates = [WAITING, at(2, 1.0), at(2, 9.0, pipeline="wifi"), at(3, 2.0), at(3, 8.0, pipeline="wifi")]
    points = features(tmp_path / "a.geojson", estimates, "Point")
    assert [p["geometry"]["coordinates"] for p in points] == [[1.0, 0.0], [9.0, 0.0], [2.0, 0.0], [8.0, 0.0]]
    assert points[0]["properties"]["covariance_m2"] == [[4.0, 0.5], [0.5, 1.0]]
    ways = features(tmp_path / "a.geojson", estimates, "LineString")
    assert [(w["properties"]["pipeline"], w["geometry"]["coordinates"]) for w in ways] == [
        ("fusion", [[1.0, 0.0], [2.0, 0.0]]),
        ("wifi", [[9.0, 0.0], [8.0, 0.0]]),
    ]


def test_the_way_goes_through_the_newest_revision_of_each_tick(tmp_path: Path) -> None:
    estimates = [at(1, 1.0), at(2, 2.0), at(1, 5.0, revision=2), at(1, 4.0, revision=1)]
    assert len(features(tmp_path / "a.json", estimates, "Point")) == 4
    (way,) = features(tmp_path / "a.json", estimates, "LineString")
    assert way["geometry"]["coordinates"] == [[5.0, 0.0], [2.0, 0.0]]


def test_no_way_leads_from_one_floor_to_another_nor_over_a_restart_of_the_clock(tmp_path: Path) -> None:
    floors = ["F1", "F1", "F2", "F2", "F1", "F1"]
    estimates = [at(k, float(k), floor=floor) for k, floor in enumerate(floors)] + [at(0, 9.0, epoch=1)]
    ways = features(tmp_path / "a.geojson", estimates, "LineString")
    assert [w["properties"]["floor"] for w in ways] == ["F1", "F2", "F1"]


def test_a_collection_of_nothing_is_a_collection(tmp_path: Path) -> None:
    assert features(tmp_path / "a.geojson", [], "Point") == []


@pytest.mark.parametrize("sink_type", [JsonLinesSink, GeoJsonSink])
def test_an_interrupted_run_leaves_the_file_as_it_was(tmp_path: Path, sink_type: Any) -> None:
    path = tmp_path / f"out{sink_type.suffixes[0]}"
    path.write_text("before", encoding="utf-8")

    def interrupted() -> None:
        with sink_type(path) as sink:
            sink.write(ESTIMATE)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text(encoding="utf-8") == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_the_file_appears_when_the_sink_is_closed_and_closing_again_does_nothing(tmp_path: Path) -> None:
    path = tmp_path / "new folder" / "out.jsonl"
    sink = JsonLinesSink(path)
    sink.write(ESTIMATE)
    assert not path.exists()
    sink.close()
    sink.close()
    assert list(path.parent.iterdir()) == [path]


def test_a_sink_that_cannot_take_its_place_leaves_nothing_behind(tmp_path: Path) -> None:
    path = tmp_path / "out.jsonl"
    sink = JsonLinesSink(path)
    path.mkdir()
    with pytest.raises(OSError, match=r"out\.jsonl"):
        sink.close()
    assert list(tmp_path.iterdir()) == [path]


def test_the_plugin_offers_both_sinks_with_endings_of_their_own() -> None:
    manager = pluggy.PluginManager("tickfix")
    manager.add_hookspecs(hooks)
    manager.register(plugin)
    manager.check_pending()
    (sinks,) = manager.hook.tickfix_register()
    assert [(sink.kind, sink.name) for sink in sinks] == [("sink", "json-lines"), ("sink", "geojson")]
    assert sorted(suffix for sink in sinks for suffix in sink.suffixes) == [".geojson", ".json", ".jsonl", ".ndjson"]
    assert plugin.TICKFIX_API == API_VERSION
