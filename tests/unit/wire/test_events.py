"""Events become bytes and come back, bit for bit; the same event has the same bytes."""

from __future__ import annotations

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wire_strategies import EVENTS, SENT, content

from tickfix.api import LATEST_NS, Fix, MotionSamples, Pressure, Samples, Scan, motion_samples
from tickfix.api.events import UNSET_NS
from tickfix.wire import (
    Hello,
    MessageLimits,
    ReplyOutcome,
    WireError,
    check_received_event,
    decode_event,
    decode_message,
    encode_event,
    event_to_message,
    message_to_event,
)

LIMITS = MessageLimits()


def message(**fields):
    return decode_message(msgpack.packb({"v": 1, "device": "d", **fields}), LIMITS)


@given(EVENTS)
def test_an_event_comes_back_bit_for_bit(event):
    assert content(decode_event(encode_event(event))) == content(event)


@given(EVENTS)
def test_the_canonical_bytes_of_what_came_back_are_the_same(event):
    data = encode_event(event)
    assert encode_event(decode_event(data)) == data


@given(EVENTS)
def test_keys_stand_in_order(event):
    for keys in _keys(msgpack.unpackb(encode_event(event))):
        assert keys == sorted(keys)


def _keys(value):
    if isinstance(value, dict):
        yield list(value)
        for one in value.values():
            yield from _keys(one)


def test_the_order_in_which_sensors_are_told_does_not_matter():
    samples = {"gyroscope": Samples([1, 2], np.ones((2, 3))), "accelerometer": Samples([1], np.zeros((1, 3)))}
    turned = dict(reversed(samples.items()))
    assert encode_event(MotionSamples(sensors=samples)) == encode_event(MotionSamples(sensors=turned))


def test_strided_arrays_have_the_bytes_of_plain_ones():
    values = np.arange(24.0).reshape(4, 6)
    strided = motion_samples([1, 2, 3, 4], accelerometer=values[:, ::2])
    plain = motion_samples([1, 2, 3, 4], accelerometer=np.ascontiguousarray(values[:, ::2]))
    assert encode_event(strided) == encode_event(plain)


def test_nan_with_a_payload_and_negative_zero_keep_their_bits():
    odd = np.array([0x7FF8_0000_0000_1234, 0x8000_0000_0000_0000], np.uint64).view(np.float64)
    scan = Scan(transmitters=("a", "b"), rssi_dbm=odd, heard_ns=[1, 2])
    assert decode_event(encode_event(scan)).rssi_dbm.tobytes() == odd.tobytes()


@given(SENT, st.booleans())
def test_what_a_sender_sends_is_the_event_but_for_its_arrival(event, ack):
    sent = decode_message(event_to_message(event, ack=ack), LIMITS)
    assert sent.ack is ack
    if isinstance(event, MotionSamples):
        event = MotionSamples(
            sensors=event.sensors, device=event.device, session=event.session, seq=event.seq, arrival_ns=77
        )
        assert content(message_to_event(sent, 77)) == content(event)
    else:
        assert encode_event(message_to_event(sent, event.arrival_ns)) == encode_event(event)


def test_arrival_is_the_engines_word_whatever_a_device_says():
    sent = message(type="pressure", t_ns=5, pressure_hpa=1000.0, arrival_ns=1)
    assert message_to_event(sent, 9).arrival_ns == 9


def test_lists_and_bin_mean_the_same():
    t, rows = [10, 20], [[1.0, 2.0, 3.0], [4.0, 5.0, -0.0]]
    lists = message(type="motion", sensors={"gyroscope": {"t_ns": t, "values": rows}})
    raw = {"t_ns": np.array(t, "<i8").tobytes(), "values": np.array(rows, "<f8").tobytes()}
    packed = message(type="motion", sensors={"gyroscope": raw})
    assert encode_event(message_to_event(lists, 3)) == encode_event(message_to_event(packed, 3))
    scan = {"type": "scan", "transmitters": ["a", "b"]}
    lists = message(**scan, rssi_dbm=[-60, -70.5], heard_ns=[1, 2])
    packed = message(**scan, rssi_dbm=np.array([-60, -70.5]).tobytes(), heard_ns=np.array([1, 2]).tobytes())
    assert encode_event(message_to_event(lists, 3)) == encode_event(message_to_event(packed, 3))
    fix = {"type": "fix", "t_ns": 1, "floor": "F1"}
    lists = message(**fix, xy=[1, 2], covariance=[[1, 0], [0, 1]])
    packed = message(**fix, xy=np.array([1.0, 2]).tobytes(), covariance=np.eye(2).tobytes())
    assert encode_event(message_to_event(lists, 3)) == encode_event(message_to_event(packed, 3))


