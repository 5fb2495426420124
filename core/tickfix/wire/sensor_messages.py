"""Messages that a device sends, as msgspec types, and the limits on their size.

Every message is a MessagePack map with its ``type`` and the protocol version ``v``. Arrays of times and values are
lists, or, cheaper, ``bin`` of little-endian int64 or float64 in row-major order. Unknown fields are skipped without
being built. ``docs/wire-protocol.md`` is the manual; ``docs/wire-schema.json`` is generated from these types."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Final, TypeAlias

from msgspec import UNSET, Meta, Struct, UnsetType

from tickfix.api.events import MAX_COLUMNS

MAX_ARRAY_LENGTH: Final = 65_536
"""No list of a message may be longer, whatever the limits are: arrays this long are refused before they are built."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageLimits:
    """Upper limits of a message; sent to a device in its ``welcome``.

    Attributes:
        message_bytes: length of the message.
        samples: samples of one sensor in one message.
        readings: readings of one scan.
        text_chars: characters of a name or any other text.
        fields: fields of the message, unknown ones included.
    """

    message_bytes: int = 262_144
    samples: int = 4_096
    readings: int = 1_024
    text_chars: int = 256
    fields: int = 64

    def __post_init__(self) -> None:
        """Check the limits themselves.

        Raises:
            ValueError: for a limit below 1, or a number of elements above :data:`MAX_ARRAY_LENGTH`.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            upper_bound = 2**31 if field.name == "message_bytes" else MAX_ARRAY_LENGTH
            if not 1 <= value <= upper_bound:
                raise ValueError(f"{field.name}: found {value}; expected 1 to {upper_bound}")


VERSION: Final = 1
"""The protocol version spoken here."""

OLDEST_VERSION: Final = 1
"""The oldest version that is still understood."""

TIME_MARKER: Final = "tickfix-time"
"""Marks times in the schema, where their range is filled in."""

Int64: TypeAlias = Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)]
WireTime: TypeAlias = Annotated[int, Meta(ge=-(2**63), le=2**63 - 1, extra_json_schema={TIME_MARKER: True})]
"""Whatever 64 bits hold is decoded, for journals may hold it; what a device says is for ``check_received_event`` to
judge.
"""
UInt63: TypeAlias = Annotated[int, Meta(ge=0, le=2**63 - 1)]
TimeArray: TypeAlias = bytes | Annotated[list[WireTime], Meta(max_length=MAX_ARRAY_LENGTH)]
FloatArray: TypeAlias = bytes | Annotated[list[float], Meta(max_length=MAX_ARRAY_LENGTH)]
FloatRows: TypeAlias = (
    bytes | Annotated[list[Annotated[list[float], Meta(max_length=MAX_COLUMNS)]], Meta(max_length=MAX_ARRAY_LENGTH)]
)
TextArray: TypeAlias = Annotated[list[str], Meta(max_length=MAX_ARRAY_LENGTH)]


class SensorMessage(Struct, kw_only=True, frozen=True, tag_field="type"):
    """What every message of a device carries.

    Attributes:
        v: protocol version.
        device: name of the device.
        session: changes whenever the device restarts its numbers; empty for a device without numbers.
        seq: number of the message within its session, from 1; 0 is not counted and never taken for a duplicate.
        ack: the device requests an acknowledgement with the outcome of the message.
    """

    v: UInt63
    device: str
    session: str = ""
    seq: UInt63 = 0
    ack: bool = False


class Hello(SensorMessage, tag="hello", kw_only=True, frozen=True):
    """Opens a session.

    Attributes:
        sensors: nominal rate in Hz by sensor name.
        software: what sends, such as ``tickfix.client 0.1``.
        clock: what the times count, such as ``boot`` or ``unix``.
    """

    sensors: Annotated[dict[str, float], Meta(max_length=64)] = {}
    software: str = ""
    clock: str = ""


class SensorSamples(Struct, kw_only=True, frozen=True):
    """One sensor's samples.

    Attributes:
        t_ns: n times in ns, on the device's clock.
        values: n rows, columns and units as in :data:`tickfix.api.SENSORS` or the declaration of the sensor.
    """

    t_ns: TimeArray
    values: FloatRows


class MotionMessage(SensorMessage, tag="motion", kw_only=True, frozen=True):
    """Samples of motion sensors, each with its own times.

    Attributes:
        sensors: samples by sensor name, known or not.
        arrival_ns, t0_ns, t1_ns: in the journal only; ignored in messages of a device.
    """

    sensors: Annotated[dict[str, SensorSamples], Meta(max_length=64)]
    arrival_ns: Int64 | None = None
    t0_ns: Int64 | None = None
    t1_ns: Int64 | None = None


class ScanMessage(SensorMessage, tag="scan", kw_only=True, frozen=True):
    """What one scan received: signal strengths, ranges …

    Attributes:
        transmitters: n ids.
        rssi_dbm: n received signal strengths in dBm; NaN, or all left out, where there are none.
        heard_ns: n times in ns, when each was heard.
        t_ns: time of the scan; by default that of the newest reading.
        source: ``wifi``, ``ble``, or any other name, such as ``uwb``.
        values: further columns by name, each n numbers, such as ``range_m``.
        arrival_ns: in the journal only.
    """

    transmitters: TextArray
    heard_ns: TimeArray
    rssi_dbm: FloatArray | UnsetType = UNSET
    values: Annotated[dict[str, FloatArray], Meta(max_length=16)] = {}
    t_ns: WireTime | None = None
    source: str = "wifi"
    arrival_ns: Int64 | None = None


class PressureMessage(SensorMessage, tag="pressure", kw_only=True, frozen=True):
    """One air pressure.

    Attributes:
        t_ns: when it was measured, ns on the device's clock.
        pressure_hpa: hectopascal.
        arrival_ns: in the journal only.
    """

    t_ns: WireTime
    pressure_hpa: float
    arrival_ns: Int64 | None = None


class FixMessage(SensorMessage, tag="fix", kw_only=True, frozen=True):
    """A position computed elsewhere.

    Attributes:
        floor: name of the floor.
        xy: two numbers, metres in the floor's frame, x east and y north.
        covariance: 2 × 2 in m²; by default 25 m² per axis.
        t_ns: the instant the position describes, ns on the device's clock.
        source: what computed it.
        arrival_ns: in the journal only.
    """

    t_ns: WireTime
    floor: str
    xy: FloatArray
    covariance: FloatRows | None = None
    source: str = "fix"
    arrival_ns: Int64 | None = None


class TruthMessage(SensorMessage, tag="truth", kw_only=True, frozen=True):
    """Where the device really is, for evaluation; no tracker sees it.

    Attributes:
        t_ns: when, ns on the device's clock.
        arrival_ns: in the journal only.
        floor: name of the floor.
        xy: two numbers, metres in the floor's frame.
    """

    t_ns: WireTime
    floor: str
    xy: FloatArray
    arrival_ns: Int64 | None = None


class Bye(SensorMessage, tag="bye", kw_only=True, frozen=True):
    """The device leaves: its track is settled and forgotten."""


EventMessage: TypeAlias = MotionMessage | ScanMessage | PressureMessage | FixMessage | TruthMessage
DeviceMessage: TypeAlias = Hello | MotionMessage | ScanMessage | PressureMessage | FixMessage | TruthMessage | Bye
"""What a device may send."""
