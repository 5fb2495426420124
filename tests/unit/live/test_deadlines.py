"""When ticks close by themselves: offsets that survive jitter, drift, steps and silence."""

from __future__ import annotations

import numpy as np
import pytest

from tickfix.api import TICK_NS
from tickfix.live.scheduler import ClockOffset, Deadlines

S = 1_000_000_000
MS = 1_000_000
BOOT = 86_400 * S


def test_the_offset_is_that_of_the_fastest_message_whatever_the_jitter() -> None:
    rng, offset = np.random.default_rng(1), ClockOffset()
    for n in range(1000):
        offset.observe(n * 50 * MS, BOOT + n * 50 * MS + 20 * MS + int(rng.exponential(40 * MS)))
    assert offset.offset_ns is not None
    assert 20 * MS <= offset.offset_ns - BOOT <= 22 * MS


@pytest.mark.parametrize("drift", [-100e-6, 100e-6])
def test_the_offset_follows_a_clock_that_drifts(drift: float) -> None:
    offset = ClockOffset()
    for n in range(36_000):  # an hour
        now_ns = n * 100 * MS
        offset.observe(round(now_ns * (1.0 + drift)), BOOT + now_ns)
        if n > 600:
            assert offset.offset_ns is not None
            assert abs(offset.offset_ns - (BOOT - round(now_ns * drift))) < 4 * MS


def test_the_offset_follows_a_clock_that_steps_back_within_seconds() -> None:
    offset = ClockOffset()
    for n in range(400):
        step_ns = 3 * S if n >= 200 else 0
        offset.observe(n * 100 * MS - step_ns, BOOT + n * 100 * MS)
    assert offset.offset_ns == BOOT + 3 * S


def test_the_offset_follows_a_clock_that_steps_ahead_at_once() -> None:
    offset = ClockOffset()
    offset.observe(0, BOOT)
    offset.observe(7 * S, BOOT + 1 * S)
    assert offset.offset_ns == BOOT - 6 * S


def deadlines() -> Deadlines:
    return Deadlines(grace_ns=300 * MS, coast_ns=2 * S)


def test_a_tick_is_due_a_grace_after_its_time_on_our_clock() -> None:
    due = deadlines()
    due.observe("d", 10 * TICK_NS, 11, arrival_ns=BOOT + 10 * TICK_NS)
    assert due.next_ns() == BOOT + 11 * TICK_NS + 300 * MS
    assert due.due(BOOT + 11 * TICK_NS + 300 * MS - 1) == []
    assert due.due(BOOT + 11 * TICK_NS + 300 * MS) == [("d", 11, BOOT + 11 * TICK_NS + 300 * MS)]


def test_a_loop_that_is_late_closes_all_that_is_due_at_once() -> None:
    due = deadlines()
    due.observe("d", 10 * TICK_NS, 11, arrival_ns=BOOT + 10 * TICK_NS)
    ((device, tick, _),) = due.due(BOOT + 15 * TICK_NS + 300 * MS)
    assert (device, tick) == ("d", 15)


def test_a_silent_device_gets_its_ticks_for_a_while_and_then_they_wait_for_it() -> None:
    due = deadlines()
    due.observe("d", 10 * TICK_NS, 11, arrival_ns=BOOT + 10 * TICK_NS)
    closed = []
    now_ns = BOOT + 10 * TICK_NS
    for _ in range(1000):
        now_ns += 50 * MS
        for device, tick, _ in due.due(now_ns):
            closed.append(tick)
            due.closed(device, tick + 1)
    assert closed == list(range(11, 21))
    assert due.next_ns() is None
    due.observe("d", 30 * TICK_NS, 21, arrival_ns=now_ns)
    assert due.next_ns() is not None


def test_a_clock_that_starts_anew_gets_an_offset_of_its_own() -> None:
    due = deadlines()
    due.observe("d", 10_000 * S, 50_001, arrival_ns=BOOT)
    due.observe("d", 5 * S, 26, arrival_ns=BOOT + S)
    assert due.offset_ns("d") == BOOT + S - 5 * S
    assert due.next_ns() == BOOT + S - 5 * S + 26 * TICK_NS + 300 * MS


def test_devices_come_in_the_order_of_their_deadlines_and_can_be_forgotten() -> None:
    due = deadlines()
    for n, device in enumerate("abc"):
        due.observe(device, 10 * TICK_NS, 11, arrival_ns=BOOT + 10 * TICK_NS - n * MS)
    due.forget("b")
    assert [device for device, _, _ in due.due(BOOT + 20 * TICK_NS)] == ["c", "a"]
    assert due.idle(BOOT + 60 * S) == ["a", "c"]
    assert due.idle(BOOT) == []
