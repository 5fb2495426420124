"""What becomes of awkward events: each has a defined outcome."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lab import fold, numbered
from streams import MS, SETTINGS, T0, S, published, run, sample, scan, settled, ticks, walk
from toys import Chain, ToyFingerprint, ToyPdr, toy_pipeline

from tickfix.api import LATEST_NS, TICK_NS, Fix, PluginError, Pressure, Scan, Status, Truth, Window, motion_samples
from tickfix.kernel import Kernel, MessageOutcome, Stage, StageFailure


def test_every_tick_from_the_first_sample_to_the_last_is_published_once() -> None:
    folded = run([*walk(0, 2), scan(1.9, "a")])
    assert ticks(published(folded)) == [(0, k / 5) for k in range(11)]
    assert [e.revision for e in published(folded)] == [0] * 11


@pytest.mark.parametrize("gap_s", [0.5, 3.0, 20.0, 59.0])
def test_a_gap_of_up_to_a_minute_is_folded_tick_by_tick_within_the_epoch(gap_s: float) -> None:
    folded = run([scan(0.5, "a"), *walk(0, 2), *walk(2 + gap_s, 6 + gap_s)])
    track = published(folded)
    assert {e.epoch for e in track} == {0}
    assert [e.tick for e in track] == list(range(track[0].tick, track[-1].tick + 1))
    assert track[-1].t_ns >= T0 + (5.8 + gap_s) * S
    assert not folded.measurements["dropped"]


def test_a_gap_of_over_a_minute_begins_a_new_epoch_that_knows_nothing() -> None:
    folded = run([scan(0.5, "a"), *walk(0, 2), *walk(90, 95)])
    track = settled(folded)
    assert sorted({e.epoch for e in track}) == [0, 1]
    assert [e.status for e in track if e.epoch == 1] == [Status.INITIALISING] * 25 + [Status.INITIALISING]
    assert len(track) < 50


def test_age_of_motion_tells_of_a_gap() -> None:
    folded = run([scan(0.1, "a"), *walk(0, 2), *walk(6, 7)])
    ages = {round((e.t_ns - T0) / S, 1): e.motion_age_ns for e in settled(folded)}
    assert ages[2.0] is not None
    assert ages[2.0] < 100 * MS
    assert ages[5.0] == 5 * S - 1_980 * MS


def test_a_message_with_a_number_seen_before_is_a_duplicate() -> None:
    events = numbered([*walk(0, 2), scan(1.0, "a")])
    assert run([*events, events[3], events[-1]]).outcomes[-2:] == (MessageOutcome.DUPLICATE, MessageOutcome.DUPLICATE)


def test_of_a_device_that_left_the_numbers_of_its_last_two_sessions_are_known() -> None:
    kernel = Kernel([toy_pipeline()], SETTINGS)
    for session in range(20):
        kernel.feed(sample(session / 10, session=str(session), seq=5_000))
    assert len(kernel.snapshot().sessions) == 16
    kernel.run("d")
    kernel.finish("d")
    kept = kernel.snapshot()
    assert [one.session for one in kept.sessions] == ["18", "19"]
    assert len(kept.packed()) < 2_000
    for session, outcome in (
        ("17", MessageOutcome.ACCEPTED),
        ("18", MessageOutcome.DUPLICATE),
        ("19", MessageOutcome.DUPLICATE),
    ):
        assert kernel.feed(sample(1.0, session=session, seq=5_000)) is outcome


def test_sequence_numbers_may_come_in_any_order_and_have_gaps() -> None:
    events = [replace(e, seq=7 * n) for n, e in enumerate(walk(0, 2), 1)]
    shuffled = [events[i] for i in np.random.default_rng(1).permutation(len(events))]
    folded = run(shuffled)
    assert set(folded.outcomes) <= {MessageOutcome.ACCEPTED, MessageOutcome.LATE}
    assert folded.settled_as("d", "toy") == run(events).settled_as("d", "toy")


def test_the_same_number_in_another_session_is_another_message() -> None:
    first, second = sample(0.1, session="a", seq=1), sample(0.3, session="b", seq=1)
    assert run([first, second]).outcomes == (MessageOutcome.ACCEPTED, MessageOutcome.ACCEPTED)


def test_the_same_content_under_another_number_is_a_duplicate() -> None:
    fix = Fix(t_ns=T0 + S, floor="F", xy=np.zeros(2), device="d", seq=5)
    events = [replace(scan(1.0, "a"), seq=2), replace(sample(1.1), seq=3), fix]
    again = [replace(event, seq=event.seq + 10, session="later") for event in events]
    folded = run([*events, *again])
    assert folded.outcomes[3:] == (MessageOutcome.DUPLICATE,) * 3
    assert folded.settled_as("d", "toy") == run(events).settled_as("d", "toy")


def test_of_two_samples_at_one_instant_the_smaller_stands_whichever_came_first() -> None:
    a, b, later = sample(0.1, 2.0), sample(0.1, 1.0), sample(0.9)
    one, other = run([a, b, later]), run([b, a, later])
    assert one.settled_as("d", "toy") == other.settled_as("d", "toy") == run([b, later]).settled_as("d", "toy")
    assert one.outcomes[1] == other.outcomes[1] == MessageOutcome.DUPLICATE


def test_the_sign_of_a_zero_is_not_decided_by_arrival() -> None:
    a, b, later = sample(0.1, -0.0), sample(0.1, 0.0), sample(0.9)
    assert run([a, b, later]).settled_as("d", "toy") == run([b, a, later]).settled_as("d", "toy")


def test_samples_at_one_instant_of_several_sensors_all_count() -> None:
    both = motion_samples([T0 + S], accelerometer=[[1, 2, 3]], gyroscope=[[4, 5, 6]], device="d")
    assert run([both]).measurements["accepted"] == 2


def test_a_stream_that_lags_behind_the_horizon_is_stale() -> None:
    folded = run([scan(0.5, "a"), *walk(0, 14), scan(1.0, "b"), *walk(14, 15)])
    assert folded.intake["stale"] == 1
    assert {e.epoch for e in settled(folded)} == {0}


def test_a_new_stream_that_lags_behind_the_horizon_does_not_restart_the_track() -> None:
    events = []
    for second in range(40):
        events += walk(second, second + 1)
        if second >= 20:
            events.append(replace(scan(second - 20, "relay"), source="ble"))
    folded = run(events)
    assert {e.epoch for e in settled(folded)} == {0}
    assert folded.measurements["dropped"] == 20


def test_what_comes_behind_the_horizon_is_stale_where_its_number_tells_that_it_was_sent_before() -> None:
    events = numbered(walk(0, 20))
    late = events[10:40]
    folded = run([*events[:10], *events[40:180], *late, *events[180:]])
    assert folded.outcomes[150:180] == (MessageOutcome.STALE,) * 30
    assert folded.measurements["stale"] == sum(len(e.sensors["accelerometer"]) for e in late)
    assert {e.epoch for e in settled(folded)} == {0}
    assert folded.settled_as("d", "toy") == run([*events[:10], *events[40:]]).settled_as("d", "toy")


def test_what_was_lost_at_a_reboot_and_sent_again_is_not_taken_for_late() -> None:
    events = numbered([*walk(0, 20), *walk(0, 5, offset_ns=3 * S)])
    lost = events[200]
    folded = run([*events[:200], *events[201:210], lost, *events[210:]])
    assert folded.intake["stale"] == folded.measurements["dropped"] == 0
    assert folded.settled_as("d", "toy") == run(events).settled_as("d", "toy")


def test_a_number_that_leaps_absurdly_makes_nothing_that_follows_stale() -> None:
    first, *rest = numbered([*walk(0, 20), *walk(0, 5, offset_ns=3 * S)])
    folded = run([first, replace(rest[0], seq=10**12), *rest[1:]])
    assert folded.intake["stale"] == 0
    assert {e.epoch for e in settled(folded)} == {0, 1}


def test_sensors_on_another_clock_do_not_restart_the_track_again_and_again() -> None:
    events = []
    for second in range(30):
        events += [*walk(second, second + 1), scan(second, "a", offset_ns=T0 + 10**9 * S)]
    assert {e.epoch for e in settled(run(events))} == {0}


def test_a_reboot_begins_a_new_epoch_once_two_seconds_of_samples_agree() -> None:
    folded = run([*walk(0, 20), *walk(0, 5, offset_ns=3 * S), scan(4.5, "a", offset_ns=3 * S)])
    track = settled(folded)
    assert [e.epoch for e in track] == sorted(e.epoch for e in track)
    assert max(e.epoch for e in track) == 1
    assert max(e.t_ns for e in track if e.epoch == 0) <= T0 + 20 * S
    assert {e.t_ns for e in track if e.epoch == 1} == {TICK_NS * k for k in range(15, 41)}
    assert folded.intake["stale"] == 0


def test_a_clock_that_steps_back_within_the_horizon_makes_late_samples() -> None:
    folded = run([*walk(0, 5), *walk(3.01, 8)])
    assert {e.epoch for e in settled(folded)} == {0}
    assert folded.intake["late"]


def test_one_sample_a_year_ahead_changes_nothing() -> None:
    year = 365 * 86_400
    events = [scan(0.5, "a"), *walk(0, 5)]
    odd = [*events[:20], sample(year), *events[20:]]
    assert run(odd).settled_as("d", "toy") == run(events).settled_as("d", "toy")
    assert run(odd).said("d", "toy") == run(events).said("d", "toy")
    assert not run(odd).intake["stale"]
    assert run(odd).measurements["dropped"] == 1


def test_many_single_samples_a_year_ahead_change_nothing() -> None:
    year = 365 * 86_400
    events = [scan(0.5, "a"), *walk(0, 8)]
    odd = [e for n, event in enumerate(events) for e in (event, *([sample(year + n / 10)] if n % 5 == 0 else []))]
    assert run(odd).settled_as("d", "toy") == run(events).settled_as("d", "toy")


def test_a_first_sample_a_year_ahead_costs_two_seconds() -> None:
    folded = run([sample(365 * 86_400), scan(0.5, "a"), *walk(0, 6)])
    good = [e for e in settled(folded) if e.epoch == 1]
    assert good[0].t_ns <= T0 + S
    assert good[-1].t_ns == T0 + 6 * S


@pytest.mark.parametrize("ahead_s", [20.0, 3_600.0, 4e7])
def test_a_whole_wrong_batch_makes_nothing_stale(ahead_s: float) -> None:
    events = [scan(0.5, "a"), *walk(0, 8)]
    (wrong,) = walk(ahead_s, ahead_s + 0.4, every_s=0.4)
    folded = run([*events[:30], wrong, *events[30:]])
    assert not folded.intake["stale"]
    good = [e for e in settled(folded) if e.t_ns <= T0 + 8 * S]
    assert {e.epoch for e in good} == {0}
    assert [e.tick for e in good] == [e.tick for e in settled(run(events))]


def test_what_is_not_finite_is_left_out_sample_by_sample() -> None:
    rows = np.array([[1.0, 2.0, 3.0], [np.nan, 2.0, 3.0], [1.0, np.inf, 3.0], [1.0, 2.0, 4.0]])
    batch = motion_samples(T0 + MS * np.arange(4), accelerometer=rows, device="d")
    folded = run([batch, *walk(0.1, 1)])
    assert folded.measurements["invalid"] == 2
    good = motion_samples(T0 + MS * np.array([0, 3]), accelerometer=rows[[0, 3]], device="d")
    assert folded.settled_as("d", "toy") == run([good, *walk(0.1, 1)]).settled_as("d", "toy")


@pytest.mark.parametrize(
    "event",
    [
        motion_samples([T0], accelerometer=[[np.nan, 0, 0]], device="d"),
        motion_samples([-5], accelerometer=[[1, 0, 0]], device="d"),
        motion_samples(np.zeros(0, np.int64), accelerometer=np.zeros((0, 3)), device="d"),
        Pressure(t_ns=T0, pressure_hpa=np.nan, device="d"),
        Scan(transmitters=("a",), rssi_dbm=np.array([np.inf]), heard_ns=np.array([T0]), device="d"),
        Fix(t_ns=T0, floor="F", xy=np.array([np.nan, 0.0]), device="d"),
        Fix(t_ns=T0, floor="F", xy=np.zeros(2), covariance=np.zeros((2, 2)), device="d"),
        Fix(t_ns=T0, floor="F", xy=np.zeros(2), covariance=np.array([[1.0, 5.0], [5.0, 1.0]]), device="d"),
    ],
)
def test_an_event_of_which_nothing_can_be_used_is_malformed(event: Scan) -> None:
    folded = run([event, *walk(0, 1)])
    assert folded.outcomes[0] == MessageOutcome.MALFORMED
    assert folded.settled_as("d", "toy") == run(walk(0, 1)).settled_as("d", "toy")


@pytest.mark.parametrize("t_ns", [LATEST_NS + 1, 2**63 - 1, -1])
def test_a_time_that_is_none_is_left_out_and_leaves_the_track_as_it_was(t_ns: int) -> None:
    wild = [
        Pressure(t_ns=t_ns, pressure_hpa=1000.0, device="d"),
        Fix(t_ns=t_ns, floor="F", xy=np.zeros(2), device="d"),
        Scan(transmitters=(), rssi_dbm=np.zeros(0), heard_ns=np.zeros(0, np.int64), t_ns=t_ns, device="d"),
        motion_samples([t_ns], accelerometer=[[0.0, 0.0, 9.8]], device="d"),
    ]
    alone = run(wild)
    assert alone.outcomes == (MessageOutcome.MALFORMED,) * 4
    assert published(alone) == []
    mixed = motion_samples([T0, t_ns], accelerometer=[[0.0, 0.0, 9.8]] * 2, device="d")
    folded = run([*walk(0, 2), *wild, replace(mixed, seq=0), *walk(2, 4)])
    assert folded.settled_as("d", "toy") == run([*walk(0, 2), sample(0.0), *walk(2, 4)]).settled_as("d", "toy")
    assert folded.measurements["invalid"] == 5


def test_the_last_times_there_are_close_their_ticks() -> None:
    folded = run(walk(-4, 0, offset_ns=LATEST_NS))
    assert published(folded)[-1].t_ns >= LATEST_NS - 100 * MS
    assert all(e.t_ns < 2**62 + TICK_NS for e in published(folded))


def test_readings_that_are_not_finite_or_from_the_future_are_left_out_of_a_scan() -> None:
    heard = T0 + S * np.array([1, 1, 3])
    bad = Scan(transmitters=("a", "b", "c"), rssi_dbm=np.array([-60.0, np.nan, -50.0]), heard_ns=heard, t_ns=T0 + S)
    folded = run([*walk(0, 2), replace(bad, device="d")])
    assert folded.measurements["invalid_readings"] == 2
    assert folded.settled_as("d", "toy") == run([*walk(0, 2), scan(1.0, "a")]).settled_as("d", "toy")


def test_a_scan_without_readings_is_seen_and_says_nothing() -> None:
    folded = run([scan(0.5), *walk(0, 2)])
    assert set(folded.outcomes) == {MessageOutcome.ACCEPTED}
    assert {e.status for e in settled(folded)} == {Status.INITIALISING}


def test_a_scan_before_the_first_sample_starts_the_track_there() -> None:
    folded = run([scan(0.0, "a"), *walk(2, 4)])
    track = settled(folded)
    assert ticks(track)[0] == (0, 0.0)
    assert track[0].status is Status.TRACKING
    assert track[0].reasons == ("started",)


@pytest.mark.parametrize("every_s", [1.0, 4.0, 8.0, 30.0])
def test_a_device_with_scans_only_is_followed_scan_by_scan(every_s: float) -> None:
    folded = fold([toy_pipeline()], [scan(every_s * n, "a") for n in range(12)], SETTINGS, finish=False)
    track = published(folded)
    assert {e.epoch for e in track} == {0}
    assert track[-1].t_ns == T0 + round(11 * every_s) * S
    assert set(folded.outcomes) == {MessageOutcome.ACCEPTED}


def test_a_device_with_scans_only_may_reboot() -> None:
    before, after = ([scan(20.0 * n, "a", offset_ns=t0) for n in range(8)] for t0 in (T0, S))
    track = settled(run([*before, *after]))
    assert [e.t_ns for e in track if e.epoch == 1][-1] == 141 * S


def test_scans_go_on_when_the_motion_sensors_are_switched_off() -> None:
    scans = [scan(10 + 15.0 * n, "a") for n in range(12)]
    folded = fold([toy_pipeline()], [*walk(0, 10), *scans], SETTINGS, finish=False)
    assert published(folded)[-1].t_ns == scans[-1].t_ns


def test_an_odd_sample_before_a_gap_does_not_break_the_track_after_it() -> None:
    folded = run([*walk(0, 2), sample(10), *walk(40, 44)])
    assert {e.epoch for e in settled(folded)} == {0}
    assert not folded.intake["stale"]


def test_what_was_held_while_a_driver_closed_the_ticks_beyond_is_stale() -> None:
    kernel = Kernel([toy_pipeline()], SETTINGS)
    for event in [*walk(0, 2), sample(10)]:
        kernel.feed(event)
        kernel.run("d")
    kernel.run("d", (T0 + 40 * S) // TICK_NS)
    kernel.finish("d")
    assert kernel.measurements["stale"] == 1


def test_a_driver_closes_ticks_and_what_comes_after_is_late() -> None:
    kernel = Kernel([toy_pipeline()], SETTINGS)
    for event in walk(0, 1):
        kernel.feed(event)
    assert len(kernel.run("d", T0 // TICK_NS + 10).published) == 11
    (late,) = walk(1.5, 1.6)
    assert kernel.feed(late) == MessageOutcome.LATE
    output = kernel.run("d")
    assert not output.published
    assert [e.tick - T0 // TICK_NS for e in output.revised] == [8, 9, 10]
    assert {e.revision for e in output.revised} == {1}


def test_a_late_scan_revises_what_was_published_since() -> None:
    folded = run([scan(0.1, "a"), *walk(0, 4), scan(2.0, "b")])
    assert folded.outcomes[-1] == MessageOutcome.LATE
    revised = folded.revised["d", "toy"]
    assert [e.t_ns - T0 for e in revised] == [TICK_NS * k for k in range(10, 20)]
    assert folded.settled_as("d", "toy") == run([scan(0.1, "a"), *walk(0, 2), scan(2.0, "b"), *walk(2, 4)]).settled_as(
        "d", "toy"
    )


def test_a_known_start_begins_the_track_without_any_observation() -> None:
    start = Fix(t_ns=T0 + S, floor="F", xy=np.ones(2), covariance=np.eye(2))
    track = settled(fold([toy_pipeline()], walk(0, 2), SETTINGS, {"d": start}))
    assert [e.status for e in track[:6]] == [Status.INITIALISING] * 5 + [Status.TRACKING]
    assert settled(fold([toy_pipeline()], walk(0, 2), SETTINGS, {"other": start}))[-1].belief is None


def test_an_estimate_coasts_ten_seconds_after_the_last_observation_used() -> None:
    track = settled(run([scan(0.2, "a"), *walk(0, 12)]))
    by_second = {(e.t_ns - T0) / S: e.status for e in track}
    assert by_second[10.2] is Status.TRACKING
    assert by_second[10.4] is Status.COASTING


def test_truth_is_accepted_and_makes_no_device() -> None:
    kernel = Kernel([toy_pipeline()], SETTINGS)
    assert kernel.feed(Truth(t_ns=T0, floor="F", xy=np.zeros(2), device="d")) == MessageOutcome.ACCEPTED
    assert kernel.devices == ()
    assert not kernel.run("d").published
    assert not kernel.finish("d").settled


def test_a_window_never_reaches_back_over_a_minute_whatever_was_kept() -> None:
    events = [scan(0.0, "old"), *walk(0, 70), scan(69.9, "new")]
    short, endless = (run(events, window=Window(seconds=seconds, scans=1000)) for seconds in (60.0, np.inf))
    assert short.settled_as("d", "toy") == endless.settled_as("d", "toy")


def test_a_fingerprint_whose_window_raises_fails_alone() -> None:
    class Broken(ToyFingerprint):
        @property
        def window(self) -> Window:
            raise RuntimeError("no window")

        @window.setter
        def window(self, value: Window) -> None: ...

    good = toy_pipeline("toy")
    bad = replace(toy_pipeline("bad"), fingerprint=Stage("fingerprint", "bad", "bad", Broken(Window())))
    events = [scan(0.5, "a"), *walk(0, 2)]
    folded = fold([good, bad], events, replace(SETTINGS, strict=False))
    assert folded.settled_as("d", "toy") == run(events).settled_as("d", "toy")
    assert [e.failed_by for e in folded.settled["d", "bad"] if e.failed_by] == ["fingerprint 'bad': RuntimeError"]
    with pytest.raises(PluginError, match="no window"):
        fold([bad], events, SETTINGS)


def test_who_failed_is_told_at_once() -> None:
    class Broken(ToyPdr):
        def start(self) -> Chain:
            raise AttributeError("not today")

    told: list[StageFailure] = []
    bad = replace(toy_pipeline(), pdr=Stage("pdr", "bad", "bad", Broken()))
    kernel = Kernel([bad], on_failure=told.append)
    kernel.feed(sample(0.1))
    kernel.run("d", T0 // TICK_NS + 1)
    assert {str(failure) for failure in told} == {"pdr 'bad': AttributeError"}
    assert kernel.failures["pdr 'bad': AttributeError"] == len(told)
