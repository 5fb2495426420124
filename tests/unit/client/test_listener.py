"""A listener tells estimates, and what it missed."""

from __future__ import annotations

import time

import pytest

from tickfix.api import Belief, Estimate, Status
from tickfix.client import Listener
from tickfix.wire import encode_estimate, stream_topics

PATIENCE_S = 60.0


@pytest.fixture
def listen(sockets):
    """Return a function that opens a listener whose subscriptions have arrived."""
    opened = []

    def open_listener(topics=("estimate/",), **options):
        listener = Listener(sockets.positions, topics, context=sockets.context, **options)
        assert len(sockets.subscriptions(len(topics) + 1)) == len(topics) + 1
        opened.append(listener)
        return listener

    yield open_listener
    for listener in opened:
        listener.close()


def say(sockets, seq, *, floor="F1", device="d", run="r1", family="estimate"):
    belief = Belief(floor=floor, xy=[1.0, -0.0], covariance=[[1.0, 0.0], [0.0, 1.0]])
    estimate = Estimate(device=device, pipeline="p", epoch=0, tick=seq, t_ns=seq, status=Status.TRACKING, belief=belief)
    for topic in stream_topics(family, "mall", floor, device, "p"):
        sockets.publish(topic, seq, encode_estimate(estimate), run)


def test_estimates_come_as_maps(sockets, listen):
    listener = listen()
    say(sockets, 1)
    estimate = listener.receive(PATIENCE_S)
    assert (estimate["device"], estimate["status"], estimate["belief"]["xy"]) == ("d", "tracking", [1.0, -0.0])
    assert listener.run == "r1"


def test_iteration_ends_when_nothing_comes(sockets, listen):
    told = []
    # No time passes before all have come.
    listener = listen(timeout_s=0.5, clock=lambda: time.monotonic() if len(told) == 3 else 0.0)
    for seq in (1, 2, 3):
        say(sockets, seq)
    for estimate in listener:
        told += [estimate["tick"]]
    assert told == [1, 2, 3]


def test_gaps_are_told_by_stream(sockets, listen):
    gaps = []
    listener = listen(on_gap=lambda *gap: gaps.append(gap))
    for seq, device in ((7, "d/1"), (4, "e"), (8, "d/1"), (11, "d/1"), (5, "e")):
        say(sockets, seq, device=device)
        listener.receive(PATIENCE_S)
    assert gaps == [("mall", "d/1", "p", 2)]
    assert listener.missed == 2


def test_a_gap_is_seen_across_floors(sockets, listen):
    listener = listen(("estimate/mall/",))
    for seq, floor in ((1, "F1"), (2, "F2"), (4, "F1")):
        say(sockets, seq, floor=floor)
        listener.receive(PATIENCE_S)
    assert listener.missed == 1


def test_who_chooses_a_floor_hears_of_no_gaps(sockets, listen):
    listener = listen(("estimate/mall/F1/",))
    for seq, floor in ((1, "F1"), (2, "F2"), (3, "F1")):
        say(sockets, seq, floor=floor)
    assert [listener.receive(PATIENCE_S)["tick"] for _ in range(2)] == [1, 3]
    assert listener.missed == 0


def test_topics_by_device_have_numbers_of_their_own(sockets, listen):
    listener = listen(("device/mall/d/",))
    for seq in (1, 3):
        say(sockets, seq)
    assert [listener.receive(PATIENCE_S)["tick"] for _ in range(2)] == [1, 3]
    assert listener.missed == 1


def test_the_same_again_is_not_told_twice(sockets, listen):
    listener = listen()
    for seq in (1, 2, 2, 3):
        say(sockets, seq)
    assert [listener.receive(PATIENCE_S)["tick"] for _ in range(3)] == [1, 2, 3]
    assert (listener.duplicates, listener.missed) == (1, 0)


def test_another_run_begins_anew(sockets, listen):
    runs = []
    listener = listen(on_new_run=runs.append)
    say(sockets, 9)
    say(sockets, 9, run="r2")
    say(sockets, 10, run="r2")
    assert [listener.receive(PATIENCE_S)["tick"] for _ in range(3)] == [9, 9, 10]
    assert (runs, listener.run, listener.missed) == (["r2"], "r2", 0)


def test_a_stream_that_begins_anew_within_a_run_is_heard(sockets, listen):
    listener = listen()
    for seq in (50, 1, 2):
        say(sockets, seq)
    assert [listener.receive(PATIENCE_S)["tick"] for _ in range(3)] == [50, 1, 2]
    assert listener.missed == 0


def test_heartbeats_are_kept_and_are_no_estimates(sockets, listen):
    listener = listen()
    sockets.beat(1)
    say(sockets, 1)
    assert listener.receive(PATIENCE_S)["tick"] == 1
    assert listener.heartbeat["site"] == "mall"


def test_silence_is_told_once_and_ends_with_a_heartbeat(sockets, listen, until):
    silences = []
    listener = listen(heartbeat_timeout_s=0.05, on_heartbeat_timeout=silences.append)
    assert listener.receive(0.3) is None
    assert len(silences) == 1
    assert silences[0] >= 0.05
    sockets.beat(1)
    until(lambda: listener.heartbeat, lambda: listener.receive(0.01))
    until(lambda: len(silences) == 2, lambda: listener.receive(0.01))


def test_what_is_no_publication_is_passed_over(sockets, listen):
    listener = listen()
    sockets.xpub.send_multipart([b"estimate/x"])
    sockets.xpub.send_multipart([b"estimate/x", b"\xc1", b"\x80"])
    sockets.xpub.send_multipart([b"estimate/mall/F1/d/p", b"\x80", b"\xff"])
    say(sockets, 1)
    assert listener.receive(PATIENCE_S)["tick"] == 1
