"""What the engine says to its peers, and what it can be asked."""

from __future__ import annotations

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tickfix.wire import (
    CONTROL_REQUESTS,
    VERSION,
    AckReply,
    ControlReply,
    MessageLimits,
    PublicationEnvelope,
    ReplyOutcome,
    WireError,
    decode_message,
    decode_request,
    encode_engine_message,
    error_reply,
)


def test_an_ack_is_a_map_with_its_type_and_version():
    ack = AckReply(v=VERSION, device="d", session="s", seq=3, outcome=ReplyOutcome.LATE)
    told = {"type": "ack", "v": 1, "device": "d", "session": "s", "seq": 3, "outcome": "late", "detail": ""}
    assert msgpack.unpackb(encode_engine_message(ack)) == told


def test_an_envelope_has_no_type():
    assert msgpack.unpackb(encode_engine_message(PublicationEnvelope(v=1, run="r", seq=9))) == {
        "v": 1,
        "run": "r",
        "seq": 9,
    }


def test_a_reply_carries_any_plain_data():
    data = {"lateness": [0.1, None], "ok": True}
    assert msgpack.unpackb(encode_engine_message(ControlReply(v=1, what="status", ok=True, data=data)))["data"] == data


def test_an_error_names_the_message_it_is_about():
    data = msgpack.packb({"v": 1, "type": "bye", "device": "d", "session": "s", "seq": 4, "ack": 2})
    with pytest.raises(WireError) as caught:
        decode_message(data, MessageLimits())
    error = error_reply(caught.value, data)
    assert (error.device, error.session, error.seq) == ("d", "s", 4)
    assert (error.field, error.found, error.expected, error.outcome) == ("ack", "2", "bool", ReplyOutcome.MALFORMED)


@given(
    st.binary(max_size=60)
    | st.dictionaries(
        st.sampled_from(["device", "session", "seq"]),
        st.integers() | st.text(st.characters(exclude_categories=["Cs"])),
        max_size=3,
    ).map(lambda d: msgpack.packb({k: v if isinstance(v, str) else v % 2**64 for k, v in d.items()}))
)
def test_an_error_can_be_told_whatever_the_message_was(data):
    told = msgpack.unpackb(encode_engine_message(error_reply(WireError("f", "x", "y"), data)))
    assert told["type"] == "error"
    assert 0 <= told["seq"] < 2**63


@pytest.mark.parametrize("what", CONTROL_REQUESTS)
def test_every_request_is_understood(what):
    request = decode_request(msgpack.packb({"v": 1, "type": "request", "what": what, "args": {"a": 1}}))
    assert (request.what, request.args) == (what, {"a": 1})


@pytest.mark.parametrize(
    ("fields", "text", "outcome"),
    [
        (
            {"v": 1, "type": "request", "what": "dance"},
            "what: found 'dance'; expected status | ",
            ReplyOutcome.UNKNOWN,
        ),
        ({"v": 2, "type": "request", "what": "status"}, "v: found 2; expected at most 1", ReplyOutcome.UNKNOWN),
        ({"type": "request", "what": "status"}, "v: found None; expected a protocol", ReplyOutcome.MALFORMED),
        ({"v": 1, "type": "bye", "what": "status"}, "type: found 'bye'", ReplyOutcome.MALFORMED),
        ({"v": 1, "type": "request"}, "what: found nothing", ReplyOutcome.MALFORMED),
        (
            {"v": 1, "type": "request", "what": "stop", "args": [1]},
            "args: found an array; expected object",
            ReplyOutcome.MALFORMED,
        ),
        ({"v": 1, "type": "request", "what": "stop", "x": "a" * 70_000}, "message: found 70", ReplyOutcome.MALFORMED),
    ],
)
def test_what_is_no_request_is_named(fields, text, outcome):
    with pytest.raises(WireError) as caught:
        decode_request(msgpack.packb(fields))
    assert str(caught.value).startswith(text)
    assert caught.value.outcome is outcome


@given(st.binary(max_size=100))
def test_arbitrary_requests_raise_nothing_but_wire_errors(data):
    try:
        decode_request(data)
    except WireError as error:
        assert str(error)  # noqa: PT017  # most are refused, a few are not