def test_arrays_of_a_decoded_event_cannot_be_written():
    event = message_to_event(message(type="truth", t_ns=1, floor="F1", xy=[1.0, 2.0]), 1)
    with pytest.raises(ValueError, match="read-only"):
        event.xy[0] = 5.0


def test_a_fix_without_covariance_has_that_of_the_api():
    event = message_to_event(message(type="fix", t_ns=1, floor="F1", xy=[1.0, 2.0]), 1)
    assert content(event) == content(Fix(t_ns=1, floor="F1", xy=[1.0, 2.0], device="d", arrival_ns=1))


def test_a_sensor_of_any_name_is_carried_with_the_columns_that_it_has():
    lists = {"t_ns": [1, 2], "values": [[300.0, 1.0], [310.0, 0.5]]}
    raw = {"t_ns": np.array([1, 2]).tobytes(), "values": np.array(lists["values"]).tobytes()}
    pressure = {"t_ns": [1], "values": [[1000.0]]}
    one, other = (
        message_to_event(message(type="motion", sensors={"light": s, "pressure": pressure}), 1) for s in (lists, raw)
    )
    assert one.sensors["light"].values.tolist() == lists["values"]
    assert encode_event(one) == encode_event(other)
    again = decode_event(encode_event(one))
    assert encode_event(again) == encode_event(one)
    assert again.sensors["light"].values.shape == (2, 2)


def test_a_sensor_of_any_name_without_samples_keeps_its_bytes():
    event = MotionSamples(sensors={"light": Samples([], np.zeros((0, 3)))}, t0_ns=1, t1_ns=1, arrival_ns=1)
    assert encode_event(decode_event(encode_event(event))) == encode_event(event)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ([[1.0], [1.0, 2.0]], "sensors.light.values[1]: found 2 columns; expected 1"),
        ([[1.0]], "sensors.light.values: found 1 rows; expected 2, one for every time"),
        ([[], []], "sensors.light.values: found 0 columns; expected 1 to 64"),
        (bytes(24), "sensors.light.values: found 24 bytes; expected a multiple of 2 × 8, a row for every time"),
        (bytes(2 * 65 * 8), "sensors.light.values: found 65 columns; expected 1 to 64"),
    ],
)
def test_columns_of_a_sensor_of_any_name_that_do_not_fit_are_named(values, text):
    with pytest.raises(WireError) as caught:
        message_to_event(message(type="motion", sensors={"light": {"t_ns": [1, 2], "values": values}}), 1)
    assert str(caught.value) == text


def test_a_scan_without_signal_strengths_carries_the_columns_that_it_has():
    ranges = {"range_m": [3.5, float("nan")], "range_sigma_m": np.array([0.1, 0.2]).tobytes()}
    sent = message(type="scan", transmitters=["a1", "a2"], heard_ns=[1, 2], source="uwb", values=ranges)
    event = message_to_event(sent, 3)
    assert event.source == "uwb"
    assert np.isnan(event.rssi_dbm).all()
    np.testing.assert_array_equal(event.values["range_m"], [3.5, np.nan])
    assert event.values["range_sigma_m"].tolist() == [0.1, 0.2]
    again = decode_event(encode_event(event))
    assert encode_event(again) == encode_event(event)
    assert message_to_event(decode_message(event_to_message(event), MessageLimits()), 3).values.keys() == ranges.keys()


