"""Who speaks for which device."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tickfix.ports.peers import DeviceSessions
from tickfix.wire import ReplyOutcome

SECOND_NS = 1_000_000_000


@pytest.fixture
def device_sessions() -> DeviceSessions:
    """Room for three devices; a device silent for two seconds is free to others, for a minute is forgotten."""
    return DeviceSessions(3, 2 * SECOND_NS, 60 * SECOND_NS)


def test_a_second_speaker_is_refused_by_name(device_sessions: DeviceSessions) -> None:
    assert device_sessions.admit("p", "s", "one", limit=9, now_ns=0) is None
    refusal = device_sessions.admit("p", "t", "two", limit=9, now_ns=SECOND_NS)
    assert refusal is not None
    assert (refusal.outcome, refusal.field) == (ReplyOutcome.UNAUTHORISED, "device")
    assert device_sessions.admit("p", "s", "one", limit=9, now_ns=SECOND_NS) is None


def test_the_last_hello_wins(device_sessions: DeviceSessions) -> None:
    device_sessions.admit("p", "s", "one", limit=9, now_ns=0, hello=True)
    assert device_sessions.admit("p", "t", "two", limit=9, now_ns=1, hello=True) is None
    refusal = device_sessions.admit("p", "s2", "one", limit=9, now_ns=2)
    assert refusal is not None
    assert refusal.outcome is ReplyOutcome.UNAUTHORISED


def test_a_session_goes_on_over_another_connection(device_sessions: DeviceSessions) -> None:
    device_sessions.admit("p", "s", "one", limit=9, now_ns=0, hello=True)
    assert device_sessions.admit("p", "s", "two", limit=9, now_ns=1) is None
    assert (device_sessions.count_of_peer("one"), device_sessions.count_of_peer("two")) == (0, 1)


def test_without_a_session_name_a_connection_is_followed_only_after_silence(device_sessions: DeviceSessions) -> None:
    device_sessions.admit("p", "", "one", limit=9, now_ns=0)
    assert device_sessions.admit("p", "", "two", limit=9, now_ns=2 * SECOND_NS) is not None
    assert device_sessions.admit("p", "", "two", limit=9, now_ns=2 * SECOND_NS + 1) is None


def test_positions_computed_elsewhere_come_beside_the_device_and_never_lock_it_out(
    device_sessions: DeviceSessions,
) -> None:
    assert device_sessions.admit("p", "locate", "locator", limit=9, now_ns=0, sensor=False) is None
    assert device_sessions.admit("p", "s", "phone", limit=9, now_ns=1) is None
    assert device_sessions.admit("p", "locate", "locator", limit=9, now_ns=2, sensor=False) is None
    assert device_sessions.admit("p", "s", "phone", limit=9, now_ns=3) is None
    assert (device_sessions.count_of_peer("locator"), device_sessions.count_of_peer("phone")) == (0, 1)


def test_devices_are_limited_for_each_peer_and_in_all_and_idle_ones_make_room(device_sessions: DeviceSessions) -> None:
    assert device_sessions.admit("a", "", "one", limit=1, now_ns=0) is None
    refusal = device_sessions.admit("b", "", "one", limit=1, now_ns=0)
    assert refusal is not None
    assert (refusal.outcome, refusal.expected) == (ReplyOutcome.BUSY, "at most 1 devices of one peer")
    for device in ("b", "c"):
        assert device_sessions.admit(device, "", "two", limit=9, now_ns=30 * SECOND_NS) is None
    refusal = device_sessions.admit("d", "", "two", limit=9, now_ns=50 * SECOND_NS)
    assert refusal is not None
    assert (refusal.outcome, refusal.expected) == (ReplyOutcome.BUSY, "at most 3 devices in all")
    assert device_sessions.admit("d", "", "two", limit=9, now_ns=61 * SECOND_NS) is None
    assert "a" not in device_sessions


def test_a_device_that_left_makes_room_at_once(device_sessions: DeviceSessions) -> None:
    device_sessions.admit("a", "", "one", limit=1, now_ns=0)
    device_sessions.forget("a")
    device_sessions.forget("a")
    assert device_sessions.admit("b", "", "one", limit=1, now_ns=0) is None


STEPS = st.tuples(
    st.sampled_from("abcdef"), st.sampled_from(["", "s", "t"]), st.sampled_from(["one", "two", "three"]),
    st.integers(0, 90 * SECOND_NS), st.booleans(), st.booleans(), st.booleans(),
)  # fmt: skip


@given(st.lists(STEPS, max_size=60))
def test_the_counts_are_right_whatever_comes(steps: list[tuple[str, str, str, int, bool, bool, bool]]) -> None:
    device_sessions = DeviceSessions(4, 2 * SECOND_NS, 60 * SECOND_NS)
    now_ns = 0
    for device, session, peer, step_ns, hello, sensor, leaves in steps:
        now_ns += step_ns
        refusal = device_sessions.admit(device, session, peer, limit=2, now_ns=now_ns, hello=hello, sensor=sensor)
        assert refusal is not None or device in device_sessions
        if leaves:
            device_sessions.forget(device)
        counts = [device_sessions.count_of_peer(name) for name in ("one", "two", "three")]
        assert sum(counts) == len(device_sessions) <= 4
        assert all(0 <= count <= 2 for count in counts)
