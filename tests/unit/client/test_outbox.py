"""Whatever a network loses, repeats and delays, every message counts once in the end."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tickfix.client.session import SEND_WINDOW, RetransmitBuffer
from tickfix.kernel.deduplication import _WINDOW_LENGTH, SequenceWindow
from tickfix.ports.sockets import HIGH_WATER_MARKS

PAGE = Path(__file__).parents[3] / "docs" / "wire-protocol.md"


def outbox(**changes):
    return RetransmitBuffer(**({"most_messages": 5000, "most_bytes": 10**6, "resend_s": 1.0} | changes))


class Network:
    """Loses, repeats and reorders, between an outbox and an engine that is busy at times."""

    def __init__(self, rng):
        self.rng = rng
        self.loss = rng.random() * 0.6
        self.busy = rng.random() * 0.3
        self.box = outbox()
        self.engine = SequenceWindow()
        self.counted = []
        self.under_way = []

    def carry(self, now_s):
        for number, _ in self.box.due(now_s):
            self.box.sent(number, now_s)
            if self.rng.random() >= self.loss:
                self.under_way.extend([number] * self.rng.choice([1, 1, 1, 2]))
        if self.rng.random() < 0.3:
            self.rng.shuffle(self.under_way)

    def deliver(self, n, now_s):
        arriving, self.under_way = self.under_way[:n], self.under_way[n:]
        for number in arriving:
            if self.rng.random() < self.busy:
                self.box.defer(number, now_s)
                continue
            if self.engine.is_new(number):
                self.counted.append(number)
            if self.rng.random() >= self.loss:
                self.box.forget(number)


@given(st.integers(1, 400), st.randoms(use_true_random=True))
@settings(max_examples=60)
def test_every_message_counts_once_whatever_the_network_does(n, rng):
    """The engine's end is the very class that recognises duplicates there."""
    network = Network(rng)
    seq = turn = 0
    while seq < n or len(network.box):
        now_s = 0.3 * turn
        if seq < n and rng.random() < 0.7:
            seq += 1
            network.box.add(seq, b"x")
        network.carry(now_s)
        network.deliver(rng.randint(0, 40), now_s)
        if rng.random() < 0.02:
            network.box.mark_all_due()
        turn += 1
        if turn == 2000:  # a network that never delivers proves nothing
            network.loss = network.busy = 0.0
        assert turn < 5000
    assert sorted(network.counted) == list(range(1, n + 1))


def test_the_window_is_within_what_an_engine_remembers_and_answers():
    # libzmq gives room back in halves of the high-water mark.
    assert SEND_WINDOW < HIGH_WATER_MARKS["sensors"] // 2 < _WINDOW_LENGTH
    assert f"`tickfix.client` has {SEND_WINDOW}." in PAGE.read_text(encoding="utf-8")


def test_it_counts_what_it_keeps():
    box = outbox(most_messages=3, most_bytes=10)
    box.add(1, b"1234")
    box.add(2, b"12345")
    assert (len(box), box.buffered_bytes, box.oldest(), 2 in box, 3 in box) == (2, 9, 1, True, False)
    assert box.fits(1)
    assert not box.fits(2)
    assert box.forget(1)
    assert not box.forget(1)
    assert (len(box), box.buffered_bytes, box.oldest()) == (1, 5, 2)


def test_nothing_kept_is_never_due():
    assert outbox().next_due_s() is None
    assert outbox().due(1e9) == []


def test_patience_grows_and_ends_at_sixteen_times():
    box = outbox(resend_s=1.0)
    box.add(1, b"")
    waits = []
    for _ in range(7):
        box.sent(1, 0.0)
        waits.append(box.next_due_s())
    assert waits == [1.0, 2.0, 4.0, 8.0, 16.0, 16.0, 16.0]


def test_a_new_connection_makes_all_due_and_patient_anew():
    box = outbox(resend_s=1.0)
    box.add(1, b"")
    for _ in range(3):
        box.sent(1, 50.0)
    box.mark_all_due()
    assert box.due(0.0) == [(1, b"")]
    box.sent(1, 50.0)
    assert box.next_due_s() == 51.0


def test_busy_for_a_message_that_is_done_with_changes_nothing():
    box = outbox()
    box.defer(9, 1.0)
    with pytest.raises(StopIteration):
        box.oldest()
