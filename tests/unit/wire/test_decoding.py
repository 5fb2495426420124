"""Whatever comes in is a message or one WireError that names field, value and what is expected."""

from __future__ import annotations

import pickle
import tracemalloc
from contextlib import suppress

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wire_strategies import SENT

from tickfix.wire import (
    VERSION,
    MessageLimits,
    ReplyOutcome,
    WireError,
    decode_estimate,
    decode_event,
    decode_message,
    event_to_message,
    message_to_event,
    unknown_fields,
)

LIMITS = MessageLimits()
PRESSURE = {"v": 1, "type": "pressure", "device": "d", "t_ns": 1, "pressure_hpa": 1000.0}
SCAN = {"v": 1, "type": "scan", "device": "d", "transmitters": ["a"], "rssi_dbm": [-60.0], "heard_ns": [1]}


def motion(**batch):
    sensors = {"accelerometer": {"t_ns": [], "values": []}, "gyroscope": {"t_ns": [1], "values": [[1, 2, 3]]} | batch}
    return {"v": 1, "type": "motion", "device": "d", "sensors": sensors}


def refusal(fields, limits=LIMITS):
    data = fields if isinstance(fields, bytes) else msgpack.packb(fields)
    with pytest.raises(WireError) as caught:
        decode_message(data, limits)
    return caught.value


def use(data):
    """Do all that a port and a journal do with bytes."""
    for decode in (decode_event, decode_estimate):
        with suppress(WireError):
            decode(data)
    message = decode_message(data, LIMITS)
    unknown_fields(data)
    if type(message).__name__ not in {"Hello", "Bye"}:
        message_to_event(message, 1)


@given(st.binary(max_size=200))
@settings(max_examples=300)
def test_arbitrary_bytes_raise_nothing_but_wire_errors(data):
    with suppress(WireError):
        use(data)


ANYTHING = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
    | st.binary(max_size=24),
    lambda one: st.lists(one, max_size=4) | st.dictionaries(st.text("abcxyz_", max_size=8), one, max_size=4),
    max_leaves=12,
)


@given(st.sampled_from([PRESSURE, SCAN, motion()]), st.data())
@settings(max_examples=300)
def test_any_value_in_any_field_raises_nothing_but_wire_errors(fields, data):
    name = data.draw(st.sampled_from([*fields, "session", "seq", "ack", "other", "t_ns", "source", "arrival_ns"]))
    with suppress(WireError):
        use(msgpack.packb(fields | {name: data.draw(ANYTHING)}))


@given(ANYTHING, ANYTHING, st.sampled_from(["gyroscope", "light", ""]))
def test_any_samples_raise_nothing_but_wire_errors(t_ns, values, sensor):
    fields = motion() | {"sensors": {sensor: {"t_ns": t_ns, "values": values}}}
    with suppress(WireError):
        use(msgpack.packb(fields))


@given(SENT, st.data())
@settings(max_examples=100)
def test_a_message_cut_short_is_malformed(event, data):
    whole = event_to_message(event)
    half = whole[: data.draw(st.integers(0, len(whole) - 1))]
    assert refusal(half).outcome is ReplyOutcome.MALFORMED


