"""Sends a device's measurements; times and values are packed as ``bin`` without numpy."""

from __future__ import annotations

import sys
from array import array
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tickfix.client.connection import ClientError
from tickfix.client.session import Session


def pack_int64s(field: str, values: Any) -> tuple[bytes, int]:
    """Return integers as ``bin``, and how many they are; a list, or an array of int64 as numpy has them.

    Raises:
        ClientError: for anything but integers of 64 bits.
    """
    return _pack_array(field, values, "q", ("l", "q"), "integers of 64 bits")


def pack_float64s(field: str, values: Any) -> tuple[bytes, int]:
    """Return numbers as ``bin``, and how many they are; a list of numbers or of rows, or an array of float64.

    Raises:
        ClientError: for anything but numbers.
    """
    if isinstance(values, Sequence) and len(values) and not isinstance(values[0], int | float):
        values = [number for row in values for number in _checked_row(field, row)]
    return _pack_array(field, values, "d", ("d",), "numbers, or rows of numbers")


def _checked_row(field: str, row: Any) -> Iterable[Any]:
    if isinstance(row, Iterable) and not isinstance(row, str | bytes):
        return row
    raise ClientError(f"{field}: found {row!r:.60}; expected a row of numbers")


def _pack_array(field: str, values: Any, code: str, formats: tuple[str, ...], expected: str) -> tuple[bytes, int]:
    try:
        view = memoryview(values)
    except TypeError:
        pass
    else:
        if view.format in formats and view.itemsize == 8 and sys.byteorder == "little":
            return view.tobytes(), view.nbytes // 8
        values = _flatten(view.tolist())
    try:
        numbers = array(code, values)
    except (TypeError, OverflowError, ValueError) as error:
        raise ClientError(f"{field}: found {values!r:.60} ({error}); expected {expected}") from error
    if sys.byteorder == "big":
        numbers.byteswap()
    return numbers.tobytes(), len(numbers)


def _flatten(values: Any) -> list[Any]:
    if not isinstance(values, list):
        return [values]
    return [number for one in values for number in _flatten(one)]


class Sensor(Session):
    """Sends what one device measures, in a session of its own: see :class:`Session` for its arguments and attributes.

    Arrays are lists, or anything that offers a buffer, such as arrays of numpy.
    """

    def motion(self, sensors: Mapping[str, tuple[Any, Any]]) -> int:
        """Send samples of motion sensors; return the message's number.

        Args:
            sensors: by sensor name, times in ns (n integers) and values (n rows); lists or arrays of numpy.

        Raises:
            ClientError: for times and values that do not fit together.
            BufferFullError: see :class:`Session`.
        """
        batches = {}
        for name, (t_ns, values) in sensors.items():
            times, n = pack_int64s(f"{name}.t_ns", t_ns)
            rows, m = pack_float64s(f"{name}.values", values)
            if m % n if n else m:
                raise ClientError(f"{name}.values: found {m} numbers; expected a row for each of {n} times")
            batches[name] = {"t_ns": times, "values": rows}
        return self.send({"type": "motion", "sensors": batches})

    def scan(
        self,
        transmitters: list[str],
        rssi_dbm: Any,
        heard_ns: Any,
        *,
        t_ns: int | None = None,
        source: str = "wifi",
        values: Mapping[str, Any] | None = None,
    ) -> int:
        """Send what a scan received, each reading with its own time in ns; return the message's number.

        Args:
            transmitters: n ids.
            rssi_dbm: n signal strengths in dBm, None for a source that has none.
            heard_ns: n times.
            t_ns: time of the scan; one that received nothing needs it.
            source: such as ``wifi``, ``ble`` or ``uwb``.
            values: further columns by name, each n numbers, such as ``range_m``.

        Raises:
            ClientError, BufferFullError: as :meth:`motion`.
        """
        times, n = pack_int64s("heard_ns", heard_ns)
        if len(transmitters) != n:
            raise ClientError(f"scan: found {len(transmitters)} transmitters, {n} times; expected as many")
        columns = {} if rssi_dbm is None else {"rssi_dbm": rssi_dbm}
        packed: dict[str, Any] = {}
        for name, column in {**columns, **(values or {})}.items():
            packed[name], m = pack_float64s(name, column)
            if m != n:
                raise ClientError(f"scan: found {n} transmitters, {m} numbers of {name}; expected as many")
        fields: dict[str, Any] = {} if t_ns is None else {"t_ns": t_ns}
        fields |= {name: packed.pop(name) for name in columns}
        fields |= {"values": packed} if packed else {}
        return self.send(
            {"type": "scan", "transmitters": list(transmitters), "heard_ns": times, "source": source, **fields}
        )

    def pressure(self, t_ns: int, pressure_hpa: float) -> int:
        """Send one air pressure; return the message's number."""
        return self.send({"type": "pressure", "t_ns": t_ns, "pressure_hpa": float(pressure_hpa)})

    def fix(self, t_ns: int, floor: str, xy: Any, *, covariance: Any = None, source: str = "fix") -> int:
        """Send a position computed elsewhere, metres in the floor's frame, m²; return the message's number."""
        fields = {} if covariance is None else {"covariance": pack_float64s("covariance", covariance)[0]}
        place = {"t_ns": t_ns, "floor": floor, "xy": pack_float64s("xy", xy)[0], "source": source}
        return self.send({"type": "fix", **place, **fields})

    def truth(self, t_ns: int, floor: str, xy: Any) -> int:
        """Send where the device really is, for evaluation; return the message's number."""
        return self.send({"type": "truth", "t_ns": t_ns, "floor": floor, "xy": pack_float64s("xy", xy)[0]})
