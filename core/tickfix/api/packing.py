"""One ``pack`` and ``unpack`` for states: frozen dataclasses of arrays, scalars, strings, tuples, dataclasses and
read-only mappings (``MappingProxyType``) with text for keys.

The bytes are canonical MessagePack: equal states give equal bytes, on any machine. Nothing is pickled, and unpacking
builds only the dataclasses that the expected type itself names.
"""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from operator import attrgetter
from types import MappingProxyType
from typing import Any, Final, TypeVar

import msgpack
import numpy as np

T = TypeVar("T")

OMIT_EMPTY: Final = MappingProxyType({"tickfix.omit_empty": True})
"""Metadata of a dataclass field, the last of its class, that is not packed where it is empty: so that what was packed
before the field existed, and what does without it, has the same bytes."""

_ARRAY: Final = 1
_DATACLASS: Final = 2
_DTYPE_KINDS: Final = frozenset("biuf")
_SCALAR_TYPES: Final = frozenset({float, int, bool, str, bytes, type(None)})


@dataclass(frozen=True, slots=True, eq=False)
class PrepackedValue:
    """Stands, in what is packed, for the dataclass or array that was packed to these bytes before."""

    data: bytes


def pack(state: Any) -> bytes:
    """Return the bytes of ``state``.

    Raises:
        TypeError: naming what it found when a value is of a type that states may not hold.
    """
    packed: bytes = msgpack.packb(_to_packable(state), use_bin_type=True)
    return packed


def unpack(data: bytes, like: type[T]) -> T:
    """Return the value that :func:`pack` was given, which must be of type ``like``.

    Raises:
        ValueError: when the bytes are no such value.
    """
    expected: Any = like  # a type, for the cache: of type[T] mypy does not know that it can be hashed
    known = _reachable_dataclasses(expected)

    def build(code: int, body: bytes) -> Any:
        if code == _ARRAY:
            dtype, shape, raw = msgpack.unpackb(body, raw=False)
            array = np.frombuffer(raw, dtype=np.dtype(dtype)).reshape(shape)
            array.flags.writeable = False
            return array
        name, *values = msgpack.unpackb(body, ext_hook=build, object_hook=MappingProxyType, use_list=False, raw=False)
        if name not in known:
            raise ValueError(f"found a packed {name}, expected one of {', '.join(sorted(known))}")
        cls = known[name]
        fields = dataclasses.fields(cls)
        if len(values) == len(fields) - 1 and fields[-1].metadata == OMIT_EMPTY:
            fields = fields[:-1]
        return cls(**dict(zip((f.name for f in fields), values, strict=True)))

    try:
        value = msgpack.unpackb(data, ext_hook=build, object_hook=MappingProxyType, use_list=False, raw=False)
    except (TypeError, SyntaxError, msgpack.UnpackException) as error:
        raise ValueError(f"found bytes that are no packed {like.__name__}: {error}") from error
    if not isinstance(value, like):
        raise ValueError(f"found a packed {type(value).__name__}, expected {like.__name__}")  # noqa: TRY004 - bad data
    return value


def nbytes(state: Any) -> int:
    """Return roughly how much memory ``state`` holds: its arrays and 64 bytes for every other value."""
    found, todo = 0, [state]
    while todo:
        value = todo.pop()
        found += 64
        kind = value.__class__
        if kind is tuple:
            todo += value
        elif kind not in _SCALAR_TYPES:
            if isinstance(value, np.ndarray):
                found += int(value.nbytes) + 32
            elif (within := field_values_getter(kind)) is not None:
                todo += within(value)
            elif isinstance(value, tuple):
                todo += value
    return found


@lru_cache(maxsize=1024)
def field_values_getter(cls: Any) -> Callable[[Any], tuple[Any, ...]] | None:
    """Return what gives the values of a dataclass's fields, None for another class; states are walked at every tick."""
    if not dataclasses.is_dataclass(cls):
        return None
    names = [f.name for f in dataclasses.fields(cls)]
    if len(names) > 1:
        return attrgetter(*names)
    return lambda value: tuple(getattr(value, name) for name in names)


def _to_packable(value: Any) -> Any:  # noqa: PLR0911 - one for each type
    if value.__class__ in _SCALAR_TYPES:
        return value
    if isinstance(value, MappingProxyType):
        return {str(key): _to_packable(item) for key, item in sorted(value.items())}
    if isinstance(value, (int, float, str, bytes, np.generic)):
        return value.item() if isinstance(value, np.generic) else value
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in _DTYPE_KINDS:
            raise TypeError(f"states hold arrays of numbers, found dtype {value.dtype}")
        little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        return msgpack.ExtType(_ARRAY, msgpack.packb([little.dtype.str, list(value.shape), little.tobytes()]))
    if isinstance(value, tuple):
        return [_to_packable(item) for item in value]
    if isinstance(value, PrepackedValue):
        return msgpack.unpackb(value.data)  # to its type and bytes: what is in them stays as it is
    if (within := field_values_getter(value.__class__)) is not None:
        fields = [_to_packable(item) for item in within(value)]
        if fields and not fields[-1] and dataclasses.fields(value)[-1].metadata == OMIT_EMPTY:
            fields.pop()
        return msgpack.ExtType(_DATACLASS, msgpack.packb([type(value).__qualname__, *fields], use_bin_type=True))
    raise TypeError(f"states hold arrays, numbers, strings, tuples and dataclasses, found {type(value).__name__}")


@lru_cache(maxsize=256)
def _reachable_dataclasses(root: Any) -> Mapping[str, type[Any]]:
    found: dict[str, type[Any]] = {}
    todo = [root]
    while todo:
        hint = todo.pop()
        todo.extend(typing.get_args(hint))
        if isinstance(hint, type) and dataclasses.is_dataclass(hint) and hint.__qualname__ not in found:
            found[hint.__qualname__] = hint
            todo.extend(typing.get_type_hints(hint).values())
    return found