@pytest.mark.parametrize(
    ("fields", "field", "found", "expected"),
    [
        (PRESSURE | {"pressure_hpa": "high"}, "pressure_hpa", "'high'", "float"),
        (PRESSURE | {"pressure_hpa": True}, "pressure_hpa", "True", "float"),
        (PRESSURE | {"pressure_hpa": {"a": 1}}, "pressure_hpa", "a map", "float"),
        (PRESSURE | {"t_ns": True}, "t_ns", "True", "int"),
        (PRESSURE | {"t_ns": 1.5}, "t_ns", "1.5", "int"),
        (PRESSURE | {"t_ns": 2**63}, "t_ns", "9223372036854775808", "int <= 9223372036854775807"),
        (PRESSURE | {"seq": -1}, "seq", "-1", "int >= 0"),
        (PRESSURE | {"ack": 1}, "ack", "1", "bool"),
        (PRESSURE | {"device": None}, "device", "None", "str"),
        (PRESSURE | {"device": ""}, "device", "''", "the device's name"),
        (PRESSURE | {"device": "x" * 257}, "device", "257 characters", "at most 256"),
        (PRESSURE | {"v": "1"}, "v", "'1'", "a protocol version from 1 to 1"),
        (PRESSURE | {"v": True}, "v", "True", "a protocol version from 1 to 1"),
        (PRESSURE | {"v": 0}, "v", "0", "a protocol version from 1 to 1"),
        (PRESSURE | {"type": 3}, "type", "3", "a name"),
        ({"type": "bye", "device": "d"}, "v", "nothing", "the field"),
        ({"v": 1, "device": "d"}, "type", "nothing", "the field"),
        ({"v": 1, "type": "bye"}, "device", "nothing", "the field"),
        (SCAN | {"rssi_dbm": [-60.0, False]}, "rssi_dbm[1]", "False", "float"),
        (SCAN | {"rssi_dbm": msgpack.ExtType(5, b"a")}, "rssi_dbm", "an extension type", "bytes | array"),
        (SCAN | {"heard_ns": [2**64 - 1]}, "heard_ns[0]", "18446744073709551615", "int <= 9223372036854775807"),
        (SCAN | {"heard_ns": [1.0]}, "heard_ns[0]", "1.0", "int"),
        (SCAN | {"transmitters": ["a", b"b"]}, "transmitters[1]", "b'b'", "str"),
        (motion() | {"sensors": {"x" * 300: {"t_ns": [], "values": []}}}, "sensors", "300 characters", "at most 256"),
        (SCAN | {"transmitters": ["a", "b" * 300]}, "transmitters[1]", "300 characters", "at most 256"),
        (motion(values=[[1, 2, "3"]]), "sensors.gyroscope.values[0][2]", "'3'", "float"),
        (motion(values=[1, 2, 3]), "sensors.gyroscope.values[0]", "1", "array"),
        (motion(values=[[0] * 65]), "sensors.gyroscope.values[0]", "an array that is longer", "array of length <= 64"),
        (motion(t_ns="now"), "sensors.gyroscope.t_ns", "'now'", "bytes | array"),
        (motion() | {"sensors": []}, "sensors", "an array", "object"),
        (motion() | {"sensors": {"gyroscope": {}}}, "sensors.gyroscope.t_ns", "nothing", "the field"),
        ({"v": 1, "type": "hello", "device": "d", "sensors": {"a": 1, "b": []}}, "sensors.b", "an array", "float"),
        (PRESSURE | {7: 1}, "message", "int as a key", "texts as keys"),
        ([PRESSURE], "message", "91 as first byte", "a MessagePack map"),
        (b"", "message", "no as first byte", "a MessagePack map"),
        (msgpack.packb(PRESSURE) + b"\0", "message", None, "one whole MessagePack map"),
        (msgpack.packb(PRESSURE)[:-1], "message", None, "one whole MessagePack map"),
    ],
)
def test_an_error_names_field_value_and_what_is_expected(fields, field, found, expected):
    error = refusal(fields)
    assert (error.field, error.expected, error.outcome) == (field, expected, ReplyOutcome.MALFORMED)
    if found is not None:
        assert error.found == found


def test_a_long_value_is_shortened_in_its_error():
    error = refusal(PRESSURE | {"pressure_hpa": "x" * 100_000})
    assert len(str(error)) < 200


def test_text_that_is_not_utf8_is_refused():
    data = msgpack.packb(PRESSURE | {"device": "abc"}).replace(b"abc", b"a\xffc")
    error = refusal(data)
    assert (error.found, error.expected) == (r"text with b'\xff'", "UTF-8")


@pytest.mark.parametrize("text", ["\U0001f6b6", "e\u0301", "\u202egnp", "a/b/*", "\ufeffx", "\ud7ff\ue000"])
def test_any_unicode_text_is_a_name(text):
    assert decode_message(msgpack.packb(PRESSURE | {"device": text}), LIMITS).device == text


@pytest.mark.parametrize("text", ["\0", "a\nb", "\x1b[2J", "\x7f", "\x9b2J"])
@pytest.mark.parametrize("field", ["device", "session"])
def test_control_characters_are_refused_as_names_are_shown_on_terminals(field, text):
    error = refusal(PRESSURE | {field: text})
    assert (error.field, error.found, error.expected) == (field, repr(text), "text without control characters")
    assert refusal(motion() | {"sensors": {text: {"t_ns": [], "values": []}}}).field == "sensors"


def test_a_field_twice_is_refused():
    body = msgpack.packb(PRESSURE)
    data = bytes([body[0] + 1]) + body[1:] + msgpack.packb("t_ns") + msgpack.packb(2)
    assert refusal(data).found == "a field twice"


@pytest.mark.parametrize("name", ["new", "motion2", "", "ack", "welcome", "reply", "estimate"])
def test_an_unknown_type_has_the_outcome_unknown(name):
    error = refusal(PRESSURE | {"type": name})
    assert (error.field, error.outcome) == ("type", ReplyOutcome.UNKNOWN)
    assert "motion" in error.expected


