"""Array types of the API, the one way an array crosses it (contiguous, typed, read-only), and angles: headings run
clockwise from +y (north)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final, TypeAlias, TypeGuard, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tickfix.api.errors import EventError

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Bools: TypeAlias = NDArray[np.bool_]

_FLOAT64: Final = np.dtype(np.float64)
_INT64: Final = np.dtype(np.int64)


def frozen(values: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """Return ``values`` as a C-contiguous, read-only array of ``dtype``.

    A writable array is copied, so that its owner cannot change what a value holds; one that is read-only already is
    shared.
    """
    array = np.asarray(values, dtype=dtype, order="C")
    if array.flags.writeable:
        if array is values or array.base is not None:
            array = array.copy()
        array.flags.writeable = False
    return array


def frozen_floats(name: str, values: ArrayLike, *shape: int | None) -> Floats:
    """Freeze ``values`` as float64 of the given ``shape`` (``None`` stands for any length).

    Raises:
        EventError: naming the field ``name`` when it is not numeric or has another shape.
    """
    return values if _is_frozen_as(values, _FLOAT64, shape) else _freeze_checked(name, values, _FLOAT64, shape)


def frozen_ints(name: str, values: ArrayLike, *shape: int | None) -> Ints:
    """Freeze ``values`` as int64 of the given ``shape``; floats are refused, since nanoseconds do not fit into them.

    Raises:
        EventError: naming the field ``name`` when it holds anything but integers or has another shape.
    """
    if _is_frozen_as(values, _INT64, shape):
        return values
    array = np.asarray(values)
    if array.size and array.dtype.kind not in "iu":
        raise EventError(f"{name}: found {array.dtype}, expected integers")
    return _freeze_checked(name, array, _INT64, shape)


NO_VALUES: Final[Mapping[str, Floats]] = MappingProxyType({})
"""Of readings that have a signal strength only."""


def frozen_columns(columns: Mapping[str, ArrayLike], n: int) -> Mapping[str, Floats]:
    """Return named columns, each (n,) float64, sorted by name and read-only.

    Raises:
        EventError: naming the column that has another length or is not numeric.
    """
    if not columns:
        return NO_VALUES
    return MappingProxyType({name: frozen_floats(f"values.{name}", columns[name], n) for name in sorted(columns)})


def _is_frozen_as(values: ArrayLike, dtype: np.dtype[Any], shape: tuple[int | None, ...]) -> TypeGuard[NDArray[Any]]:
    """Whether :func:`_freeze_checked` would return this very array, as it does for arrays from the wire."""
    if type(values) is not np.ndarray or values.dtype is not dtype:
        return False
    flags = values.flags
    return flags.c_contiguous and not flags.writeable and _has_shape(values.shape, shape)


def _freeze_checked(name: str, values: ArrayLike, dtype: Any, shape: tuple[int | None, ...]) -> NDArray[Any]:
    try:
        array = frozen(values, dtype)
    except (TypeError, ValueError) as error:
        raise EventError(f"{name}: found {values!r:.80}, expected an array of numbers") from error
    if array.size == 0 and len(shape) != array.ndim:
        array = frozen(np.empty([0 if n is None else n for n in shape], dtype))
    if not _has_shape(array.shape, shape):
        wanted = " × ".join("n" if n is None else str(n) for n in shape)
        raise EventError(f"{name}: found shape {array.shape}, expected {wanted}")
    return array


def _has_shape(found: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    if len(found) != len(wanted):
        return False
    for n, m in zip(found, wanted, strict=True):  # noqa: SIM110 - setting up a generator takes longer
        if m is not None and n != m:
            return False
    return True


@overload
def wrap_rad(angle: float) -> float: ...
@overload
def wrap_rad(angle: Floats) -> Floats: ...
def wrap_rad(angle: float | Floats) -> float | Floats:
    """Wrap an angle, or an array of them, into [−π, π)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def displacement(distance_m: float | Floats, heading_rad: float | Floats) -> Floats:
    """Return the way (…, 2) of ``distance_m`` along ``heading_rad``: d·sin θ, d·cos θ [jiang2015] eq. (13)."""
    return np.stack([distance_m * np.sin(heading_rad), distance_m * np.cos(heading_rad)], axis=-1)


def heading_of(way: Floats) -> float:
    """Return the heading of a displacement (2,), clockwise from +y."""
    return math.atan2(float(way[0]), float(way[1]))
