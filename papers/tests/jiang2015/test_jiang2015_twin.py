"""The twin of [jiang2015] has what the paper prints; its measures and claims mean what they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tickfix.api import Fix, Scan
from tickfix_papers.jiang2015.claims import METHODS, RATES, WIFI, WINDOWS, decided_claims, result_tables
from tickfix_papers.jiang2015.seed_run import GIVEN_SIGMA_M, SeedRun, TrackErrors, with_given_fixes
from tickfix_papers.jiang2015.twin import Twin, draw_twin, fingerprint_points, floor_plan, route
from tickfix_papers.reproduction_report import Claim


@pytest.fixture(scope="module")
def scene() -> Twin:
    """One draw."""
    return draw_twin(3)


def test_the_room_is_as_large_as_printed() -> None:
    ring = floor_plan().outline[0]
    sides = np.hypot(*(ring - np.roll(ring, 1, axis=0)).T)
    assert sorted(sides) == pytest.approx([8.5, 8.5, 12.0, 12.0])
    assert floor_plan().walls.shape == (4, 2, 2)


def test_there_are_36_points_as_far_apart_as_printed_and_the_route_keeps_inside() -> None:
    points = fingerprint_points()
    assert points.shape == (36, 2)
    apart = np.hypot(*(points[:, None] - points).transpose(2, 0, 1)) + 9.0 * np.eye(36)
    assert apart.min() == pytest.approx(1.5)
    ring = floor_plan().outline[0]
    along = np.roll(ring, -1, axis=0) - ring
    for places in (points, route().xy):
        seen = places[:, None] - ring
        from_wall = (along[:, 0] * seen[..., 1] - along[:, 1] * seen[..., 0]) / np.hypot(*along.T)
        assert from_wall.min() > 0.3


def test_no_straight_of_the_route_goes_due_south() -> None:
    legs = np.diff(route().xy, axis=0)
    headings, length = np.arctan2(*legs.T), np.hypot(*legs.T)
    assert length[np.abs(headings) > np.radians(165.0)].max() < 0.2


def test_the_lessons_are_as_many_as_printed(scene: Twin) -> None:
    walks = scene.training_data.walks
    windows = sum((walk.truth[-1].t_ns - walk.truth[0].t_ns) // 200_000_000 for walk in walks)
    assert len(walks) == 4 * 5
    assert windows == pytest.approx(5316, rel=0.1)
    assert not any(walk.scans for walk in walks)
    rate_hz = np.median(1e9 / np.diff(walks[0].motion.sensors["accelerometer"].t_ns))
    assert rate_hz == pytest.approx(65.0, rel=0.05)
    radio_map = scene.training_data.radio_map
    _, count = np.unique(
        np.column_stack([radio_map.sample_point, radio_map.sample_transmitter]), axis=0, return_counts=True
    )
    assert count.max() == 4
    assert len(radio_map.transmitters) == 12
    assert len(scene.walks) == 4


def test_the_same_seed_gives_the_same_twin(scene: Twin) -> None:
    again = draw_twin(3)
    for a, b in zip((*scene.walks, *scene.walks), (*again.walks, *again.walks), strict=True):
        assert a.trajectory.xy.tobytes() == b.trajectory.xy.tobytes()
    assert (
        again.training_data.radio_map.sample_rssi_dbm.tobytes()
        == scene.training_data.radio_map.sample_rssi_dbm.tobytes()
    )
    assert (
        draw_twin(4).training_data.radio_map.sample_rssi_dbm.tobytes()
        != scene.training_data.radio_map.sample_rssi_dbm.tobytes()
    )


def test_given_fixes_replace_scans_and_err_as_told(scene: Twin) -> None:
    walk = scene.walks[0]
    given = with_given_fixes(walk, 0.5, np.random.default_rng(0))
    scans = [event for event in walk.recording.events if isinstance(event, Scan)]
    fixes = [event for event in given.events if isinstance(event, Fix)]
    assert not any(isinstance(event, Scan) for event in given.events)
    assert [(fix.t_ns, fix.arrival_ns, fix.seq) for fix in fixes] == [(s.t_ns, s.arrival_ns, s.seq) for s in scans]
    far = with_given_fixes(walk, 5.0, np.random.default_rng(0))
    for near, other in zip(fixes, [e for e in far.events if isinstance(e, Fix)], strict=True):
        true = walk.trajectory.xy_at(np.array((near.t_ns - walk.t_ns[0]) * 1e-9))
        assert 10.0 * (near.xy - true) == pytest.approx(other.xy - true)


def track(
    error_m: float, error_growth_m: float = 0.0, update_interval_s: float = 0.2, second_difference_m: float = 0.0
) -> TrackErrors:
    n = 200
    xy = np.column_stack([np.arange(n), 0.5 * second_difference_m * (np.arange(n) % 2)])
    return TrackErrors(
        t_s=0.2 * np.arange(n),
        xy=xy,
        error_m=error_m + error_growth_m * (np.arange(n) // 50 == 3),
        fix_error_m=np.full(20, error_m),
        update_interval_s=update_interval_s,
    )


def runs(
    windows: dict[int, float], errors: dict[str, float], growth: dict[str, float], bends: dict[str, float]
) -> list[SeedRun]:
    """Return three seeds that differ a little."""
    names = {name for row in METHODS.values() for name in row[:2] if name} | set(WIFI.values())
    found = []
    for seed in range(3):
        tracks = {
            name: (track(errors.get(name, 1.0) + 0.01 * seed, growth.get(name, 0.0), 0.2, bends.get(name, 0.0)),)
            for name in names
        }
        tracks[RATES["Wi-Fi alone"][0]] = (
            replace(tracks[RATES["Wi-Fi alone"][0]][0], update_interval_s=2.0 + 0.1 * seed),
        )
        given = {s: {"elm-wifi-pf": s, "own-elm-wifi-pf": s} for s in GIVEN_SIGMA_M}
        mse = {ms: (windows.get(ms, 1.0) ** 2 + 1e-3 * seed, 0.01) for ms in WINDOWS}
        found.append(SeedRun(window_mse=mse, tracks=tracks, given=given, truth=(), failures={}))
    return found


def verdicts(found: list[SeedRun]) -> dict[str, Claim]:
    return {claim.claim: claim for claim in decided_claims(found)}


def test_claims_hold_where_the_figures_say_so() -> None:
    paper = {"gait-pf": 1.5, "elm": 0.6, "own-elm": 0.6, "elm-kf": 0.8, "elm-pf": 0.55, "elm-wifi-pf": 0.15}
    paper |= {"wifi-knn": 3.0, "wifi-elm": 2.5, "wifi-elm-kf": 2.0, "wifi-elm-pf": 1.5}
    found = verdicts(runs({200: 0.3}, paper, {"elm": 0.4}, {"elm": 0.1}))
    failed = [name for name, claim in found.items() if not claim.holds]
    assert failed == ["200 ms is the best window for the orientation"], "all windows are alike there"
    assert all(claim.reason for claim in found.values() if not claim.holds)


def test_claims_fail_where_the_figures_say_so() -> None:
    turned = {"gait-pf": 0.6, "elm": 1.5, "own-elm": 1.5, "elm-kf": 0.8, "elm-pf": 1.6, "elm-wifi-pf": 1.7}
    turned |= {"wifi-knn": 1.5, "wifi-elm": 2.0, "wifi-elm-kf": 2.5, "wifi-elm-pf": 3.0, "own-elm-pf": 0.4}
    found = verdicts(runs({400: 0.3}, turned, {"elm-wifi-pf": 1.0}, {"elm-kf": 0.1}))
    held = [name for name, claim in found.items() if claim.holds]
    assert held == ["Wi-Fi alone gives a position every few seconds", "fused, there is a position every 200 ms"]


def test_tables_have_the_papers_figures_beside_ours() -> None:
    by_name = {table.name: table for table in result_tables(runs({}, {"elm": 0.7}, {}, {}))}
    assert by_name["Table 3"].rows["200 ms"][0].paper == 0.3001
    cell = by_name["Table 4"].rows["ELM"][0]
    assert cell.paper == 0.609
    assert cell.ours is not None
    assert cell.ours.mean == pytest.approx(0.71)
    assert len(by_name["How good Wi-Fi must be"].rows) == len(GIVEN_SIGMA_M)


def test_a_way_bends_by_how_far_it_departs_from_going_on() -> None:
    assert track(1.0).second_difference_m == pytest.approx(0.0)
    assert track(1.0, second_difference_m=0.3).second_difference_m == pytest.approx(0.3)
    assert track(1.0, error_growth_m=0.4).error_growth_m == pytest.approx(0.4)
