"""Events as canonical bytes, as messages of a device, and back.

Canonical means: the same event gives the same bytes. Keys are sorted, sensors too, every field is present, arrays are
``bin``, and floats keep their 64 bits.
"""

from __future__ import annotations

import sys
from typing import Any, Final

import msgspec
import numpy as np

from tickfix import api
from tickfix.api import LATEST_NS, SENSORS, Event, EventError, Floats, Ints, MotionSamples, Samples
from tickfix.api.events import UNSET_NS
from tickfix.kernel import Outcome
from tickfix.wire import messages
from tickfix.wire.arrays import numbers, rows, times, to_bin
from tickfix.wire.decoding import read_message
from tickfix.wire.errors import WireError
from tickfix.wire.messages import VERSION, EventMessage, Message
from tickfix.wire.raw import shown

_ENCODER: Final = msgspec.msgpack.Encoder(order="deterministic")  # keys sorted
_LITTLE: Final = sys.byteorder == "little"
_FIELDS: Final = {name: (f"sensors.{name}.t_ns", f"sensors.{name}.values") for name in SENSORS}


def encode_event(event: Event) -> bytes:
    """Return the event's canonical bytes, arrival included; :func:`decode_event` gives the event back, bit for bit.

    Raises:
        WireError: for text that is not Unicode (lone surrogates) and integers beyond 64 bits.
    """
    fields = _fields(event)
    fields["arrival_ns"] = int(event.arrival_ns)
    if isinstance(event, MotionSamples):
        fields["t0_ns"] = int(event.t0_ns)
        fields["t1_ns"] = int(event.t1_ns)
    return _encode(fields)


def decode_event(data: bytes) -> Event:
    """Return the event of its canonical bytes.

    Raises:
        WireError: for bytes that :func:`encode_event` never makes.
    """
    message = read_message(data)
    if isinstance(message, messages.Hello | messages.Bye):
        raise WireError("type", shown(type(message).__name__.lower()), "an event")
    if message.arrival_ns is None:
        raise WireError("arrival_ns", "nothing", "the field")
    if isinstance(message, messages.Motion):
        if message.t0_ns is None or message.t1_ns is None:
            raise WireError("t0_ns" if message.t0_ns is None else "t1_ns", "nothing", "the field")
        return _motion(message, message.arrival_ns, t0_ns=message.t0_ns, t1_ns=message.t1_ns)
    return to_event(message, message.arrival_ns)


def from_event(event: Event, *, ack: bool = False) -> bytes:
    """Return the message with which a device sends ``event``; what the engine sets itself is left out."""
    return _encode(_fields(event) | {"ack": ack})


def to_event(message: Message, arrival_ns: int) -> Event:
    """Return the event that a message tells, arrived at ``arrival_ns`` (wall clock, ns).

    Sensors of a name unknown here are left out, as unknown fields are; see :func:`unknown_sensors`.

    Raises:
        WireError: where arrays do not fit together, or nothing of the message is known.
        TypeError: for a ``hello`` or ``bye``, which tell no event.
    """
    try:
        return _to_event(message, arrival_ns)
    except EventError as error:
        field, _, rest = str(error).partition(": ")
        raise WireError(field, rest or "something", "a possible event") from error


def check_sent(event: Event) -> None:
    """Refuse what a device sent when nothing can be made of it: its time is none, or its truth is nowhere.

    Of arrays of times a single one that is right is enough; the kernel leaves the others out and counts them.

    Raises:
        WireError: naming the time, or the coordinates.
    """
    if isinstance(event, MotionSamples):
        if event.t0_ns >= 0 and event.t1_ns <= LATEST_NS:
            return
        heard = [(f"sensors.{name}.t_ns", samples.t_ns) for name, samples in event.sensors.items() if len(samples)]
        if not any(((t_ns >= 0) & (t_ns <= LATEST_NS)).any() for _, t_ns in heard):
            raise _no_time(f"{heard[0][0]}[0]", int(heard[0][1][0]))
    elif not 0 <= event.t_ns <= LATEST_NS:
        field = "t_ns"
        if isinstance(event, api.Scan) and event.t_ns in event.heard_ns:
            field = f"heard_ns[{int(np.flatnonzero(event.heard_ns == event.t_ns)[0])}]"
        raise _no_time(field, event.t_ns)
    elif isinstance(event, api.Truth) and not np.isfinite(event.xy).all():
        raise WireError("xy", f"{event.xy.tolist()}", "finite numbers, metres")


def unknown_sensors(message: messages.Motion) -> tuple[str, ...]:
    """Return the names of sensors that are not known here, to be counted."""
    return tuple(name for name in message.sensors if name not in SENSORS)


