"""Tracks from Python: the same bits as the command line's, in every shape, and from one's own event loop."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import tickfix
from tickfix.api import TICK_NS, Belief, Estimate, Event, Fix, PluginError, Status, Truth
from tickfix.config import load_config
from tickfix.evaluation.tracks import TRACK_DTYPE, digest
from tickfix.evaluation.walk_runs import WalkOptions, prepare, run_walk
from tickfix.registry import discover
from tickfix.sinks.file_sinks import GeoJsonSink
from tickfix.workflow.pipelines import resolve_pipeline


def test_a_track_is_what_the_command_line_replays(
    walk: tickfix.Recording, site: tickfix.Site, kalman: tickfix.Track
) -> None:
    run = run_walk(prepare(site, load_config(None, discover()).only(["kalman"])), WalkOptions(), walk)
    assert digest(kalman) == run.result.published["kalman"]
    assert digest(tickfix.track(walk, site, "kalman", final=True)) == run.result.settled["kalman"]
    assert np.array_equal(kalman.errors, run.result.score.pipelines["kalman"].error_m, equal_nan=True)
    assert digest(tickfix.track_all(walk, site)["kalman"]) == digest(kalman)


def test_a_site_may_be_a_folder(
    walk: tickfix.Recording, site: tickfix.Site, kalman: tickfix.Track, tmp_path: Path
) -> None:
    site.save(tmp_path / "office.site")
    assert digest(tickfix.track(walk, tmp_path / "office.site", "kalman")) == digest(kalman)
    assert tickfix.Site.load(str(tmp_path / "office.site")).name == "office"


def test_a_known_start_begins_there(walk: tickfix.Recording, site: tickfix.Site) -> None:
    track = tickfix.track(walk, site, "pdr", start="first-waypoint")
    assert np.hypot(*(track.estimates[0].belief.xy - walk.truth[0].xy)) < 2.0  # type: ignore[union-attr]
    far = Fix(t_ns=walk.truth[0].t_ns, floor="F1", xy=np.array([40.0, 20.0]), covariance=0.01 * np.eye(2))
    moved = tickfix.track(walk, site, "pdr", start=far)
    assert np.hypot(*(moved.estimates[0].belief.xy - far.xy)) < 2.0  # type: ignore[union-attr]


def test_its_array_holds_the_estimates(kalman: tickfix.Track) -> None:
    rows = kalman.to_numpy()
    assert rows.dtype.names == TRACK_DTYPE.names
    for row, estimate in zip(rows, kalman, strict=True):
        assert (row["t_ns"], row["status"]) == (estimate.t_ns, estimate.status)
        if estimate.belief is None:
            assert row["floor"] == ""
            assert np.isnan(row["x_m"])
        else:
            assert row["floor"] == estimate.belief.floor
            assert (row["x_m"], row["y_m"]) == tuple(estimate.belief.xy)
            assert row["cov_xy_m2"] == estimate.belief.covariance[0, 1]
            assert row["var_y_m2"] == estimate.belief.covariance[1, 1]


def test_its_frame_is_indexed_by_time(kalman: tickfix.Track) -> None:
    frame = kalman.to_pandas()
    assert len(frame) == len(kalman)
    assert frame.index[0] == pd.Timestamp(kalman.estimates[0].t_ns, unit="ns", tz="UTC")
    assert frame["x_m"].dtype == np.float64
    assert (frame.index.to_series().diff().dropna() == pd.Timedelta(TICK_NS, unit="ns")).all()


def test_without_pandas_the_extra_is_named(kalman: tickfix.Track, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(ImportError, match=re.escape("pip install 'tickfix[pandas]'")):
        kalman.to_pandas()


def test_its_geojson_is_that_of_the_sink(kalman: tickfix.Track, tmp_path: Path) -> None:
    with GeoJsonSink(tmp_path / "sink.geojson") as sink:
        for estimate in kalman:
            sink.write(estimate)
    collection = kalman.to_geojson(tmp_path / "track.geojson")
    assert (tmp_path / "track.geojson").read_bytes() == (tmp_path / "sink.geojson").read_bytes()
    assert collection == json.loads((tmp_path / "sink.geojson").read_bytes())
    assert collection["features"][-1]["geometry"]["type"] == "LineString"


def test_it_draws_itself(kalman: tickfix.Track, tmp_path: Path) -> None:
    figure = kalman.plot(tmp_path / "track.svg")
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert "kalman" in (tmp_path / "track.svg").read_text("utf-8")
    shown = kalman._repr_html_()
    assert "data:image/png;base64," in shown
    assert "waypoints, median error" in shown
    with pytest.raises(ValueError, match="floor: found 'F9', expected one of F1"):
        kalman.plot(floor="F9")


def test_its_errors_are_distances_from_the_waypoints() -> None:
    belief = Belief(floor="F1", xy=np.array([3.0, 4.0]), covariance=np.eye(2))
    estimate = Estimate(
        device="d", pipeline="p", epoch=0, tick=5, t_ns=5 * TICK_NS, status=Status.TRACKING, belief=belief
    )
    truth = (
        Truth(t_ns=6 * TICK_NS, floor="F1", xy=np.zeros(2)),
        Truth(t_ns=TICK_NS, floor="F1", xy=np.zeros(2)),
    )
    track = replace(tickfix.Track.of("p", "d", [(estimate, 5 * TICK_NS)]), truth=truth)
    assert np.array_equal(track.errors, [np.nan, 5.0], equal_nan=True)
    assert "1 of 2 waypoints, median error 5.00 m" in repr(track)


async def collect(estimates: AsyncIterator[Estimate]) -> list[Estimate]:
    return [estimate async for estimate in estimates]


def test_the_engine_publishes_the_bits_of_the_track(
    walk: tickfix.Recording, site: tickfix.Site, kalman: tickfix.Track
) -> None:
    assert digest(asyncio.run(collect(tickfix.Engine(site, "kalman").run(walk.events)))) == digest(kalman)


def test_the_engine_takes_an_asynchronous_source_and_several_devices(
    walk: tickfix.Recording, site: tickfix.Site, kalman: tickfix.Track
) -> None:
    async def source() -> AsyncIterator[Event]:
        for event in walk.events:
            for device in ("a", "b"):
                await asyncio.sleep(0)
                yield replace(event, device=device)

    engine = tickfix.Engine(site, "wifi")
    estimates = asyncio.run(collect(engine.run(source())))
    positions = {
        device: [e.belief.xy.tolist() for e in estimates if e.device == device and e.belief is not None]
        for device in ("a", "b")
    }
    assert positions["a"] == positions["b"]
    assert len(positions["a"]) > 100
    assert engine.devices == ()


def test_other_tasks_of_the_loop_run_between_events(walk: tickfix.Recording, site: tickfix.Site) -> None:
    async def both() -> int:
        turns, done = 0, False

        async def count() -> None:
            nonlocal turns
            while not done:
                turns += 1
                await asyncio.sleep(0)

        other = asyncio.create_task(count())
        await collect(tickfix.Engine(site, "wifi").run(walk.events[:200]))
        done = True
        await other
        return turns

    assert asyncio.run(both()) >= 200


def test_revisions_come_only_when_wished_for(walk: tickfix.Recording, site: tickfix.Site) -> None:
    late = [e for e in walk.events if not isinstance(e, Truth)]
    scan = next(i for i, e in enumerate(late) if i > 100 and type(e).__name__ == "Scan")
    late.insert(scan + 40, late.pop(scan))
    plain = asyncio.run(collect(tickfix.Engine(site, "wifi").run(late)))
    revised = asyncio.run(collect(tickfix.Engine(site, "wifi").run(late, revisions=True)))
    assert {e.revision for e in plain} == {0}
    assert max(e.revision for e in revised) > 0
    assert [e for e in revised if e.revision == 0] != []


def test_ticks_can_be_closed_without_data(walk: tickfix.Recording, site: tickfix.Site) -> None:
    engine = tickfix.Engine(site, "wifi")
    told = [e for e in walk.events if not isinstance(e, Truth)][:50]
    for event in told:
        engine.feed(event)
    later_ns = told[-1].t_ns + 3_000_000_000
    closed = engine.advance(walk.name, later_ns)
    assert closed[-1].tick == later_ns // TICK_NS


def test_a_stage_that_fails_is_counted_or_raised(walk: tickfix.Recording, site: tickfix.Site) -> None:
    fixes = resolve_pipeline({"fingerprint": "wknn", "filter": "fixes"}).pipelines[0].filter.offer.cls

    class Broken(fixes):  # type: ignore[misc, valid-type]
        name = "broken"

        def estimate(self, state: Any) -> Belief:
            raise ZeroDivisionError("by hand")

    pipeline = {"fingerprint": "wknn", "filter": Broken}
    with pytest.warns(tickfix.TickfixWarning, match=r"filter 'broken': ZeroDivisionError \(\d+ ×\)"):
        tickfix.track(walk, site, pipeline)
    with pytest.raises(PluginError, match="by hand"):
        tickfix.track(walk, site, pipeline, strict=True)


def test_an_untrained_algorithm_is_named(walk: tickfix.Recording, site: tickfix.Site) -> None:
    with pytest.warns(tickfix.TickfixWarning, match="fingerprint:wknn: site 'office' has no model"):
        tickfix.track(walk, site, {"fingerprint": {"use": "wknn", "k": 9}, "filter": "fixes"})