def test_a_scan_without_further_columns_has_the_bytes_that_it_always_had():
    event = Scan(transmitters=("a",), rssi_dbm=[-60.0], heard_ns=[5], device="d", session="s", seq=1)
    assert encode_event(event).hex() == (
        "8baa6172726976616c5f6e7305a6646576696365a164a868656172645f6e73c4080500000000000000a8727373695f64626dc408"
        "0000000000004ec0a373657101a773657373696f6ea173a6736f75726365a477696669a4745f6e7305ac7472616e736d69747465"
        "727391a161a474797065a47363616ea17601"
    )


def test_a_column_of_a_scan_that_does_not_fit_is_named():
    sent = message(type="scan", transmitters=["a"], heard_ns=[1], values={"range_m": [1.0, 2.0]})
    with pytest.raises(WireError, match=r"^values.range_m: found 2 elements; expected 1$"):
        message_to_event(sent, 1)


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        (
            {"type": "motion", "sensors": {"gyroscope": {"t_ns": [1, 2], "values": [[1, 2, 3]]}}},
            "sensors.gyroscope.values: found 1 rows; expected 2, one for every time",
        ),
        (
            {"type": "motion", "sensors": {"gyroscope": {"t_ns": [1, 2], "values": [[1, 2, 3], [1, 2]]}}},
            "sensors.gyroscope.values[1]: found 2 columns; expected 3",
        ),
        (
            {"type": "motion", "sensors": {"gyroscope": {"t_ns": [1], "values": bytes(16)}}},
            "sensors.gyroscope.values: found 16 bytes; expected 1 × 3 × 8, a row for every time",
        ),
        (
            {"type": "motion", "sensors": {"gyroscope": {"t_ns": bytes(7), "values": []}}},
            "sensors.gyroscope.t_ns: found 7 bytes; expected a multiple of 8",
        ),
        (
            {"type": "scan", "transmitters": ["a"], "rssi_dbm": [1, 2], "heard_ns": [1]},
            "rssi_dbm: found 2 elements; expected 1",
        ),
        (
            {"type": "scan", "transmitters": ["a"], "rssi_dbm": [1], "heard_ns": []},
            "heard_ns: found 0 elements; expected 1, one for every transmitter",
        ),
        (
            {"type": "scan", "transmitters": [], "rssi_dbm": [], "heard_ns": []},
            "t_ns: found nothing; expected the time of a scan without readings",
        ),
        ({"type": "truth", "t_ns": 1, "floor": "F", "xy": [1]}, "xy: found 1 elements; expected 2"),
        ({"type": "fix", "t_ns": 1, "floor": "F", "xy": [1, 2], "covariance": [[1, 2]]}, "covariance: found 1 rows"),
    ],
)
def test_arrays_that_do_not_fit_together_are_named(fields, text):
    with pytest.raises(WireError) as caught:
        message_to_event(message(**fields), 1)
    assert str(caught.value).startswith(text)
    assert caught.value.outcome is ReplyOutcome.MALFORMED


WILD = [-1, -(2**63), LATEST_NS + 1, 2**63 - 1]
EXPECTED = "expected a time from 0 to 4611686018427387903 ns"


@pytest.mark.parametrize("t_ns", WILD)
@pytest.mark.parametrize(
    ("fields", "field"),
    [
        ({"type": "pressure", "pressure_hpa": 1000.0}, "t_ns"),
        ({"type": "fix", "floor": "F", "xy": [1.0, 2.0]}, "t_ns"),
        ({"type": "truth", "floor": "F", "xy": [1.0, 2.0]}, "t_ns"),
        ({"type": "scan", "transmitters": ["a"], "rssi_dbm": [-60.0], "heard_ns": [5]}, "t_ns"),
    ],
)
def test_a_message_whose_time_is_none_is_refused_by_name(fields, field, t_ns):
    event = message_to_event(message(**fields, t_ns=t_ns), 1)
    if fields["type"] == "scan" and t_ns == UNSET_NS:  # the time of its newest reading
        assert event.t_ns == 5
        return
    with pytest.raises(WireError) as caught:
        check_received_event(event)
    assert str(caught.value) == f"{field}: found {t_ns}; {EXPECTED}"
    assert caught.value.outcome is ReplyOutcome.MALFORMED