@pytest.mark.parametrize("newer", [VERSION + 1, 2**63, 2**64 - 1])
def test_a_newer_peer_is_told_what_is_spoken_here(newer):
    error = refusal({"v": newer, "type": "whatever", "shape": {"of": "tomorrow"}})
    assert (error.field, error.found, error.outcome) == ("v", str(newer), ReplyOutcome.UNKNOWN)
    assert error.expected == "at most 1, the protocol version spoken here"


def test_unknown_fields_are_tolerated_and_named():
    data = msgpack.packb(PRESSURE | {"colour": "red", "nested": {"a": [1, {"b": None}]}})
    assert decode_message(data, LIMITS) == decode_message(msgpack.packb(PRESSURE), LIMITS)
    assert unknown_fields(data) == ("colour", "nested")
    assert unknown_fields(msgpack.packb(PRESSURE)) == ()


@pytest.mark.parametrize("opening", [b"\x91", b"\x81\xa1a", b"\xdd\0\0\0\1", b"\xdf\0\0\0\1\xa1a"])
def test_a_deep_unknown_field_is_refused(opening):
    body = msgpack.packb(PRESSURE)
    data = bytes([body[0] + 1]) + body[1:] + msgpack.packb("deep") + opening * 100_000 + b"\x90"
    error = refusal(data, MessageLimits(message_bytes=2**20))
    assert error.found == "too many levels of nesting"
    assert error.outcome is ReplyOutcome.MALFORMED


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (bytes(262_145), "262145 bytes"),
        (b"\xdf\xff\xff\xff\xff" + b"\xa1a\x01", "4294967295 fields"),
        (b"\xde\xff\xff" + b"\xa1a\x01", "65535 fields"),
    ],
)
def test_what_is_too_large_is_refused_by_its_head(data, found):
    assert refusal(data).found == found


@pytest.mark.parametrize("length", [b"\xdd\xff\xff\xff\xff", b"\xdd\0\1\0\1", b"\xc6\xff\xff\xff\xff"])
def test_a_length_that_lies_is_refused(length):
    body = msgpack.packb({"v": 1, "type": "scan", "device": "d", "transmitters": [], "heard_ns": []})
    data = bytes([body[0] + 1]) + body[1:] + msgpack.packb("rssi_dbm") + length
    assert refusal(data).outcome is ReplyOutcome.MALFORMED


def test_a_list_above_the_ceiling_is_refused_before_it_is_built():
    many = msgpack.packb(motion(values=[[]] * 100_000))
    error = refusal(many)
    assert (error.field, error.found) == ("sensors.gyroscope.values", "an array that is longer")


def worst(sensors, samples):
    """Return a message that is as small as can be for what has to be built of it."""
    batch = b"\x82" + msgpack.packb("t_ns") + b"\x90" + msgpack.packb("values")
    batch += b"\xdc" + samples.to_bytes(2, "big") + b"\x90" * samples
    head = msgpack.packb({"v": 1, "type": "motion", "device": "d"})
    body = b"".join(msgpack.packb(f"{i:02}") + batch for i in range(sensors))
    return b"\x84" + head[1:] + msgpack.packb("sensors") + b"\xde" + sensors.to_bytes(2, "big") + body


@pytest.mark.parametrize("data", [worst(64, 4050), worst(4, 65_000)])
def test_no_message_takes_more_memory_than_a_hundred_times_its_length(data):
    assert 200_000 < len(data) < LIMITS.message_bytes
    tracemalloc.start()
    with suppress(WireError):
        decode_message(data, LIMITS)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 100 * len(data)


@pytest.mark.parametrize("packed", [True, False])
def test_batches_above_the_limits_are_refused(packed):
    t_ns = np.arange(5).tobytes() if packed else list(range(5))
    error = refusal(motion(t_ns=t_ns), MessageLimits(samples=4))
    assert str(error) == "sensors.gyroscope.t_ns: found 5 samples; expected at most 4"
    error = refusal(SCAN | {"transmitters": ["a", "b"]}, MessageLimits(readings=1))
    assert str(error) == "transmitters: found 2 readings; expected at most 1"


def test_limits_are_checked_themselves():
    with pytest.raises(ValueError, match="samples: found 0; expected 1 to 65536"):
        MessageLimits(samples=0)
    with pytest.raises(ValueError, match="readings: found 70000"):
        MessageLimits(readings=70_000)


def test_an_error_comes_back_from_another_process():
    error = WireError("a", "b", "c", ReplyOutcome.UNKNOWN)
    back = pickle.loads(pickle.dumps(error))  # noqa: S301  # our own bytes
    assert (str(back), back.outcome) == (str(error), ReplyOutcome.UNKNOWN)
