"""Device messages to events and back: decoding under limits, and canonical bytes for the journal.

Canonical means that the same event gives the same bytes: keys are sorted, sensors too, every field is present, arrays
are ``bin``, and floats keep their 64 bits."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping
from operator import attrgetter
from types import MappingProxyType
from typing import Any, Final, get_args

import msgspec
import numpy as np

from tickfix import api
from tickfix.api import LATEST_NS, SENSORS, Event, EventError, Floats, Ints, MotionSamples, Samples
from tickfix.api.events import UNSET_NS
from tickfix.api.sources import Source, check_declared
from tickfix.wire import sensor_messages
from tickfix.wire.sensor_messages import OLDEST_VERSION, VERSION, DeviceMessage, EventMessage, MessageLimits
from tickfix.wire.validation import (
    MAP_DECODER,
    ReplyOutcome,
    WireError,
    check_version,
    decode_checked,
    decode_float_rows,
    decode_floats,
    decode_times,
    encode_array,
    peek_scalar,
    short_repr,
    split_fields,
)

_TEXT_GETTERS: Final[Mapping[type[DeviceMessage], Callable[[DeviceMessage], tuple[str, ...]]]] = {
    kind: attrgetter(*(field.name for field in msgspec.structs.fields(kind) if field.type is str))
    for kind in get_args(DeviceMessage)
}
_CONTROL_CHARACTERS: Final = re.compile(r"[\x00-\x1f\x7f-\x9f]")


def check_texts(message: DeviceMessage, max_chars: int) -> None:
    """Refuse a text of more than ``max_chars`` characters, or with a control character in it.

    Raises:
        WireError: naming the field.
    """
    text = "".join(_TEXT_GETTERS[type(message)](message))
    if isinstance(message, sensor_messages.MotionMessage | sensor_messages.Hello):
        text += "".join(message.sensors)
    elif isinstance(message, sensor_messages.ScanMessage) and message.values:
        text += "".join(message.values)
    longest = max(map(len, message.transmitters), default=0) if isinstance(message, sensor_messages.ScanMessage) else 0
    # No control character is printable, and if all together are not too long, none is.
    if not text.isprintable() or len(text) > max_chars or longest > max_chars:
        _raise_for_texts(message, max_chars)


def _raise_for_texts(message: DeviceMessage, max_chars: int) -> None:
    """Raise for the first text that cannot be; there may be none."""
    texts: list[tuple[str, str]] = [
        (name, value) for name in message.__struct_fields__ if isinstance(value := getattr(message, name), str)
    ]
    if isinstance(message, sensor_messages.MotionMessage | sensor_messages.Hello):
        texts.extend(("sensors", name) for name in message.sensors)
    elif isinstance(message, sensor_messages.ScanMessage):
        texts.extend(("values", name) for name in message.values)
    for name, text in texts:
        # They are shown on terminals and written to logs, where a control character could pretend to be anything.
        if _CONTROL_CHARACTERS.search(text):
            raise WireError(name, short_repr(text), "text without control characters")
    if isinstance(message, sensor_messages.ScanMessage):
        texts.extend((f"transmitters[{i}]", text) for i, text in enumerate(message.transmitters))
    for name, text in texts:
        if len(text) > max_chars:
            raise WireError(name, f"{len(text)} characters", f"at most {max_chars}")


_MESSAGE_TYPES: Final[Mapping[str, type[DeviceMessage]]] = {
    str(kind.__struct_config__.tag): kind for kind in get_args(DeviceMessage)
}
_MESSAGE_DECODERS: Final = {name: msgspec.msgpack.Decoder(kind) for name, kind in _MESSAGE_TYPES.items()}
_TYPE_BYTES: Final = {msgspec.msgpack.encode(name): name for name in _MESSAGE_TYPES}
_VERSION_BYTES: Final = frozenset(map(msgspec.msgpack.encode, range(OLDEST_VERSION, VERSION + 1)))
"""Types and versions as most peers write them."""

_KNOWN_FIELDS: Final = {name: {"type", *kind.__struct_fields__} for name, kind in _MESSAGE_TYPES.items()}
_MAP_VALUE_TYPES: Final[Mapping[str, Any]] = {
    "motion": sensor_messages.SensorSamples,
    "scan": sensor_messages.FloatArray,
    "hello": float,
}


def decode_message(data: bytes, limits: MessageLimits) -> DeviceMessage:
    """Return the message that a device sent.

    Times and values stay as they came; :func:`tickfix.wire.event_codec.message_to_event` checks them against each
    other.

    Raises:
        WireError: for whatever cannot be used, with outcome ``unknown`` for a type or version that a newer peer may
            speak, ``malformed`` otherwise.
    """
    if len(data) > limits.message_bytes:
        raise WireError("message", f"{len(data)} bytes", f"at most {limits.message_bytes}")
    message = read_message(data, limits.fields)
    check_texts(message, limits.text_chars)
    if not message.device:
        raise WireError("device", "''", "the device's name")
    match message:
        case sensor_messages.MotionMessage():
            for name, batch in message.sensors.items():
                n = len(batch.t_ns) // 8 if isinstance(batch.t_ns, bytes) else len(batch.t_ns)
                if n > limits.samples:
                    raise WireError(f"sensors.{name}.t_ns", f"{n} samples", f"at most {limits.samples}")
        case sensor_messages.ScanMessage() if len(message.transmitters) > limits.readings:
            raise WireError("transmitters", f"{len(message.transmitters)} readings", f"at most {limits.readings}")
    return message


def read_message(data: bytes, fields: int = 64) -> DeviceMessage:
    """Return the message of these bytes, whatever its length, with at most ``fields`` fields.

    Raises:
        WireError: see :func:`decode_message`.
    """
    kind = _message_type(data, fields)
    return decode_checked(_MESSAGE_DECODERS[kind], data, _MAP_VALUE_TYPES.get(kind))


def unknown_fields(data: bytes) -> tuple[str, ...]:
    """Return the names of a message's fields that this version does not know, to be counted.

    ``data`` must be a message that :func:`decode_message` took.
    """
    raw = MAP_DECODER.decode(data)
    kind = raw["type"]
    known = _KNOWN_FIELDS[_TYPE_BYTES.get(bytes(kind)) or str(peek_scalar(kind))]
    return () if raw.keys() <= known else tuple(name for name in raw if name not in known)


def _message_type(data: bytes, fields: int) -> str:
    raw = split_fields(data, fields)
    if (
        "v" in raw
        and "type" in raw
        and bytes(raw["v"]) in _VERSION_BYTES
        and (known_type := _TYPE_BYTES.get(bytes(raw["type"])))
    ):
        return known_type
    check_version(_scalar_field(raw, "v"))
    kind = _scalar_field(raw, "type")
    if not isinstance(kind, str):
        raise WireError("type", short_repr(kind), "a name")
    if kind not in _MESSAGE_DECODERS:
        raise WireError("type", short_repr(kind), " | ".join(_MESSAGE_DECODERS), ReplyOutcome.UNKNOWN)
    return kind


def _scalar_field(raw: Mapping[str, msgspec.Raw], field: str) -> object:
    if field not in raw:
        raise WireError(field, "nothing", "the field")
    return peek_scalar(raw[field])


_EVENT_ENCODER: Final = msgspec.msgpack.Encoder(order="deterministic")  # keys sorted
_LITTLE: Final = sys.byteorder == "little"


def encode_event(event: Event) -> bytes:
    """Return the event's canonical bytes, arrival included; :func:`decode_event` gives the event back, bit for bit.

    Raises:
        WireError: for text that is not Unicode (lone surrogates) and integers beyond 64 bits.
    """
    fields = _message_fields(event)
    fields["arrival_ns"] = int(event.arrival_ns)
    if isinstance(event, MotionSamples):
        fields["t0_ns"] = int(event.t0_ns)
        fields["t1_ns"] = int(event.t1_ns)
    return _encode_fields(fields)


def decode_event(data: bytes) -> Event:
    """Return the event of its canonical bytes.

    Raises:
        WireError: for bytes that :func:`encode_event` never makes.
    """
    message = read_message(data)
    if isinstance(message, sensor_messages.Hello | sensor_messages.Bye):
        raise WireError("type", short_repr(type(message).__name__.lower()), "an event")
    if message.arrival_ns is None:
        raise WireError("arrival_ns", "nothing", "the field")
    if isinstance(message, sensor_messages.MotionMessage):
        if message.t0_ns is None or message.t1_ns is None:
            raise WireError("t0_ns" if message.t0_ns is None else "t1_ns", "nothing", "the field")
        return _build_motion(message, message.arrival_ns, t0_ns=message.t0_ns, t1_ns=message.t1_ns)
    return message_to_event(message, message.arrival_ns)


def event_to_message(event: Event, *, ack: bool = False) -> bytes:
    """Return the message with which a device sends ``event``; what the engine sets itself is left out."""
    return _encode_fields(_message_fields(event) | {"ack": ack})


def message_to_event(message: DeviceMessage, arrival_ns: int) -> Event:
    """Return the event in a message, arrived at ``arrival_ns`` (wall clock, ns).

    Raises:
        WireError: where arrays do not fit together, or nothing of the message is known.
        TypeError: for a ``hello`` or ``bye``, which contain no event.
    """
    try:
        return _build_event(message, arrival_ns)
    except EventError as error:
        field, _, rest = str(error).partition(": ")
        raise WireError(field, rest or "something", "a possible event") from error


def check_received_event(event: Event, sources: Mapping[str, Source] = MappingProxyType({})) -> None:
    """Reject an event that cannot be used: without a valid time, or truth without a position.

    Of arrays of times a single one that is right is enough; the kernel leaves the others out and counts them.

    Raises:
        WireError: naming the time, or the coordinates.
    """
    try:
        check_declared(event, sources)
    except EventError as error:
        field, _, rest = str(error).partition(": found ")
        found, _, expected = rest.partition(", expected ")
        raise WireError(field, found, expected) from error
    if isinstance(event, MotionSamples):
        if event.t0_ns >= 0 and event.t1_ns <= LATEST_NS:
            return
        time_arrays = [
            (f"sensors.{name}.t_ns", samples.t_ns) for name, samples in event.sensors.items() if len(samples)
        ]
        if not any(((t_ns >= 0) & (t_ns <= LATEST_NS)).any() for _, t_ns in time_arrays):
            raise _time_error(f"{time_arrays[0][0]}[0]", int(time_arrays[0][1][0]))
    elif not 0 <= event.t_ns <= LATEST_NS:
        field = "t_ns"
        if isinstance(event, api.Scan) and event.t_ns in event.heard_ns:
            field = f"heard_ns[{int(np.flatnonzero(event.heard_ns == event.t_ns)[0])}]"
        raise _time_error(field, event.t_ns)
    elif isinstance(event, api.Truth) and not np.isfinite(event.xy).all():
        raise WireError("xy", f"{event.xy.tolist()}", "finite numbers, metres")


def _build_event(message: DeviceMessage, arrival_ns: int) -> Event:
    match message:
        case sensor_messages.MotionMessage():
            return _build_motion(message, arrival_ns)
        case sensor_messages.ScanMessage():
            return _build_scan(message, arrival_ns)
        case sensor_messages.PressureMessage():
            return api.Pressure(
                t_ns=message.t_ns, pressure_hpa=message.pressure_hpa, **_common_fields(message, arrival_ns)
            )
        case sensor_messages.FixMessage():
            optional_fields: dict[str, Any] = {}
            if message.covariance is not None:
                optional_fields["covariance"] = decode_float_rows("covariance", message.covariance, 2, 2)
            return api.Fix(
                t_ns=message.t_ns,
                floor=message.floor,
                xy=decode_floats("xy", message.xy, 2),
                source=message.source,
                **optional_fields,
                **_common_fields(message, arrival_ns),
            )
        case sensor_messages.TruthMessage():
            xy = decode_floats("xy", message.xy, 2)
            return api.Truth(t_ns=message.t_ns, floor=message.floor, xy=xy, **_common_fields(message, arrival_ns))
    raise TypeError(f"a {type(message).__name__.lower()} contains no event")


def _build_motion(
    message: sensor_messages.MotionMessage, arrival_ns: int, t0_ns: int = UNSET_NS, t1_ns: int = UNSET_NS
) -> MotionSamples:
    sensors: dict[str, Samples] = {}
    for name, batch in message.sensors.items():
        known = SENSORS.get(name)
        t_ns = decode_times(f"sensors.{name}.t_ns", batch.t_ns)
        columns = None if known is None else known[0]
        values = decode_float_rows(f"sensors.{name}.values", batch.values, len(t_ns), columns)
        of_bin = _LITTLE and isinstance(batch.t_ns, bytes) and isinstance(batch.values, bytes)
        sensors[name] = _samples_of_bin(t_ns, values) if of_bin else Samples(t_ns, values)
    return MotionSamples(sensors=sensors, t0_ns=t0_ns, t1_ns=t1_ns, **_common_fields(message, arrival_ns))


def _samples_of_bin(t_ns: Ints, values: Floats) -> Samples:
    """Return ``Samples(t_ns, values)`` without its checks: arrays of ``bin`` are read-only, typed and fit already."""
    samples = object.__new__(Samples)
    object.__setattr__(samples, "t_ns", t_ns)
    object.__setattr__(samples, "values", values)
    return samples


def _build_scan(message: sensor_messages.ScanMessage, arrival_ns: int) -> api.Scan:
    n = len(message.transmitters)
    heard_ns = decode_times("heard_ns", message.heard_ns)
    if len(heard_ns) != n:
        raise WireError("heard_ns", f"{len(heard_ns)} elements", f"{n}, one for every transmitter")
    if n == 0 and message.t_ns is None:
        raise WireError("t_ns", "nothing", "the time of a scan without readings")
    optional_fields: dict[str, Any] = {}
    if not isinstance(message.rssi_dbm, msgspec.UnsetType):
        optional_fields["rssi_dbm"] = decode_floats("rssi_dbm", message.rssi_dbm, n)
    return api.Scan(
        transmitters=tuple(message.transmitters),
        heard_ns=heard_ns,
        source=message.source,
        t_ns=UNSET_NS if message.t_ns is None else message.t_ns,
        values={name: decode_floats(f"values.{name}", column, n) for name, column in message.values.items()},
        **optional_fields,
        **_common_fields(message, arrival_ns),
    )


def _time_error(field: str, t_ns: int) -> WireError:
    return WireError(field, str(t_ns), f"a time from 0 to {LATEST_NS} ns")


def _common_fields(message: EventMessage, arrival_ns: int) -> dict[str, Any]:
    return {
        "device": message.device,
        "session": message.session,
        "seq": message.seq,
        "arrival_ns": arrival_ns,
    }


def _message_fields(event: Event) -> dict[str, Any]:
    """Return the message that a device would send for an event."""
    fields: dict[str, Any] = {"v": VERSION, "device": event.device, "session": event.session, "seq": int(event.seq)}
    match event:
        case MotionSamples():
            sensors = {
                name: {"t_ns": encode_array(samples.t_ns), "values": encode_array(samples.values)}
                for name, samples in event.sensors.items()
            }
            return fields | {"type": "motion", "sensors": sensors}
        case api.Scan():
            fields |= {"type": "scan", "transmitters": event.transmitters, "source": event.source}
            fields |= {"rssi_dbm": encode_array(event.rssi_dbm), "heard_ns": encode_array(event.heard_ns)}
            if event.values:  # left out where there are none: the bytes of older journals stay what they were
                fields |= {"values": {name: encode_array(column) for name, column in event.values.items()}}
        case api.Pressure():
            fields |= {"type": "pressure", "pressure_hpa": float(event.pressure_hpa)}
        case api.Fix():
            fields |= {"type": "fix", "floor": event.floor, "xy": encode_array(event.xy), "source": event.source}
            fields |= {"covariance": encode_array(event.covariance)}
        case api.Truth():
            fields |= {"type": "truth", "floor": event.floor, "xy": encode_array(event.xy)}
    return fields | {"t_ns": int(event.t_ns)}


def _encode_fields(fields: dict[str, Any]) -> bytes:
    try:
        return _EVENT_ENCODER.encode(fields)
    except UnicodeEncodeError as error:
        raise WireError("event", f"text {short_repr(error.object)}", "Unicode text without lone surrogates") from None
    except OverflowError as error:
        raise WireError("event", f"an integer: {error}", "integers of 64 bits") from None
