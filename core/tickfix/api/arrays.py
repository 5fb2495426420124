"""Array types of the interface, and the one way an array crosses it: contiguous, typed, read-only."""

from __future__ import annotations

from typing import Any, Final, TypeAlias, TypeGuard

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

    A writable array is copied, so that nobody outside can change what a value holds; one that is read-only already is
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
    return values if _is_frozen(values, _FLOAT64, shape) else _frozen(name, values, _FLOAT64, shape)


def frozen_ints(name: str, values: ArrayLike, *shape: int | None) -> Ints:
    """Freeze ``values`` as int64 of the given ``shape``; floats are refused, since nanoseconds do not fit into them.

    Raises:
        EventError: naming the field ``name`` when it holds anything but integers or has another shape.
    """
    if _is_frozen(values, _INT64, shape):
        return values
    array = np.asarray(values)
    if array.size and array.dtype.kind not in "iu":
        raise EventError(f"{name}: found {array.dtype}, expected integers")
    return _frozen(name, array, _INT64, shape)


def _is_frozen(values: ArrayLike, dtype: np.dtype[Any], shape: tuple[int | None, ...]) -> TypeGuard[NDArray[Any]]:
    """Whether :func:`_frozen` would return this very array, as it does where one came over the wire."""
    if type(values) is not np.ndarray or values.dtype is not dtype:
        return False
    flags = values.flags
    return flags.c_contiguous and not flags.writeable and _fits(values.shape, shape)


def _frozen(name: str, values: ArrayLike, dtype: Any, shape: tuple[int | None, ...]) -> NDArray[Any]:
    try:
        array = frozen(values, dtype)
    except (TypeError, ValueError) as error:
        raise EventError(f"{name}: found {values!r:.80}, expected an array of numbers") from error
    if array.size == 0 and len(shape) != array.ndim:
        array = frozen(np.empty([0 if n is None else n for n in shape], dtype))
    if not _fits(array.shape, shape):
        wanted = " × ".join("n" if n is None else str(n) for n in shape)
        raise EventError(f"{name}: found shape {array.shape}, expected {wanted}")
    return array


def _fits(found: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    if len(found) != len(wanted):
        return False
    for n, m in zip(found, wanted, strict=True):  # noqa: SIM110 - setting up a generator takes longer
        if m is not None and n != m:
            return False
    return True
