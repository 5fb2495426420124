"""Times and values as the wire has them: ``bin`` of little-endian int64 and float64, without numpy."""

from __future__ import annotations

import sys
from array import array
from collections.abc import Iterable, Sequence
from typing import Any

from tickfix.client.connection import ClientError


def int64s(field: str, values: Any) -> tuple[bytes, int]:
    """Return integers as ``bin``, and how many they are; a list, or an array of int64 as numpy has them.

    Raises:
        ClientError: for anything but integers of 64 bits.
    """
    return _packed(field, values, "q", ("l", "q"), "integers of 64 bits")


def float64s(field: str, values: Any) -> tuple[bytes, int]:
    """Return numbers as ``bin``, and how many they are; a list of numbers or of rows, or an array of float64.

    Raises:
        ClientError: for anything but numbers.
    """
    if isinstance(values, Sequence) and len(values) and not isinstance(values[0], int | float):
        values = [number for row in values for number in _row(field, row)]
    return _packed(field, values, "d", ("d",), "numbers, or rows of numbers")


def _row(field: str, row: Any) -> Iterable[Any]:
    if isinstance(row, Iterable) and not isinstance(row, str | bytes):
        return row
    raise ClientError(f"{field}: found {row!r:.60}; expected a row of numbers")


def _packed(field: str, values: Any, code: str, formats: tuple[str, ...], expected: str) -> tuple[bytes, int]:
    try:
        view = memoryview(values)
    except TypeError:
        pass
    else:
        if view.format in formats and view.itemsize == 8 and sys.byteorder == "little":
            return view.tobytes(), view.nbytes // 8
        values = _flat(view.tolist())
    try:
        numbers = array(code, values)
    except (TypeError, OverflowError, ValueError) as error:
        raise ClientError(f"{field}: found {values!r:.60} ({error}); expected {expected}") from error
    if sys.byteorder == "big":
        numbers.byteswap()
    return numbers.tobytes(), len(numbers)


def _flat(values: Any) -> list[Any]:
    if not isinstance(values, list):
        return [values]
    return [number for one in values for number in _flat(one)]
