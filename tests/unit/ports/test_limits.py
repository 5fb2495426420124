"""How much one peer may send."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from tickfix.ports.peers import TokenBucket
from tickfix.ports.port_settings import PeerLimits

LIMITS = PeerLimits(messages_per_s=10.0, message_burst=5, bytes_per_s=1_000.0, byte_burst=2_000)
SECOND_NS = 1_000_000_000


def test_a_burst_goes_through_and_what_follows_waits_for_the_rate() -> None:
    bucket = TokenBucket(LIMITS, 0)
    assert [bucket.try_consume(1, 0) for _ in range(6)] == [True] * 5 + [False]
    assert not bucket.try_consume(1, SECOND_NS // 10 - 1)
    assert bucket.try_consume(1, SECOND_NS // 10)
    assert not bucket.try_consume(1, SECOND_NS // 10)


def test_bytes_count_apart_from_messages() -> None:
    bucket = TokenBucket(LIMITS, 0)
    assert bucket.try_consume(2_000, 0)
    assert not bucket.try_consume(1, 0)
    assert bucket.try_consume(500, SECOND_NS // 2)


def test_a_refused_message_costs_nothing() -> None:
    bucket = TokenBucket(LIMITS, 0)
    assert bucket.try_consume(1_500, 0)
    assert not any(bucket.try_consume(600, 0) for _ in range(100))
    assert bucket.try_consume(500, 0)


def test_buckets_hold_no_more_than_the_burst_however_long_the_silence() -> None:
    bucket = TokenBucket(LIMITS, 0)
    admitted = [bucket.try_consume(1, 3_600 * SECOND_NS) for _ in range(20)]
    assert admitted.count(True) == LIMITS.message_burst


@given(st.lists(st.tuples(st.integers(0, SECOND_NS), st.integers(0, 3_000)), max_size=200))
def test_never_more_than_burst_plus_rate_whatever_comes(steps: list[tuple[int, int]]) -> None:
    bucket = TokenBucket(LIMITS, 0)
    now_ns = messages = n_bytes = 0
    for step_ns, size in steps:
        now_ns += step_ns
        if bucket.try_consume(size, now_ns):
            messages += 1
            n_bytes += size
        assert messages <= LIMITS.message_burst + LIMITS.messages_per_s * now_ns / SECOND_NS + 1e-6
        assert n_bytes <= LIMITS.byte_burst + LIMITS.bytes_per_s * now_ns / SECOND_NS + 1e-6
