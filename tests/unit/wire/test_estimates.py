"""Estimates become bytes and come back, bit for bit."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from wire_strategies import ESTIMATES, content

from tickfix.api import Belief, Estimate, Status
from tickfix.wire import WireError, decode_estimate, encode_estimate

PLAIN = Estimate(
    device="d",
    pipeline="p",
    epoch=0,
    tick=5,
    t_ns=10**9,
    status=Status.TRACKING,
    belief=Belief(floor="F1", xy=[1.0, 2.0], covariance=np.eye(2)),
)


@given(ESTIMATES)
def test_an_estimate_comes_back_bit_for_bit(estimate):
    data = encode_estimate(estimate)
    assert content(decode_estimate(data)) == content(estimate)
    assert encode_estimate(decode_estimate(data)) == data


@given(ESTIMATES)
def test_keys_stand_in_order_and_every_field_is_there(estimate):
    fields = msgpack.unpackb(encode_estimate(estimate))
    assert list(fields) == sorted(fields)
    expected = {"v", "type", *Estimate.__dataclass_fields__}
    assert set(fields) == (expected if estimate.diagnostics else expected - {"diagnostics"})
    if estimate.belief is not None:
        assert list(fields["belief"]) == sorted(Belief.__dataclass_fields__)


def test_diagnostics_are_sorted_and_leave_the_bytes_alone_when_there_are_none():
    told = replace(PLAIN, diagnostics={"nis": 2.0, "ess": np.float64(81.5)})
    fields = msgpack.unpackb(encode_estimate(told))
    assert list(fields["diagnostics"].items()) == [("ess", 81.5), ("nis", 2.0)]
    assert decode_estimate(encode_estimate(told)).diagnostics == {"ess": 81.5, "nis": 2.0}
    assert "diagnostics" not in msgpack.unpackb(encode_estimate(PLAIN))
    assert b"diagnostics" not in encode_estimate(replace(PLAIN, diagnostics={}))


def test_numbers_of_numpy_have_the_bytes_of_plain_ones():
    odd = replace(PLAIN, tick=np.int64(5), t_ns=np.int64(10**9), nis=np.float64(0.5), innovation_m=np.float64(-0.0))
    assert encode_estimate(odd) == encode_estimate(replace(PLAIN, nis=0.5, innovation_m=-0.0))


def test_lone_surrogates_of_a_failure_do_not_stop_the_publication():
    said = decode_estimate(encode_estimate(replace(PLAIN, failed_by="filter: \ud800 é", reasons=("\udfff",))))
    assert said.failed_by == "filter: \\ud800 é"
    assert said.reasons == ("\\udfff",)


def test_integers_beyond_64_bits_are_refused():
    with pytest.raises(WireError, match="64 bits"):
        encode_estimate(replace(PLAIN, tick=2**70))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"status": "flying"}, "status: found 'flying'; expected one of the values known here"),
        ({"type": "motion"}, "type: found 'motion'; expected one of the values known here"),
        ({"v": 2}, "v: found 2; expected at most 1"),
        ({"tick": 1.5}, "tick: found 1.5; expected int"),
        ({"belief": {"floor": "F", "xy": [1.0], "covariance": [[1, 0], [0, 1]]}}, "belief.xy: found 1 elements"),
        ({"belief": {"floor": "F", "xy": [1.0, "b"], "covariance": []}}, "belief.xy[1]: found 'b'; expected float"),
        ({"belief": {"floor": "F", "xy": [1, 2]}}, "belief.covariance: found nothing; expected the field"),
    ],
)
def test_what_is_no_estimate_is_named(change, text):
    fields = msgpack.unpackb(encode_estimate(PLAIN)) | change
    with pytest.raises(WireError) as caught:
        decode_estimate(msgpack.packb(fields))
    assert str(caught.value).startswith(text)


@given(ESTIMATES, st.data())
def test_a_damaged_estimate_is_refused_or_is_another_estimate(estimate, data):
    whole = bytearray(encode_estimate(estimate))
    whole[data.draw(st.integers(0, len(whole) - 1))] ^= data.draw(st.integers(1, 255))
    with suppress(WireError):
        encode_estimate(decode_estimate(bytes(whole)))
