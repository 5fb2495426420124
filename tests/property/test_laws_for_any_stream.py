"""The laws of the kernel on arbitrary streams, with algorithms whose outputs hash all they saw."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from lab import Folded, examples, fold, numbered, track_digest
from toys import toy_pipeline

from tickfix.api import Event, Fix, MotionSamples, Pressure, Samples, Scan, Window
from tickfix.kernel import KernelSettings

HORIZON_S = 4.0
SETTINGS = KernelSettings(horizon_s=HORIZON_S, strict=True)
MS = 1_000_000
T0 = 5_000_000_000_000

PIPELINES = (
    toy_pipeline("toy"),
    toy_pipeline("eager", eager=True, window=Window(seconds=2.0, scans=2, sources=("wifi",))),
    toy_pipeline("redated", redated=True),
    toy_pipeline("smoothing", smoothing=True),
    toy_pipeline("motion only", eager=True, fingerprint=False),
    toy_pipeline("scans only", pdr=False, window=Window(seconds=30.0, sources=("wifi", "ble"))),
)

times = st.integers(0, 25_000)
delays = st.integers(0, round(HORIZON_S * 1000) - 1)
values = st.sampled_from([0.0, -0.0, 1.0, 2.0])


@st.composite
def motions(draw: st.DrawFn) -> list[Event]:
    sensor = draw(st.sampled_from(["accelerometer", "gyroscope", "magnetometer"]))
    first, n = draw(times), draw(st.integers(1, 4))
    t_ns = T0 + MS * (first + np.arange(n) * draw(st.sampled_from([0, 20, 130])))
    rows = np.array([[draw(values), 0.0, float(i % 2)] for i in range(n)])
    return [MotionSamples(sensors={sensor: Samples(t_ns, rows)}, device="d")]


@st.composite
def scans(draw: st.DrawFn) -> list[Event]:
    t_ns, n = T0 + MS * draw(times), draw(st.integers(0, 3))
    heard = [t_ns - MS * draw(st.integers(0, 6000)) for _ in range(n)]
    rssi = [draw(st.sampled_from([-50.0, -60.0])) for _ in range(n)]
    names = tuple(draw(st.lists(st.sampled_from("abc"), min_size=n, max_size=n)))
    source = draw(st.sampled_from(["wifi", "ble"]))
    heard_ns, rssi_dbm = np.array(heard, np.int64), np.array(rssi)
    return [Scan(transmitters=names, rssi_dbm=rssi_dbm, heard_ns=heard_ns, t_ns=t_ns, source=source, device="d")]


fixes = st.builds(
    lambda t, x: [Fix(t_ns=T0 + MS * t, floor="F", xy=np.array([x, 0.0]), device="d")],
    times,
    st.sampled_from([0.0, 1.0]),
)
pressures = st.builds(lambda t, p: [Pressure(t_ns=T0 + MS * t, pressure_hpa=p, device="d")], times, values)
streams = st.lists(st.one_of(motions(), scans(), fixes, pressures), min_size=1, max_size=25).map(
    lambda lists: sorted((e for events in lists for e in events), key=lambda e: e.t_ns)
)


def oldest_ns(event: Event) -> int:
    return event.t0_ns if isinstance(event, MotionSamples) else event.t_ns


def arrived(events: list[Event], delays_ms: list[int]) -> list[Event]:
    """Order by arrival; a batch's oldest sample counts, so that all of it comes within the horizon."""
    pairs = sorted(zip(events, delays_ms, strict=False), key=lambda pair: oldest_ns(pair[0]) + MS * pair[1])
    return [event for event, _ in pairs]


def settled(events: list[Event], used: KernelSettings = SETTINGS, pipelines: Any = PIPELINES) -> list[str]:
    folded = fold(pipelines, events, used)
    return [folded.settled_as("d", p.name) for p in pipelines]


@examples(100)
@given(events=streams, data=st.data())
def test_any_arrival_order_within_the_horizon_settles_to_the_same_bytes(
    events: list[Event], data: st.DataObject
) -> None:
    each = st.lists(delays, min_size=len(events), max_size=len(events))
    one, other = arrived(events, data.draw(each)), arrived(events, data.draw(each))
    assert settled(one) == settled(other)


@examples(60)
@given(events=streams, data=st.data(), checkpoint_mb=st.sampled_from([1e-6, 1e-3, 0.01]))
def test_neither_checkpoints_nor_packing_nor_company_settle_to_other_bytes(
    events: list[Event], data: st.DataObject, checkpoint_mb: float
) -> None:
    late = arrived(events, data.draw(st.lists(delays, min_size=len(events), max_size=len(events))))
    kept = settled(late)
    assert settled(late, replace(SETTINGS, checkpoint_mb=checkpoint_mb, repack=True)) == kept
    assert [settled(late, SETTINGS, [p])[0] for p in PIPELINES] == kept


@examples(40)
@given(events=streams, data=st.data())
def test_repeating_any_message_under_another_number_settles_to_the_same_bytes(
    events: list[Event], data: st.DataObject
) -> None:
    times = data.draw(st.lists(st.integers(1, 3), min_size=len(events), max_size=len(events)))
    repeated = numbered(event for event, n in zip(events, times, strict=True) for _ in range(n))
    once, twice = fold(PIPELINES, events, SETTINGS), fold(PIPELINES, repeated, SETTINGS)
    for pipeline in PIPELINES:
        assert once.settled_as("d", pipeline.name) == twice.settled_as("d", pipeline.name)
    assert sum(twice.intake.values()) == len(repeated)


