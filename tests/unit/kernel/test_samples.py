"""Samples of a tick are a set: neither order nor batches show in what is read, counted or noted as changed."""

from __future__ import annotations

import weakref
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tickfix.api import TICK_NS, MotionSamples, Samples
from tickfix.kernel.measurements import TickSamples, split_by_tick
from tickfix.kernel.timeline import Timeline

S = 1_000_000_000
T0 = 100 * S
PARTS = 40_000_000

measured = st.tuples(st.integers(0, 15), st.sampled_from([-1.0, -0.0, 0.0, 1.0]), st.sampled_from([-0.0, 0.0, 2.0]))
batches = st.lists(st.lists(measured, max_size=8), max_size=8)


def motion(rows: list[tuple[int, float, float]]) -> MotionSamples:
    t_ns = T0 + PARTS * np.array([n for n, _, _ in rows], np.int64)
    values = np.array([(a, b, 0.0) for _, a, b in rows]).reshape(len(rows), 3)
    return MotionSamples(sensors={"gyroscope": Samples(t_ns, values)}, t0_ns=T0, t1_ns=T0)


def begun() -> tuple[Timeline, Counter[str]]:
    counts: Counter[str] = Counter()
    timeline = Timeline(10 * S, counts)
    timeline.insert(motion([(8, 0.0, 0.0)]))
    timeline.close(T0 // TICK_NS + 1)
    timeline.changes.motion = None
    return timeline, counts


def read(timeline: Timeline) -> list[tuple[bytes, bytes]]:
    ticks = [timeline.motion(T0 // TICK_NS + k).sensors for k in range(5)]
    return [(s.t_ns.tobytes(), s.values.tobytes()) for sensors in ticks for s in sensors.values()]


@settings(max_examples=300)
@given(sent=batches, sort=st.booleans())
def test_a_batch_does_what_its_samples_one_by_one_do(sent: list[list[tuple[int, float, float]]], sort: bool) -> None:
    batched, batched_counts = begun()
    single, single_counts = begun()
    for batch in sent:
        rows = sorted(batch) if sort else batch
        batched.insert(motion(rows))
        for row in rows:
            single.insert(motion([row]))
    assert read(batched) == read(single)
    assert +batched_counts == +single_counts
    assert (batched.first, batched.newest_ns, batched.changes) == (single.first, single.newest_ns, single.changes)


@settings(max_examples=100)
@given(sent=batches)
def test_a_snapshot_holds_the_samples_whatever_they_came_in(sent: list[list[tuple[int, float, float]]]) -> None:
    timeline, _ = begun()
    for batch in sent:
        timeline.insert(motion(batch))
    restored = Timeline(10 * S, Counter())
    restored.restore(timeline.snapshot())
    assert read(restored) == read(timeline)
    for batch in sent:
        restored.insert(motion(batch))
    assert read(restored) == read(timeline)


def test_what_comes_again_is_neither_new_nor_a_change() -> None:
    samples = TickSamples()
    t_ns, rows = np.array([3, 5]), np.array([[1.0, 0.0], [2.0, 0.0]])
    assert samples.extend(t_ns, rows) == (2, True)
    assert samples.extend(t_ns, rows) == (0, False)
    assert samples.extend(t_ns, rows - [0.0, 1.0]) == (0, True)
    assert samples.extend(np.array([5, 9]), rows) == (1, True)
    assert samples.ordered().t_ns.tolist() == [3, 5, 9]
    assert samples.ordered().values.tolist() == [[1.0, -1.0], [1.0, 0.0], [2.0, 0.0]]


@pytest.mark.parametrize("n", [0, 1, 50])
def test_samples_belong_to_the_tick_that_closes_their_interval(n: int) -> None:
    t_ns = T0 + PARTS * np.arange(n)
    parts = list(split_by_tick(t_ns.tolist()))
    assert [k for tick, begin, end in parts for k in [tick] * (end - begin)] == (-(-t_ns // TICK_NS)).tolist()


def test_what_is_kept_does_not_hold_on_to_the_message() -> None:
    timeline, counts = begun()
    event = motion([(9, 1.0, 0.0), (10, 1.0, 0.0)])
    arrays = event.sensors["gyroscope"]
    message = [weakref.ref(arrays.t_ns), weakref.ref(arrays.values)]
    timeline.insert(event)
    del event, arrays
    assert counts["accepted"] == 3
    assert [array() for array in message] == [None, None]