@pytest.mark.parametrize("t_ns", WILD)
def test_of_arrays_of_times_one_that_is_right_is_enough(t_ns):
    motion = {"accelerometer": {"t_ns": [], "values": []}, "gyroscope": {"t_ns": [t_ns], "values": [[1.0, 2.0, 3.0]]}}
    with pytest.raises(WireError) as caught:
        check_received_event(message_to_event(message(type="motion", sensors=motion), 1))
    assert str(caught.value) == f"sensors.gyroscope.t_ns[0]: found {t_ns}; {EXPECTED}"
    motion["accelerometer"] = {"t_ns": [t_ns, LATEST_NS], "values": [[1.0, 2.0, 3.0]] * 2}
    check_received_event(message_to_event(message(type="motion", sensors=motion), 1))
    check_received_event(message_to_event(message(type="motion", sensors={}), 1))


def test_a_scan_dated_by_a_reading_without_a_time_is_refused_by_the_name_of_the_reading():
    scan = {"type": "scan", "transmitters": ["a", "b"], "rssi_dbm": [-60.0, -61.0], "heard_ns": [5, 2**63 - 1]}
    with pytest.raises(WireError, match=rf"heard_ns\[1\]: found {2**63 - 1}; {EXPECTED}"):
        check_received_event(message_to_event(message(**scan), 1))
    check_received_event(message_to_event(message(**scan, t_ns=7), 1))


@pytest.mark.parametrize("x", [float("nan"), float("inf")])
def test_truth_must_be_somewhere(x):
    with pytest.raises(WireError, match=r"xy: found \[(nan|inf), 2.0\]; expected finite numbers, metres"):
        check_received_event(message_to_event(message(type="truth", t_ns=1, floor="F", xy=[x, 2.0]), 1))


def test_text_that_is_no_unicode_is_refused():
    with pytest.raises(WireError, match=r"found text .*ud800.* without lone surrogates"):
        encode_event(Pressure(t_ns=1, pressure_hpa=1.0, device="\ud800"))


def test_integers_beyond_64_bits_are_refused():
    with pytest.raises(WireError, match="64 bits"):
        encode_event(Pressure(t_ns=2**70, pressure_hpa=1.0))


def test_a_hello_is_no_event():
    data = msgpack.packb({"v": 1, "type": "hello", "device": "d"})
    with pytest.raises(WireError, match="expected an event"):
        decode_event(data)
    hello = decode_message(data, LIMITS)
    assert isinstance(hello, Hello)
    with pytest.raises(TypeError):
        message_to_event(hello, 1)


def test_a_message_is_no_canonical_event_as_its_arrival_is_missing():
    with pytest.raises(WireError, match="arrival_ns: found nothing"):
        decode_event(event_to_message(Pressure(t_ns=1, pressure_hpa=1.0)))


@given(EVENTS, st.data())
@settings(max_examples=150)
def test_a_damaged_event_is_refused_or_is_another_event(event, data):
    whole = bytearray(encode_event(event))
    at = data.draw(st.integers(0, len(whole) - 1))
    whole[at] ^= data.draw(st.integers(1, 255))
    try:
        decoded = decode_event(bytes(whole))
    except WireError:
        return
    encode_event(decoded)


@given(SENT)
def test_arrays_of_a_message_are_as_an_event_makes_them(event):
    told = message_to_event(decode_message(event_to_message(event), LIMITS), 7)
    if not isinstance(told, MotionSamples):
        return
    for samples in told.sensors.values():
        made = Samples(samples.t_ns, samples.values)
        assert (made.t_ns is samples.t_ns, made.values is samples.values) == (True, True)
        assert not any(array.flags.writeable for array in (samples.t_ns, samples.values))
        copied = Samples(samples.t_ns.copy(), samples.values.copy())
        assert (copied.t_ns.dtype, copied.values.dtype) == (samples.t_ns.dtype, samples.values.dtype)
        assert (copied.t_ns.shape, copied.values.shape) == (samples.t_ns.shape, samples.values.shape)
