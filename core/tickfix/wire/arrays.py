"""Arrays as they stand in messages: ``bin`` of little-endian numbers, or lists."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from tickfix.api import Floats, Ints
from tickfix.wire.errors import WireError

_INT64: Final = np.dtype("<i8")
_FLOAT64: Final = np.dtype("<f8")


def to_bin(array: Floats | Ints) -> bytes:
    """Return the elements of a float64 or int64 array in row-major order, little-endian, bit for bit."""
    wanted = _INT64 if array.dtype.kind == "i" else _FLOAT64
    return array.tobytes() if array.dtype is wanted else array.astype(wanted).tobytes()


def times(field: str, value: bytes | list[int]) -> Ints:
    """Return (n,) int64.

    Raises:
        WireError: for ``bin`` that is no whole number of elements.
    """
    if isinstance(value, bytes):
        array: Ints = _elements(field, value, _INT64)
        return array
    return np.array(value, dtype=np.int64)


def numbers(field: str, value: bytes | list[float], length: int | None = None) -> Floats:
    """Return (n,) float64, of ``length`` elements where told.

    Raises:
        WireError: for another length, or ``bin`` that is no whole number of elements.
    """
    array: Floats = _elements(field, value, _FLOAT64) if isinstance(value, bytes) else np.array(value, dtype=np.float64)
    if length is not None and len(array) != length:
        raise WireError(field, f"{len(array)} elements", str(length))
    return array


def rows(field: str, value: bytes | list[list[float]], n: int, columns: int) -> Floats:
    """Return (n, columns) float64.

    Raises:
        WireError: for another number of rows or columns, naming the first row that is wrong.
    """
    if isinstance(value, bytes):
        flat: Floats = _elements(field, value, _FLOAT64)
        if len(flat) != n * columns:
            raise WireError(field, f"{len(value)} bytes", f"{n} × {columns} × 8, a row for every time")
        return flat.reshape(n, columns)
    if len(value) != n:
        raise WireError(field, f"{len(value)} rows", f"{n}, one for every time")
    for i, row in enumerate(value):
        if len(row) != columns:
            raise WireError(f"{field}[{i}]", f"{len(row)} columns", str(columns))
    return np.array(value, dtype=np.float64).reshape(n, columns)


def _elements(field: str, value: bytes, dtype: np.dtype[Any]) -> Any:
    if len(value) % 8:
        raise WireError(field, f"{len(value)} bytes", "a multiple of 8")
    return np.frombuffer(value, dtype)
