"""What a device says, as types: every message is a MessagePack map with its ``type`` and the protocol's version.

Arrays of times and values are lists, or, cheaper, ``bin`` of little-endian int64 or float64 in row-major order. Fields
that are not named here are skipped without being built. ``docs/wire-protocol.md`` is the manual, and
``docs/wire-schema.json`` is made of these types.
"""

from __future__ import annotations

from typing import Annotated, Final, TypeAlias

from msgspec import Meta, Struct

from tickfix.wire.limits import CEILING

VERSION: Final = 1
"""The protocol version spoken here."""

OLDEST_VERSION: Final = 1
"""The oldest version that is still understood."""

TIME: Final = "tickfix-time"
"""Marks times in the schema, until it says from when to when they run."""

Int64: TypeAlias = Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)]
Time: TypeAlias = Annotated[int, Meta(ge=-(2**63), le=2**63 - 1, extra_json_schema={TIME: True})]
"""Whatever 64 bits hold is decoded, for journals may hold it; what a device says is for ``check_sent`` to judge."""
Count: TypeAlias = Annotated[int, Meta(ge=0, le=2**63 - 1)]
Times: TypeAlias = bytes | Annotated[list[Time], Meta(max_length=CEILING)]
Numbers: TypeAlias = bytes | Annotated[list[float], Meta(max_length=CEILING)]
Rows: TypeAlias = bytes | Annotated[list[Annotated[list[float], Meta(max_length=16)]], Meta(max_length=CEILING)]
Texts: TypeAlias = Annotated[list[str], Meta(max_length=CEILING)]


class SensorMessage(Struct, kw_only=True, frozen=True, tag_field="type"):
    """What every message of a device carries.

    Attributes:
        v: protocol version.
        device: name of the device.
        session: changes whenever the device begins to count anew; empty for a device that does not count.
        seq: number of the message within its session, from 1; 0 is not counted and never taken for a duplicate.
        ack: the device wants to be told what became of the message.
    """

    v: Count
    device: str
    session: str = ""
    seq: Count = 0
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


class SensorBatch(Struct, kw_only=True, frozen=True):
    """One sensor's samples.

    Attributes:
        t_ns: n times in ns, on the device's clock.
        values: n rows, columns and units as :data:`tickfix.api.SENSORS` says.
    """

    t_ns: Times
    values: Rows


class Motion(SensorMessage, tag="motion", kw_only=True, frozen=True):
    """Samples of motion sensors, each with its own times.

    Attributes:
        sensors: samples by sensor name.
        arrival_ns, t0_ns, t1_ns: in the journal only; what a device says here is not looked at.
    """

    sensors: Annotated[dict[str, SensorBatch], Meta(max_length=64)]
    arrival_ns: Int64 | None = None
    t0_ns: Int64 | None = None
    t1_ns: Int64 | None = None


class Scan(SensorMessage, tag="scan", kw_only=True, frozen=True):
    """What one Wi-Fi or Bluetooth scan heard.

    Attributes:
        transmitters: n ids.
        rssi_dbm: n received signal strengths in dBm.
        heard_ns: n times in ns, when each was heard.
        t_ns: time of the scan; that of the newest reading where not told.
        source: ``wifi`` or ``ble``.
        arrival_ns: in the journal only.
    """

    transmitters: Texts
    rssi_dbm: Numbers
    heard_ns: Times
    t_ns: Time | None = None
    source: str = "wifi"
    arrival_ns: Int64 | None = None


class Pressure(SensorMessage, tag="pressure", kw_only=True, frozen=True):
    """One air pressure.

    Attributes:
        t_ns: when it was measured, ns on the device's clock.
        pressure_hpa: hectopascal.
        arrival_ns: in the journal only.
    """

    t_ns: Time
    pressure_hpa: float
    arrival_ns: Int64 | None = None


class Fix(SensorMessage, tag="fix", kw_only=True, frozen=True):
    """A position computed elsewhere.

    Attributes:
        floor: name of the floor.
        xy: two numbers, metres in the floor's frame, x east and y north.
        covariance: 2 × 2 in m²; 25 m² each way where not told.
        t_ns: the instant the position describes, ns on the device's clock.
        source: what computed it.
        arrival_ns: in the journal only.
    """

    t_ns: Time
    floor: str
    xy: Numbers
    covariance: Rows | None = None
    source: str = "fix"
    arrival_ns: Int64 | None = None


class Truth(SensorMessage, tag="truth", kw_only=True, frozen=True):
    """Where the device really is, for evaluation; no tracker sees it.

    Attributes:
        t_ns: when, ns on the device's clock.
        arrival_ns: in the journal only.
        floor: name of the floor.
        xy: two numbers, metres in the floor's frame.
    """

    t_ns: Time
    floor: str
    xy: Numbers
    arrival_ns: Int64 | None = None


class Bye(SensorMessage, tag="bye", kw_only=True, frozen=True):
    """The device leaves: its track is settled and forgotten."""


EventMessage: TypeAlias = Motion | Scan | Pressure | Fix | Truth
Message: TypeAlias = Hello | Motion | Scan | Pressure | Fix | Truth | Bye
"""What a device may send."""