wild = st.integers(0, 2**62) | times.map(lambda ms: T0 + MS * ms) | st.integers(T0, T0 + 200_000 * MS)


@examples(60)
@given(
    instants=st.lists(wild, min_size=1, max_size=30),
    kinds=st.lists(st.sampled_from(["motion", "wifi", "ble", "fix", "pressure"]), min_size=30, max_size=30),
)
def test_whatever_the_times_every_message_has_one_outcome_and_ticks_are_published_once_in_order(
    instants: list[int], kinds: list[str]
) -> None:
    events: list[Event] = []
    for t_ns, kind in zip(instants, kinds, strict=False):
        if kind == "motion":
            row = Samples(np.array([t_ns]), np.ones((1, 3)))
            events.append(MotionSamples(sensors={"accelerometer": row}, device="d"))
        elif kind == "fix":
            events.append(Fix(t_ns=t_ns, floor="F", xy=np.zeros(2), device="d"))
        elif kind == "pressure":
            events.append(Pressure(t_ns=t_ns, pressure_hpa=1000.0, device="d"))
        else:
            heard = np.array([t_ns])
            events.append(
                Scan(transmitters=("a",), rssi_dbm=np.array([-50.0]), heard_ns=heard, source=kind, device="d")
            )
    folded = fold(PIPELINES, events, SETTINGS)
    assert sum(folded.intake.values()) == len(events)
    for track in folded.published.values():
        instants_said = [(e.epoch, e.tick) for e in track]
        assert instants_said == sorted(set(instants_said))
    for key, track in folded.settled.items():
        instants_settled = [(e.epoch, e.tick) for e in track]
        assert instants_settled == sorted(set(instants_settled))
        assert set(instants_settled) >= {(e.epoch, e.tick) for e in folded.published[key]}


@examples(80)
@given(events=streams, data=st.data(), checkpoint_mb=st.sampled_from([1e-6, 1e-3, 8.0]))
def test_going_on_from_a_snapshot_says_the_same_bytes(
    events: list[Event], data: st.DataObject, checkpoint_mb: float
) -> None:
    late = numbered(arrived(events, data.draw(st.lists(delays, min_size=len(events), max_size=len(events)))))
    restarts = data.draw(st.sets(st.integers(0, len(late) - 1), max_size=3))
    used = replace(SETTINGS, checkpoint_mb=checkpoint_mb)
    through, restarted = fold(PIPELINES, late, used), fold(PIPELINES, late, used, restarts=restarts)
    assert same_tracks(through, restarted)


@examples(60)
@given(
    instants=st.lists(wild, min_size=1, max_size=30),
    sources=st.lists(st.sampled_from(["wifi", "ble"]), min_size=30, max_size=30),
    data=st.data(),
)
def test_a_snapshot_remembers_what_is_held(instants: list[int], sources: list[str], data: st.DataObject) -> None:
    events: list[Event] = []
    for n, t_ns in enumerate(instants):
        if n % 2:
            rows = Samples(np.array([t_ns]), np.full((1, 3), float(n)))
            events.append(MotionSamples(sensors={"gyroscope": rows}, device="d"))
        else:
            heard, rssi = np.array([t_ns]), np.array([-50.0])
            events.append(Scan(transmitters=("a",), rssi_dbm=rssi, heard_ns=heard, source=sources[n], device="d"))
    restarts = data.draw(st.sets(st.integers(0, len(events) - 1), max_size=3))
    through, restarted = fold(PIPELINES, events, SETTINGS), fold(PIPELINES, events, SETTINGS, restarts=restarts)
    assert same_tracks(through, restarted)


def same_tracks(one: Folded, other: Folded) -> bool:
    """Tell whether all that was said and counted is the same, bit for bit."""
    tracks = [
        {key: [(e.revision, track_digest([e])) for e in track] for key, track in found.items()}
        for folded in (one, other)
        for found in (folded.published, folded.revised, folded.settled)
    ]
    counted = [(f.outcomes, f.intake, f.measurements, f.failures) for f in (one, other)]
    return tracks[:3] == tracks[3:] and counted[0] == counted[1]


def test_a_snapshot_keeps_fixes_that_wait_for_their_tick() -> None:
    names, rssi = ("a", "b"), np.array([-50.0, -60.0])
    events: list[Event] = []
    for n in range(60):
        t_ns = T0 + 300 * MS * n
        events.append(MotionSamples(sensors={"gyroscope": Samples(np.array([t_ns]), np.ones((1, 3)))}, device="d"))
        heard_ns = np.array([t_ns - 10 * MS * (n % 7), t_ns])
        events.append(Scan(transmitters=names, rssi_dbm=rssi, heard_ns=heard_ns, source="wifi", device="d"))
    through = fold(PIPELINES, numbered(events), SETTINGS)
    for n in range(60, 120, 7):
        assert same_tracks(through, fold(PIPELINES, numbered(events), SETTINGS, restarts=[n]))
