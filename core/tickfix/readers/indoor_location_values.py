"""Columns of an indoor-location record become values, or are refused: nothing is guessed."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, sqrt


class BadValueError(ValueError):
    """A record whose content cannot be; its text is the reason to count."""


def numbers(columns: Sequence[bytes]) -> tuple[float, ...]:
    """Return columns as finite numbers."""
    try:
        values = tuple(map(float, columns))
    except ValueError:
        raise BadValueError("not a number") from None
    if not all(map(isfinite, values)):
        raise BadValueError("non-finite number")
    if b"_" in b"".join(columns):  # Python reads 1_0 as 10, nobody who writes such files does
        raise BadValueError("not a number")
    return values


def rssi(column: bytes) -> float:
    """Return a received signal strength in dBm."""
    (rssi_dbm,) = numbers([column])
    if not -127.0 < rssi_dbm < 0.0:  # −127 and 0 are Android's words for "unknown"
        raise BadValueError("implausible rssi")
    return rssi_dbm


def identifier(column: bytes) -> str:
    """Return a transmitter's id, or a part of one."""
    if not column or not column.isascii() or not column.decode("ascii").isprintable() or b" " in column:
        raise BadValueError("broken transmitter id")
    return column.decode("ascii")


def quaternion(x: float, y: float, z: float) -> tuple[float, ...]:
    """Complete Android's rotation vector (x, y, z of a unit quaternion with w ≥ 0)."""
    square = x * x + y * y + z * z
    if square <= 1.0:
        return x, y, z, sqrt(1.0 - square)
    if square > 1.01:
        raise BadValueError("not a rotation")
    norm = sqrt(square)  # rounding pushed a half turn just over one
    return x / norm, y / norm, z / norm, 0.0
