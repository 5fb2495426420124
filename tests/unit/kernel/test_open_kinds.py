"""Sensors and sources that the core does not know are kept in order, windowed and restored like those that it does."""

from __future__ import annotations

from collections import Counter
from itertools import permutations

import numpy as np
import pytest
from streams import T0, S, sample

from tickfix.api import EventError, MotionSamples, Readings, Samples, Scan, Window, pack, unpack
from tickfix.kernel.measurements import RecentScans, tick_of
from tickfix.kernel.snapshot import TimelineSnapshot
from tickfix.kernel.timeline import Timeline


def light(t_s: float, *row: float, name: str = "light") -> MotionSamples:
    return MotionSamples(sensors={name: Samples(np.array([T0 + round(t_s * S)]), np.array([row]))})


def ranges(t_s: float, *readings: tuple[str, float, float], source: str = "uwb") -> Scan:
    names, range_m, sigma_m = zip(*readings, strict=True)
    heard_ns = np.full(len(names), T0 + round(t_s * S))
    return Scan(
        transmitters=names,
        heard_ns=heard_ns,
        source=source,
        values={"range_sigma_m": np.array(sigma_m), "range_m": np.array(range_m)},
    )


def timeline(*events: MotionSamples | Scan) -> Timeline:
    made = Timeline(10 * S, Counter())
    for event in events:
        made.insert(event)
    return made


def restored(one: Timeline) -> Timeline:
    other = Timeline(10 * S, Counter())
    other.restore(unpack(pack(one.snapshot()), TimelineSnapshot))
    return other


def test_a_sensor_of_any_name_stands_among_the_samples_of_its_tick() -> None:
    samples = timeline(sample(0.1), light(0.1, 300.0, 2.0)).motion(tick_of(T0) + 1)
    assert list(samples.sensors) == ["accelerometer", "light"]
    assert samples.sensors["light"].values.tolist() == [[300.0, 2.0]]


def test_the_watermark_does_not_wait_for_a_sensor_of_another_name() -> None:
    assert timeline(light(0.1, 1.0), sample(0.3), sample(0.9)).watermark == tick_of(T0) + 4


def test_a_known_sensor_is_checked_and_any_other_must_have_columns() -> None:
    for name, columns, expected in (("gyroscope", 2, "3"), ("light", 0, "1 to 64"), ("light", 65, "1 to 64")):
        with pytest.raises(EventError, match=f"{name}: found {columns} columns, expected {expected}"):
            MotionSamples(sensors={name: Samples([1], np.zeros((1, columns)))})


def test_of_rows_of_different_width_in_a_tick_the_narrowest_stand_in_any_order() -> None:
    events = [sample(0.01), light(0.1, 1.0, 2.0), light(0.12, 5.0), light(0.14, 3.0, 4.0), light(0.16, 6.0)]
    for order in permutations(events[1:]):
        one = timeline(events[0], *order)
        assert one.motion(tick_of(T0) + 1).sensors["light"].values.tolist() == [[5.0], [6.0]]


def test_of_too_many_names_in_a_tick_the_first_stand_in_any_order() -> None:
    events = [light(0.1, float(n), name=f"sensor {n:02}") for n in range(20)]
    expected = [f"sensor {n:02}" for n in range(16)]
    for order in (events, events[::-1], events[10:] + events[:10]):
        assert list(timeline(*order).motion(tick_of(T0) + 1).sensors) == expected


def test_a_snapshot_holds_a_sensor_whose_width_changes() -> None:
    one = timeline(sample(0.1), light(0.1, 300.0, 2.0), light(0.3, 7.0))
    for k in (1, 2):
        before, after = (t.motion(tick_of(T0) + k).sensors["light"] for t in (one, restored(one)))
        assert before.values.tolist() == after.values.tolist() == ([[300.0, 2.0]] if k == 1 else [[7.0]])


def test_a_window_has_the_columns_of_its_scans() -> None:
    one = timeline(ranges(1, ("b", 5.0, 0.2), ("a", 3.0, 0.1)), ranges(2, ("a", 3.5, np.nan)))
    (newest,) = one.scans(tick_of(T0 + 2 * S))
    for found in (one, restored(one)):
        readings = found.window(newest, Window(seconds=5, sources=("uwb",)))
        assert (readings.source, readings.transmitters) == ("uwb", ("a", "b", "a"))
        assert readings.values["range_m"].tolist() == [3.0, 5.0, 3.5]
        np.testing.assert_array_equal(readings.values["range_sigma_m"], [0.1, 0.2, np.nan])
        assert np.isnan(readings.rssi_dbm).all()
        assert not readings.values["range_m"].flags.writeable
    assert Readings.of(newest).values["range_m"].tolist() == [3.5]


def test_a_column_that_a_scan_lacks_is_nan_in_the_window() -> None:
    first, second = ranges(1, ("a", 3.0, 0.1)), Scan(transmitters=("a",), rssi_dbm=[-60.0], heard_ns=[T0], source="uwb")
    readings = RecentScans((second,)).window(first, Window(seconds=5))
    np.testing.assert_array_equal(readings.values["range_m"], [np.nan, 3.0])
    np.testing.assert_array_equal(readings.rssi_dbm, [-60.0, np.nan])


def test_readings_without_a_number_or_with_an_infinite_one_are_left_out_and_counted() -> None:
    counts: Counter[str] = Counter()
    one = Timeline(10 * S, counts)
    one.insert(ranges(1, ("a", 3.0, np.nan), ("b", np.nan, np.nan), ("c", np.inf, 0.1)))
    (scan,) = one.scans(tick_of(T0 + S))
    assert (scan.transmitters, scan.values["range_m"].tolist()) == (("a",), [3.0])
    assert counts["invalid_readings"] == 2


def test_scans_that_differ_in_a_column_only_are_two() -> None:
    one = timeline(*[ranges(1, ("a", r, 0.1)) for r in (3.0, 4.0, 3.0)])
    assert [scan.values["range_m"].item() for scan in one.scans(tick_of(T0 + S))] == [3.0, 4.0]


def test_a_scan_without_further_columns_is_packed_as_it_always_was() -> None:
    scan = Scan(transmitters=("a",), rssi_dbm=[-60.0], heard_ns=[T0])
    assert pack(scan).count(b"values") == 0
    assert unpack(pack(scan), Scan).values == {}
    assert len(pack(ranges(1, ("a", 3.0, 0.1)))) > len(pack(scan))
