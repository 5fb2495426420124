"""Every sample of the radio map lies where it was heard; what has no place is counted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from surveys import T0, S, scan, walk

from tickfix.api import Floor, Recording, SiteError, Truth, motion_samples
from tickfix.site.survey_builder import survey_recordings

seconds = st.integers(-20_000, 60_000).map(lambda ms: ms / 1000)


@given(
    st.lists(st.tuples(st.integers(1, 9000), st.floats(-50, 50), st.floats(-50, 50)), min_size=2, max_size=6),
    st.lists(st.lists(st.tuples(st.sampled_from("abc"), st.just(-60.0), seconds), min_size=1, max_size=6), max_size=5),
)
def test_each_sample_lies_on_the_polyline_at_the_time_it_was_heard(steps: list, scans: list) -> None:
    times = np.cumsum([step[0] for step in steps]) / 1000
    waypoints = [(t, x, y) for t, (_, x, y) in zip(times.tolist(), steps, strict=True)]
    site = survey_recordings([walk("w", waypoints, [scan(*readings) for readings in scans])], [Floor(name="F1")]).site
    radio = site.radio_map
    for t_ns, xy in zip(radio.sample_t_ns, radio.sample_xy, strict=True):
        (before, a), (after, b) = next(
            (p, q)
            for p, q in zip(
                [(T0 + round(t * S), (x, y)) for t, x, y in waypoints],
                [(T0 + round(t * S), (x, y)) for t, x, y in waypoints][1:],
                strict=False,
            )
            if p[0] <= t_ns <= q[0]
        )
        share = int(t_ns - before) / (after - before)
        np.testing.assert_allclose(xy, (1 - share) * np.array(a) + share * np.array(b), atol=1e-6)
    once = {(name, T0 + round(t * S)) for readings in scans for name, _, t in readings}
    notes = site.notes
    assert notes.get("readings_kept", 0) == len(radio.sample_t_ns)
    assert len(once) == sum(
        notes.get(f"readings_{fate}", 0) for fate in ("kept", "before_first_waypoint", "after_last_waypoint")
    )


def test_a_reading_that_later_scans_repeat_counts_once() -> None:
    scans = [scan(("ap", -50, 2)), scan(("ap", -50, 2), ("other", -60, 4)), scan(("ap", -52, 6))]
    site = survey_recordings([walk("w", [(0, 0, 0), (10, 10, 0)], scans)], [Floor(name="F1")]).site
    assert site.radio_map.sample_rssi_dbm.tolist() == [-50.0, -60.0, -52.0]
    assert site.radio_map.sample_xy[:, 0].tolist() == [2.0, 4.0, 6.0]
    assert site.notes["readings_repeated"] == 1


def test_readings_from_outside_the_walk_are_dropped_and_counted() -> None:
    scans = [scan(("old", -50, -30), ("early", -50, -0.5), ("in", -50, 1)), scan(("late", -50, 11))]
    site = survey_recordings([walk("w", [(0, 0, 0), (10, 10, 0)], scans)], [Floor(name="F1")]).site
    assert site.radio_map.transmitters == ("in",)
    assert site.notes["readings_before_first_waypoint"] == 2
    assert site.notes["readings_after_last_waypoint"] == 1


def test_several_scans_at_one_spot_are_one_reference_point() -> None:
    scans = [scan(("ap", -50 - i, 3 * i)) for i in range(1, 5)]
    radio = survey_recordings(
        [walk("w", [(0, 4, 7), (15, 4, 7)], scans)], [Floor(name="F1")], reach_m=0.0
    ).site.radio_map
    assert radio.point_xy.tolist() == [[4.0, 7.0]]
    assert radio.sample_point.tolist() == [0, 0, 0, 0]
    assert radio.mean_matrix().tolist() == [[-52.5]]


def test_walks_through_one_place_share_its_reference_point() -> None:
    there = walk("a", [(0, 0.5, 0.5), (10, 9.5, 0.5)], [scan(("ap", -50, t)) for t in (1, 9)])
    back = walk("b", [(100, 9.5, 1.0), (110, 0.5, 1.0)], [scan(("ap", -60, t)) for t in (101, 109)])
    radio = survey_recordings([there, back], [Floor(name="F1")], spacing_m=2.0, reach_m=0.0).site.radio_map
    assert radio.point_xy.tolist() == [
        [pytest.approx(1.4), pytest.approx(0.75)],
        [pytest.approx(8.6), pytest.approx(0.75)],
    ]
    assert radio.mean_matrix().tolist() == [[-55.0], [-55.0]]


def test_readings_between_two_floors_have_no_place() -> None:
    truth = [(0, "F1", 0.0), (10, "F1", 10.0), (20, "F2", 10.0), (30, "F2", 0.0)]
    events = [Truth(t_ns=T0 + t * S, floor=floor, xy=np.array([x, 0.0])) for t, floor, x in truth]
    scans = [scan(("ap", -50, 5)), scan(("lift", -50, 15)), scan(("ap", -60, 25))]
    site = survey_recordings([Recording(name="w", floor="", events=(*events, *scans))], []).site
    assert [floor.name for floor in site.floors] == ["F1", "F2"]
    assert site.radio_map.point_floor.tolist() == [0, 1]
    assert site.radio_map.transmitters == ("ap",)
    assert site.notes["readings_between_floors"] == 1
    assert [(track.floor, track.xy[:, 0].tolist()) for track in site.survey_tracks] == [
        ("F1", [0, 10]),
        ("F2", [10, 0]),
    ]


def test_lessons_hold_each_surveyed_walk_with_its_motion_in_one_piece() -> None:
    backwards = motion_samples([T0 + 5, T0 + 1, T0 + 5], accelerometer=[[5, 0, 0], [1, 0, 0], [6, 0, 0]])
    walked = walk("w", [(0, 0, 0), (10, 10, 0)], [scan(("ap", -50, 8)), scan(("ap", -50, 2))])
    walked = Recording(name="w", floor="F1", events=(*walked.events, backwards))
    (lesson,) = survey_recordings([walked], [Floor(name="F1")]).training_data.walks
    times = lesson.motion.sensors["accelerometer"].t_ns
    assert (np.diff(times) > 0).all()
    assert lesson.motion.sensors["accelerometer"].values[times == T0 + 5].tolist() == [[5.0, 0.0, 0.0]]
    assert [(s.t_ns - T0) // S for s in lesson.scans] == [2, 8]
    assert (lesson.name, lesson.chain, lesson.floor) == ("w", "w", "F1")


def test_the_order_in_which_walks_come_changes_nothing() -> None:
    walks = [walk(f"w{i}", [(i * 90, i, 0), (i * 90 + 9, i + 5, 0)], [scan(("ap", -50, i * 90 + 4))]) for i in range(6)]
    one, two = (survey_recordings(order, [Floor(name="F1")], holdout=0.3).site for order in (walks, walks[::-1]))
    assert one.radio_map.sample_xy.tolist() == two.radio_map.sample_xy.tolist()
    assert [t.walk for t in one.survey_tracks] == [t.walk for t in two.survey_tracks]
    assert one.held_out == two.held_out
    assert len(one.held_out) + len(one.survey_tracks) == 6


def test_progress_is_told_after_every_walk() -> None:
    told: list[tuple[int, int]] = []
    walks = [walk(f"w{i}", [(i * 90, i, 0), (i * 90 + 9, i + 5, 0)]) for i in range(3)]
    survey_recordings(walks, [], progress=lambda done, total: told.append((done, total)))
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_a_walk_without_waypoints_is_counted_and_left_out() -> None:
    site = survey_recordings([walk("a", []), walk("b", [(0, 0, 0), (5, 1, 1)])], []).site
    assert site.notes["walks_without_waypoints"] == 1
    assert [track.walk for track in site.survey_tracks] == ["b"]


def test_two_walks_of_one_name_are_refused() -> None:
    with pytest.raises(SiteError, match="two walks are called a"):
        survey_recordings([walk("a", []), walk("a", [])], [])


def test_a_survey_that_leaves_nothing_is_refused() -> None:
    with pytest.raises(SiteError, match="1 held out: none is left"):
        survey_recordings([walk("a", [(0, 0, 0), (5, 1, 1)])], [], holdout=1.0)


def test_two_floors_of_one_name_are_refused() -> None:
    with pytest.raises(SiteError, match="several floors called F1"):
        survey_recordings([walk("a", [(0, 0, 0), (5, 1, 1)])], [Floor(name="F1"), Floor(name="F1")])
