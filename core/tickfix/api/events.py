"""What is measured: immutable events with their units in the names.

Every event carries two times in integer nanoseconds: ``t_ns``, when it was measured on the device's own clock, and
``arrival_ns``, when it reached tickfix (in a recording: when it was logged). Events are ordered by the first and enter
in the order of the second. ``seq`` counts a device's messages within a ``session`` and serves to recognise duplicates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tickfix.api.arrays import NO_VALUES, Floats, Ints, frozen_columns, frozen_floats, frozen_ints
from tickfix.api.errors import EventError
from tickfix.api.packing import OMIT_EMPTY

TICK_NS: Final = 200_000_000
"""The grid of device time: tick *k* is the instant ``k * TICK_NS`` and closes the interval before it."""

LATEST_NS: Final = 2**62 - 1
"""Times run from 0 to this (on a clock that counts from 1970, into the year 2116): a measurement with another one has
no time, and is left out. There is room above it, so that ticks and sums of two times fit into 64 bits."""

UNSET_NS: Final = -(2**63)
"""A missing time; the event fills in what its own content implies."""

SENSORS: Final[Mapping[str, tuple[int, str]]] = MappingProxyType(
    {
        "accelerometer": (3, "m/s², device frame, gravity included"),
        "gyroscope": (3, "rad/s, device frame"),
        "magnetometer": (3, "µT, device frame"),
        "rotation_vector": (4, "unit quaternion x, y, z, w from device to east-north-up"),
        "pressure": (1, "hPa"),
    }
)
"""Sensors that tickfix knows: the number of columns of a sample and what they hold. Others have any name and columns of
their own, see :class:`tickfix.api.Source`."""

MAX_COLUMNS: Final = 64
"""Columns of one sample of a sensor at most."""

_NO_RSSI: Final = frozen_floats("rssi_dbm", (), 0)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """One sensor's samples.

    Attributes:
        t_ns: (n,) int64, device clock.
        values: (n, c) float64, columns and unit as in :data:`SENSORS` or the declaration of the sensor.
    """

    t_ns: Ints
    values: Floats

    def __post_init__(self) -> None:
        """Freeze the arrays and check that they have one length."""
        t_ns = frozen_ints("t_ns", self.t_ns, None)
        values = frozen_floats("values", self.values, len(t_ns), None)
        if t_ns is not self.t_ns:
            object.__setattr__(self, "t_ns", t_ns)
        if values is not self.values:
            object.__setattr__(self, "values", values)

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.t_ns)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MotionSamples:
    """Samples of one or more motion sensors, each with its own times.

    A dead-reckoning algorithm gets the same type: there it holds what was measured in (``t0_ns``, ``t1_ns``], each
    sensor's times strictly increasing and every value finite.

    Attributes:
        sensors: samples by sensor name; a sensor that was silent is absent. Names of :data:`SENSORS` have the columns
            given there; samples of any other name are carried to the dead-reckoning stage as they are.
        t0_ns, t1_ns: the interval covered; by default from the oldest to the newest sample.
    """

    sensors: Mapping[str, Samples]
    t0_ns: int = UNSET_NS
    t1_ns: int = UNSET_NS
    device: str = ""
    arrival_ns: int = UNSET_NS
    session: str = ""
    seq: int = 0

    def __post_init__(self) -> None:
        """Check sensor names and columns, and fill in what the samples imply.

        Raises:
            EventError: for a known sensor with another number of columns, any other with none or over
                :data:`MAX_COLUMNS`.
        """
        for name, samples in self.sensors.items():
            found = samples.values.shape[1]
            if name in SENSORS:
                columns, unit = SENSORS[name]
                if found != columns:
                    raise EventError(f"{name}: found {found} columns, expected {columns} ({unit})")
            elif len(samples) and not 1 <= found <= MAX_COLUMNS:
                raise EventError(f"{name}: found {found} columns, expected 1 to {MAX_COLUMNS}")
        object.__setattr__(self, "sensors", MappingProxyType(dict(self.sensors)))
        if UNSET_NS in (self.t0_ns, self.t1_ns):
            self._cover()
        if self.arrival_ns == UNSET_NS:
            object.__setattr__(self, "arrival_ns", self.t1_ns)

    def _cover(self) -> None:
        """Fill in the interval from the oldest to the newest sample, where it is missing."""
        times = np.frombuffer(b"".join([samples.t_ns.tobytes() for samples in self.sensors.values()]), np.int64)
        # Integers: the smallest one is the one found first, and finding it takes a fifth of the time of ``min``.
        if self.t0_ns == UNSET_NS:
            object.__setattr__(self, "t0_ns", times.item(times.argmin()) if len(times) else 0)
        if self.t1_ns == UNSET_NS:
            object.__setattr__(self, "t1_ns", times.item(times.argmax()) if len(times) else self.t0_ns)

    @property
    def t_ns(self) -> int:
        """The newest sample's time."""
        return self.t1_ns

    def __len__(self) -> int:
        """Return the number of samples of all sensors together."""
        return sum(len(samples) for samples in self.sensors.values())


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scan:
    """What one scan received: signal strengths of Wi-Fi or Bluetooth, ranges to anchors, each reading at its own time.

    Attributes:
        transmitters: n transmitter ids (a BSSID, a beacon's id, an anchor's).
        rssi_dbm: (n,) float64, received signal strength in dBm; NaN where there is none, for all readings by default.
        heard_ns: (n,) int64, when each was heard; phones report readings that are many seconds old.
        t_ns: the newest reading's time; must be given for a scan without readings.
        source: what was scanned: ``"wifi"``, ``"ble"``, or any other name, such as ``"uwb"`` or ``"rtt"``.
        values: further columns by name, each (n,) float64, such as ``range_m``; NaN where a reading has none. A reading
            is used when its time is possible, none of its numbers is infinite, and one of them at least is not NaN.
    """

    transmitters: tuple[str, ...]
    rssi_dbm: Floats = field(default_factory=lambda: _NO_RSSI)
    heard_ns: Ints
    t_ns: int = UNSET_NS
    source: str = "wifi"
    device: str = ""
    arrival_ns: int = UNSET_NS
    session: str = ""
    seq: int = 0
    values: Mapping[str, Floats] = field(default_factory=lambda: NO_VALUES, metadata=OMIT_EMPTY)

    def __post_init__(self) -> None:
        """Freeze the arrays and date the scan by its newest reading.

        Raises:
            EventError: when lengths differ, or a scan without readings has no time.
        """
        n = len(self.transmitters)
        object.__setattr__(self, "transmitters", tuple(self.transmitters))
        if self.rssi_dbm is _NO_RSSI:
            object.__setattr__(self, "rssi_dbm", np.full(n, np.nan))
        if self.values is not NO_VALUES:
            object.__setattr__(self, "values", frozen_columns(self.values, n))
        object.__setattr__(self, "rssi_dbm", frozen_floats("rssi_dbm", self.rssi_dbm, n))
        object.__setattr__(self, "heard_ns", frozen_ints("heard_ns", self.heard_ns, n))
        if self.t_ns == UNSET_NS:
            if n == 0:
                raise EventError("t_ns: a scan without readings needs its time")
            object.__setattr__(self, "t_ns", int(self.heard_ns.max()))
        if self.arrival_ns == UNSET_NS:
            object.__setattr__(self, "arrival_ns", self.t_ns)

    def __len__(self) -> int:
        """Return the number of readings."""
        return len(self.transmitters)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pressure:
    """One air pressure; a dead-reckoning algorithm sees it as the sensor ``pressure`` among its samples.

    Attributes:
        pressure_hpa: hectopascal.
    """

    t_ns: int
    pressure_hpa: float
    device: str = ""
    arrival_ns: int = UNSET_NS
    session: str = ""
    seq: int = 0

    def __post_init__(self) -> None:
        """Use the time of measurement as arrival if that is missing."""
        if self.arrival_ns == UNSET_NS:
            object.__setattr__(self, "arrival_ns", self.t_ns)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fix:
    """A position computed from a scan, by a fingerprint here or by another process.

    Attributes:
        t_ns: the instant the position describes. A fingerprint that uses old readings dates its fix accordingly: it may
            lie seconds before the scan that brought it.
        floor: name of the floor, metres are in its frame.
        xy: (2,) float64, metres, x east and y north.
        covariance: (2, 2) float64, m².
        source: what computed it.
    """

    t_ns: int
    floor: str
    xy: Floats
    covariance: Floats = field(default_factory=lambda: frozen_floats("covariance", 25.0 * np.eye(2), 2, 2))
    source: str = "fix"
    device: str = ""
    arrival_ns: int = UNSET_NS
    session: str = ""
    seq: int = 0

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "xy", frozen_floats("xy", self.xy, 2))
        object.__setattr__(self, "covariance", frozen_floats("covariance", self.covariance, 2, 2))
        if self.arrival_ns == UNSET_NS:
            object.__setattr__(self, "arrival_ns", self.t_ns)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Truth:
    """Where the device really was: for evaluation only, no tracker ever sees one.

    Attributes:
        xy: (2,) float64, metres, floor frame.
    """

    t_ns: int
    floor: str
    xy: Floats
    device: str = ""
    arrival_ns: int = UNSET_NS
    session: str = ""
    seq: int = 0

    def __post_init__(self) -> None:
        """Freeze the array."""
        object.__setattr__(self, "xy", frozen_floats("xy", self.xy, 2))
        if self.arrival_ns == UNSET_NS:
            object.__setattr__(self, "arrival_ns", self.t_ns)


Event: TypeAlias = MotionSamples | Scan | Pressure | Fix | Truth


def motion_samples(
    t_ns: ArrayLike,
    *,
    device: str = "",
    arrival_ns: int = UNSET_NS,
    session: str = "",
    seq: int = 0,
    **sensors: ArrayLike,
) -> MotionSamples:
    """Build :class:`MotionSamples` of sensors that share their times ``t_ns``, one keyword a sensor."""
    times = np.asarray(t_ns, dtype=np.int64)
    return MotionSamples(
        sensors={name: Samples(times, np.asarray(values, dtype=np.float64)) for name, values in sensors.items()},
        device=device,
        arrival_ns=arrival_ns,
        session=session,
        seq=seq,
    )
