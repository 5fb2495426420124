"""A timeline is a set of measurements, read tick by tick in one order."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from streams import MS, T0, S, sample, scan

from tickfix.api import TICK_NS, Fix, MotionSamples, Pressure, Samples, Scan, Window
from tickfix.kernel.deduplication import MessageOutcome
from tickfix.kernel.measurements import tick_of
from tickfix.kernel.timeline import Timeline


@pytest.fixture
def timeline() -> Timeline:
    return Timeline(10 * S, Counter())


@pytest.mark.parametrize(("t_ns", "tick"), [(0, 0), (1, 1), (TICK_NS, 1), (TICK_NS + 1, 2), (2**62 + 1, 23058430093)])
def test_a_tick_closes_the_interval_before_it(t_ns: int, tick: int) -> None:
    assert tick_of(t_ns) == tick


def test_motion_of_a_tick_is_in_increasing_time_whatever_the_order_it_came_in(timeline: Timeline) -> None:
    t_ns = T0 + MS * np.array([150, 50, 200, 201, 100])
    rows = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
    timeline.insert(MotionSamples(sensors={"gyroscope": Samples(t_ns, rows), "accelerometer": Samples(t_ns, rows)}))
    samples = timeline.motion(tick_of(T0) + 1)
    assert list(samples.sensors) == ["accelerometer", "gyroscope"]
    assert (samples.sensors["gyroscope"].t_ns - T0).tolist() == [50 * MS, 100 * MS, 150 * MS, 200 * MS]
    assert samples.sensors["gyroscope"].values[:, 0].tolist() == [1, 4, 0, 2]
    assert (samples.t0_ns, samples.t1_ns) == (T0, T0 + TICK_NS)
    assert not samples.sensors["gyroscope"].values.flags.writeable


def test_pressure_is_a_sensor_of_the_tick_but_does_not_close_it(timeline: Timeline) -> None:
    timeline.insert(sample(0.1))
    timeline.insert(Pressure(t_ns=T0 + S, pressure_hpa=1000.0))
    assert timeline.motion(tick_of(T0 + S)).sensors["pressure"].values.tolist() == [[1000.0]]
    assert timeline.watermark == tick_of(T0)


def test_a_tick_has_passed_when_every_sensor_heard_in_the_last_second_passed_it(timeline: Timeline) -> None:
    one = np.ones((1, 3))
    for t_s, sensor in ((0.1, "accelerometer"), (0.1, "gyroscope"), (0.7, "accelerometer")):
        timeline.insert(MotionSamples(sensors={sensor: Samples(np.array([T0 + round(t_s * S)]), one)}))
    assert timeline.watermark == tick_of(T0)
    timeline.insert(sample(1.2))
    assert timeline.watermark == tick_of(T0) + 6


def test_scans_and_fixes_of_a_tick_come_in_one_order(timeline: Timeline) -> None:
    other = Timeline(10 * S, Counter())
    events = [scan(0.2, "b"), scan(0.2, "a"), scan(0.1, "z"), scan(0.2, "a", source="ble")]
    fixes = [Fix(t_ns=T0 + S, floor="F", xy=np.array([x, 0.0]), source=s) for x, s in ((1, "b"), (2, "a"), (0, "b"))]
    for one, two in zip(events + fixes, reversed(events + fixes), strict=True):
        timeline.insert(one)
        other.insert(two)
    k = tick_of(T0) + 1
    said = [(s.t_ns, s.source, s.transmitters) for s in timeline.scans(k)]
    assert said == [(s.t_ns, s.source, s.transmitters) for s in other.scans(k)]
    assert [s[2] for s in said] == [("z",), ("a",), ("a",), ("b",)]
    k = tick_of(T0 + S)
    assert [(f.source, f.xy[0]) for f in timeline.fixes(k)] == [(f.source, f.xy[0]) for f in other.fixes(k)]


def test_a_window_holds_each_reading_once_by_the_scan_that_brought_it_first(timeline: Timeline) -> None:
    t = [T0 + S * n for n in range(8)]
    first = Scan(transmitters=("b", "a"), rssi_dbm=np.array([-50.0, -60.0]), heard_ns=np.array([t[2], t[1]]))
    second = Scan(transmitters=("b", "c"), rssi_dbm=np.array([-50.0, -70.0]), heard_ns=np.array([t[2], t[4]]))
    beacon = Scan(transmitters=("x",), rssi_dbm=np.array([-50.0]), heard_ns=np.array([t[3]]), source="ble")
    for event in (second, beacon, first):
        timeline.insert(event)
    window = timeline.window(second, Window(seconds=5.0))
    assert window.transmitters == ("a", "b", "c")
    assert window.scan.tolist() == [0, 0, 1]
    assert window.scan_t_ns == (t[2], t[4])
    assert timeline.window(second, Window(seconds=2.5)).transmitters == ("b", "c")
    assert timeline.window(second, Window(scans=1)).transmitters == ("b", "c")
    assert timeline.window(second, Window(scans=1)).scan_t_ns == (t[4],)
    assert timeline.window(first, Window()).transmitters == ("a", "b")


def test_what_was_inserted_behind_a_closed_tick_is_late(timeline: Timeline) -> None:
    timeline.insert(sample(5))
    timeline.close(tick_of(T0 + 5 * S))
    assert timeline.insert(scan(1.0, "a")).outcome is MessageOutcome.LATE
    assert timeline.changes.scans == tick_of(T0 + S)


def test_forgetting_drops_ticks_but_not_the_readings_of_later_windows(timeline: Timeline) -> None:
    old, new = scan(0.0, "a"), scan(59.0, "b")
    timeline.insert(old)
    timeline.insert(new)
    timeline.forget(tick_of(new.t_ns))
    assert timeline.scans(tick_of(T0)) == []
    assert timeline.window(new, Window(seconds=60.0)).transmitters == ("a", "b")
