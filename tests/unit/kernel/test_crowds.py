"""What no honest device sends so much of is bounded, and what is kept does not depend on the order of arrival."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from streams import SETTINGS, T0, S, run, scan, settled, walk
from toys import toy_pipeline

from tickfix.api import TICK_NS, Fix, Samples, motion_samples
from tickfix.api.events import MotionSamples
from tickfix.kernel import QUARANTINED, Kernel, KernelOutput, MessageOutcome, StageFailure
from tickfix.kernel.timeline import MAX_ADVANCE_NS, Timeline

TICK = T0 // TICK_NS
LENIENT = replace(SETTINGS, strict=False)


@settings(max_examples=20)
@given(st.permutations(range(14)), st.sampled_from([1, 100, 1_400]))
def test_of_too_many_samples_of_a_tick_the_first_stand_in_whatever_order_they_come(parts: list[int], size: int) -> None:
    timeline = Timeline(10 * S, Counter())
    for part in parts:
        t_ns = T0 - TICK_NS + 1 + part * 100 + np.arange(100)
        for begin in range(0, 100, size):
            some = t_ns[begin : begin + size]
            timeline.insert(motion_samples(some, gyroscope=np.outer(some % 7, np.ones(3))))
    kept = timeline.motion(TICK).sensors["gyroscope"]
    assert kept.t_ns.tolist() == [T0 - TICK_NS + 1 + n for n in range(512)]
    assert kept.values[:, 0].tolist() == [float(t % 7) for t in kept.t_ns.tolist()]


def test_samples_left_out_are_counted_and_a_tick_holds_no_more_however_many_come() -> None:
    counts: Counter[str] = Counter()
    timeline = Timeline(10 * S, counts)
    for n in range(40):
        t_ns = T0 - 1 - n * 100 - np.arange(100)
        timeline.insert(motion_samples(t_ns, gyroscope=np.zeros((100, 3))))
    held = timeline._intervals[TICK].samples["gyroscope"]
    assert held._by_time is not None
    assert len(held._by_time) <= 1_024
    assert counts["accepted"] == 4_000
    assert counts["overflow"] == 4_000 - len(held._by_time)


@settings(max_examples=2)
@given(st.permutations(range(90)))
def test_of_too_many_scans_and_fixes_of_a_tick_the_first_stand_in_whatever_order_they_come(order: list[int]) -> None:
    crowd = [
        *(scan(0.1 + n / 1_000, f"ap {n}") for n in range(90)),
        *(Fix(t_ns=T0 + 100_000_000 + n, floor="F", xy=np.full(2, n), device="d") for n in range(90)),
    ]
    first = [e for e in crowd if e.t_ns < T0 + (164_000_000 if not isinstance(e, Fix) else 100_000_064)]
    assert len(first) == 128
    some = [crowd[n + k] for n in order for k in (0, 90)]
    folded = run([*walk(0, 1), *some, *walk(1, 3), scan(2.5, "x")])
    assert folded.settled_as("d", "toy") == run([*walk(0, 1), *first, *walk(1, 3), scan(2.5, "x")]).settled_as(
        "d", "toy"
    )
    assert folded.measurements["overflow"] == 2 * 26


def test_one_message_takes_the_clock_ten_minutes_further_at_most() -> None:
    times = T0 + 59 * S * np.arange(4_096)
    wild = MotionSamples(sensors={"pressure": Samples(times, np.ones((4_096, 1)))}, device="d")
    folded = run([wild])
    assert folded.outcomes == (MessageOutcome.ACCEPTED,)
    n_used = MAX_ADVANCE_NS // (59 * S) + 1
    assert settled(folded)[-1].tick == TICK + -(-59 * S * n_used // TICK_NS)
    assert folded.measurements["dropped"] == 4_096 - n_used - 1
    again = run([wild, replace(wild, seq=7)])
    assert settled(again)[-1].tick > settled(folded)[-1].tick


def test_samples_held_a_minute_after_each_other_lead_no_further_than_a_minute_when_the_device_leaves() -> None:
    times = T0 + 59 * S * np.arange(1, 4_000)
    wild = MotionSamples(sensors={"pressure": Samples(times, np.ones((len(times), 1)))}, device="d")
    folded = run([*walk(0, 2), wild])
    assert settled(folded)[-1].t_ns == T0 + 59 * S
    assert folded.measurements["dropped"] == len(times) - 1


def test_one_message_begins_one_epoch_at_most() -> None:
    times = np.concatenate([T0 + 100 * S * n + S * np.arange(3) for n in range(1, 1_000)])
    rows = np.tile([0.0, 0.0, 9.8], (len(times), 1))
    wild = motion_samples(times, accelerometer=rows, device="d")
    folded = run([*walk(0, 2), wild])
    assert {e.epoch for e in settled(folded)} == {0, 1}
    assert folded.measurements["dropped"] > 2_900


def test_a_driver_may_close_a_few_ticks_at_a_time_and_comes_to_the_same() -> None:
    whole, parts = Kernel([toy_pipeline()], SETTINGS), Kernel([toy_pipeline()], SETTINGS)
    events = [scan(0.1, "a"), *walk(0, 2), *walk(50, 52)]
    for event in events:
        whole.feed(event)
        parts.feed(event)
    said = whole.run("d")
    pieces = []
    while (progress := parts.progress("d")) is not None and progress.backlog:
        piece = parts.run("d", None, 7)
        assert len(piece.published) == min(7, progress.backlog)
        pieces.append(piece)
    assert [e.tick for p in pieces for e in p.published] == [e.tick for e in said.published]
    assert [e.belief.xy.tolist() for p in pieces for e in p.published if e.belief] == [
        e.belief.xy.tolist() for e in said.published if e.belief
    ]
    assert parts.run("d").published == []


@pytest.mark.parametrize("where", ["insert", "close", "finish"])
def test_a_device_that_the_kernel_breaks_on_is_lost_alone(where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = getattr(Timeline, where)

    def broken(self: Timeline, *args: Any, **more: Any) -> Any:
        if marked in self._counts:
            raise ZeroDivisionError("a defect")
        return honest(self, *args, **more)

    marked = "a kernel with a defect"
    monkeypatch.setattr(Timeline, where, broken)
    told: list[StageFailure] = []
    kernel = Kernel([toy_pipeline()], LENIENT, on_failure=told.append)
    events = [replace(event, device=device) for event in walk(0, 2) for device in ("d", "other")]
    for event in events:
        kernel.feed(event)
    kernel.run_many([("d", None), ("other", None)])
    kernel.measurements[marked] = 1
    if where == "insert":
        assert kernel.feed(walk(2, 3)[0]) is MessageOutcome.MALFORMED
    elif where == "close":
        assert kernel.run("d", TICK + 20) == KernelOutput()
    else:
        assert kernel.finish("d") == KernelOutput()
    del kernel.measurements[marked]
    assert kernel.devices == ("other",)
    assert kernel.failures == {f"{QUARANTINED}: ZeroDivisionError": 1}
    assert "a defect" in told[0].detail
    kernel.feed(replace(walk(2, 3)[0], device="other"))
    assert kernel.run("other", TICK + 12).published
    kernel.snapshot()


def test_in_a_strict_run_the_defect_itself_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = Kernel([toy_pipeline()], SETTINGS)
    monkeypatch.delattr(Timeline, "insert")
    with pytest.raises(AttributeError, match="insert"):
        kernel.feed(walk(0, 2)[0])


def test_a_device_that_is_abandoned_says_nothing_and_begins_anew() -> None:
    kernel = Kernel([toy_pipeline()], SETTINGS)
    for event in walk(0, 2):
        kernel.feed(event)
    kernel.abandon("d")
    kernel.abandon("nobody")
    assert kernel.devices == ()
    assert kernel.run("d").published == []
    kernel.feed(walk(0, 2)[-1])
    progress = kernel.progress("d")
    assert progress is not None
    assert progress.epoch == 1