def _to_event(message: Message, arrival_ns: int) -> Event:
    match message:
        case messages.Motion():
            return _motion(message, arrival_ns)
        case messages.Scan():
            return _scan(message, arrival_ns)
        case messages.Pressure():
            return api.Pressure(t_ns=message.t_ns, pressure_hpa=message.pressure_hpa, **_common(message, arrival_ns))
        case messages.Fix():
            spread: dict[str, Any] = {}
            if message.covariance is not None:
                spread["covariance"] = rows("covariance", message.covariance, 2, 2)
            return api.Fix(
                t_ns=message.t_ns,
                floor=message.floor,
                xy=numbers("xy", message.xy, 2),
                source=message.source,
                **spread,
                **_common(message, arrival_ns),
            )
        case messages.Truth():
            xy = numbers("xy", message.xy, 2)
            return api.Truth(t_ns=message.t_ns, floor=message.floor, xy=xy, **_common(message, arrival_ns))
    raise TypeError(f"a {type(message).__name__.lower()} tells no event")


def _motion(message: messages.Motion, arrival_ns: int, t0_ns: int = UNSET_NS, t1_ns: int = UNSET_NS) -> MotionSamples:
    sensors: dict[str, Samples] = {}
    for name, batch in message.sensors.items():
        if name in SENSORS:
            t_field, values_field = _FIELDS[name]
            t_ns = times(t_field, batch.t_ns)
            values = rows(values_field, batch.values, len(t_ns), SENSORS[name][0])
            of_bin = _LITTLE and isinstance(batch.t_ns, bytes) and isinstance(batch.values, bytes)
            sensors[name] = _samples_of_bin(t_ns, values) if of_bin else Samples(t_ns, values)
    if message.sensors and not sensors:
        raise WireError("sensors", shown(next(iter(message.sensors))), " | ".join(SENSORS), Outcome.UNKNOWN)
    return MotionSamples(sensors=sensors, t0_ns=t0_ns, t1_ns=t1_ns, **_common(message, arrival_ns))


def _samples_of_bin(t_ns: Ints, values: Floats) -> Samples:
    """Return ``Samples(t_ns, values)`` without its checks: arrays of ``bin`` are read-only, typed and fit already."""
    samples = object.__new__(Samples)
    object.__setattr__(samples, "t_ns", t_ns)
    object.__setattr__(samples, "values", values)
    return samples


def _scan(message: messages.Scan, arrival_ns: int) -> api.Scan:
    n = len(message.transmitters)
    heard_ns = times("heard_ns", message.heard_ns)
    if len(heard_ns) != n:
        raise WireError("heard_ns", f"{len(heard_ns)} elements", f"{n}, one for every transmitter")
    if n == 0 and message.t_ns is None:
        raise WireError("t_ns", "nothing", "the time of a scan without readings")
    return api.Scan(
        transmitters=tuple(message.transmitters),
        rssi_dbm=numbers("rssi_dbm", message.rssi_dbm, n),
        heard_ns=heard_ns,
        source=message.source,
        t_ns=UNSET_NS if message.t_ns is None else message.t_ns,
        **_common(message, arrival_ns),
    )


def _no_time(field: str, t_ns: int) -> WireError:
    return WireError(field, str(t_ns), f"a time from 0 to {LATEST_NS} ns")


def _common(message: EventMessage, arrival_ns: int) -> dict[str, Any]:
    return {
        "device": message.device,
        "session": message.session,
        "seq": message.seq,
        "arrival_ns": arrival_ns,
    }


def _fields(event: Event) -> dict[str, Any]:
    """Return what a device says of an event."""
    fields: dict[str, Any] = {"v": VERSION, "device": event.device, "session": event.session, "seq": int(event.seq)}
    match event:
        case MotionSamples():
            sensors = {
                name: {"t_ns": to_bin(samples.t_ns), "values": to_bin(samples.values)}
                for name, samples in event.sensors.items()
            }
            return fields | {"type": "motion", "sensors": sensors}
        case api.Scan():
            fields |= {"type": "scan", "transmitters": event.transmitters, "source": event.source}
            fields |= {"rssi_dbm": to_bin(event.rssi_dbm), "heard_ns": to_bin(event.heard_ns)}
        case api.Pressure():
            fields |= {"type": "pressure", "pressure_hpa": float(event.pressure_hpa)}
        case api.Fix():
            fields |= {"type": "fix", "floor": event.floor, "xy": to_bin(event.xy), "source": event.source}
            fields |= {"covariance": to_bin(event.covariance)}
        case api.Truth():
            fields |= {"type": "truth", "floor": event.floor, "xy": to_bin(event.xy)}
    return fields | {"t_ns": int(event.t_ns)}


def _encode(fields: dict[str, Any]) -> bytes:
    try:
        return _ENCODER.encode(fields)
    except UnicodeEncodeError as error:
        raise WireError("event", f"text {shown(error.object)}", "Unicode text without lone surrogates") from None
    except OverflowError as error:
        raise WireError("event", f"an integer: {error}", "integers of 64 bits") from None
