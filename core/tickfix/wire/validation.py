"""Checked MessagePack decoding.

Maps, versions and arrays; every :class:`WireError` names field, value found and value expected.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, ClassVar, Final, TypeVar

import msgspec
import numpy as np

from tickfix.api import Floats, Ints, TickfixError
from tickfix.api.events import MAX_COLUMNS
from tickfix.wire.sensor_messages import OLDEST_VERSION, VERSION


class ReplyOutcome(StrEnum):
    """The answer to a message: exactly one each, so that messages in = sum of outcomes.

    The first five are the kernel's, see MessageOutcome there, with the same values. With the others a port
    or the engine refuses a message before the kernel sees it.
    """

    ACCEPTED = "accepted"
    """In the timeline, or held until the clock it shows is confirmed."""
    LATE = "late"
    """In the timeline, behind a tick that was closed already: the past is revised."""
    STALE = "stale"
    """Beyond the horizon: not used."""
    DUPLICATE = "duplicate"
    """Received before."""
    MALFORMED = "malformed"
    """Nothing in it can be used."""
    UNAUTHORISED = "unauthorised"
    """The peer may not send this."""
    BUSY = "busy"
    """The engine has no room now; send it again later."""
    THROTTLED = "throttled"
    """The peer sends more than its rate limit allows."""
    UNKNOWN = "unknown"
    """A type or version that is not known here."""


class WireError(TickfixError):
    """Bytes that are no message of this protocol, or one that cannot be used.

    Args:
        field: path of the field, such as ``sensors.gyroscope.values[3]``; ``message`` for the whole.
        found: the value as it was found, shortened.
        expected: what would be understood.
        outcome: the intake outcome it stands for: ``malformed``, or ``unknown`` for what a newer peer may mean.
    """

    kind: ClassVar[str] = "wire"

    def __init__(self, field: str, found: str, expected: str, outcome: ReplyOutcome = ReplyOutcome.MALFORMED) -> None:
        super().__init__(f"{field}: found {found}; expected {expected}")
        self.field = field
        self.found = found
        self.expected = expected
        self.outcome = outcome

    def __reduce__(self) -> tuple[type[WireError], tuple[str, str, str, ReplyOutcome]]:
        """Pickle by the constructor's arguments, so that a worker process can raise it in its parent."""
        return type(self), (self.field, self.found, self.expected, self.outcome)


MAP_DECODER: Final = msgspec.msgpack.Decoder(dict[str, msgspec.Raw])
"""Takes a map apart and leaves its values as bytes."""

DECODE_ERRORS: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""What decoding raises for bytes that are no MessagePack."""

_SCALAR_DECODER: Final = msgspec.msgpack.Decoder()


def peek_scalar(raw: msgspec.Raw) -> object:
    """Return a scalar, or an :class:`OpaqueValue` that names its type; containers are not built."""
    first = bytes(memoryview(raw)[:1])[0]
    if 0x80 <= first <= 0x8F or first in {0xDE, 0xDF}:
        return OpaqueValue("a map")
    if 0x90 <= first <= 0x9F or first in {0xDC, 0xDD}:
        return OpaqueValue("an array")
    if first in {0xC7, 0xC8, 0xC9, 0xD4, 0xD5, 0xD6, 0xD7, 0xD8}:
        return OpaqueValue("an extension type")
    try:
        return _SCALAR_DECODER.decode(raw)
    except DECODE_ERRORS:
        return OpaqueValue("broken bytes")


class OpaqueValue:
    """Stands for a value that is not shown."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __repr__(self) -> str:
        return self._name


def short_repr(value: object) -> str:
    """Return a value for an error message: short, and on one line."""
    if isinstance(value, str | bytes) and len(value) > 40:
        return f"{value[:40]!r}… ({len(value)} long)"
    if isinstance(value, list | dict | tuple):
        return f"{type(value).__name__} of {len(value)}"
    return f"{value!r:.60}"


DecodedT = TypeVar("DecodedT")

_PATH_PATTERN: Final = re.compile(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]")
_EXPECTED_PATTERN: Final = re.compile(r"Expected (.+?)(?:, got (.+))?$")
_MISSING_PATTERN: Final = re.compile(r"Object missing required field `(.+)`$")


def decode_checked(decoder: msgspec.msgpack.Decoder[DecodedT], data: bytes, map_value_type: Any = None) -> DecodedT:
    """Return ``data`` decoded by ``decoder``; its errors become :class:`WireError`.

    Args:
        map_value_type: the type of the values, where a field is a map by name: the path of msgspec does not name which
            it was.

    Raises:
        WireError: naming the field.
    """
    try:
        return decoder.decode(data)
    except msgspec.ValidationError as error:
        raise _to_wire_error(str(error), data, map_value_type) from None
    except UnicodeDecodeError as error:
        raise WireError("message", f"text with {error.object[error.start : error.end]!r}", "UTF-8") from None
    except RecursionError:
        raise WireError("message", "too many levels of nesting", "a map of a few levels") from None
    except msgspec.DecodeError as error:
        raise WireError("message", f"{len(data)} bytes: {error}", "one whole MessagePack map") from None


def _to_wire_error(text: str, data: bytes, map_value_type: Any) -> WireError:
    """Turn msgspec's ``Expected `float`, got `bool` - at `$.sensors[...].values[3][1]` `` into a field and a value."""
    body, _, path = text.partition(" - at ")
    if path.startswith("`key`"):
        return WireError("message", body.partition("got ")[2].replace("`", "") + " as a key", "texts as keys")
    field, value = _resolve_path(data, path.strip("`"), map_value_type)
    missing = _MISSING_PATTERN.match(body)
    if missing:
        return WireError(f"{field}.{missing[1]}" if field else missing[1], "nothing", "the field")
    expected = _EXPECTED_PATTERN.match(body)
    wanted = expected[1].replace("`", "") if expected else body.replace("`", "")
    if body.startswith("Invalid "):
        wanted = "one of the values known here"
    found = short_repr(value)
    if isinstance(value, OpaqueValue) and "of length" in wanted:
        found = f"{value!r} that is longer"
    return WireError(field or "message", found, wanted)


def _resolve_path(data: bytes, path: str, map_value_type: Any) -> tuple[str, object]:
    """Return the readable name of msgspec's path, and the scalar found there."""
    raw = msgspec.Raw(data)
    name = ""
    for field, index in _PATH_PATTERN.findall(path):
        try:
            if field:
                name += f".{field}" if name else field
                raw = MAP_DECODER.decode(raw)[field]
            elif index == "...":
                key, raw = _first_invalid_entry(MAP_DECODER.decode(raw), map_value_type)
                name += f".{key:.40}"
            else:
                name += f"[{index}]"
                raw = msgspec.msgpack.decode(raw, type=list[msgspec.Raw])[int(index)]
        except DECODE_ERRORS:
            # Refused at the first error from the left; what is broken to the right of it comes to light only here.
            return name, OpaqueValue("something in broken bytes")
    return name, peek_scalar(raw)


def _first_invalid_entry(entries: Mapping[str, msgspec.Raw], kind: Any) -> tuple[str, msgspec.Raw]:
    decoder: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(kind)
    for key, raw in entries.items():
        try:
            decoder.decode(raw)
        except DECODE_ERRORS:
            return key, raw
    return "…", next(iter(entries.values()))


def decode_scalar_fields(data: bytes, fields: int = 64) -> dict[str, object]:
    """Return the fields of a message that are numbers, texts, booleans or nil; nothing else is built.

    Raises:
        WireError: for bytes that are no message at all.
    """
    values = ((name, peek_scalar(raw)) for name, raw in split_fields(data, fields).items())
    return {name: value for name, value in values if not isinstance(value, OpaqueValue)}


def split_fields(data: bytes, fields: int) -> dict[str, msgspec.Raw]:
    """Return the fields of a message as bytes.

    Raises:
        WireError: for bytes that are no map, and for one with more than ``fields`` fields or with one of them twice.
    """
    count = _map_length(data)
    if count > fields:
        raise WireError("message", f"{count} fields", f"at most {fields}")
    raw = decode_checked(MAP_DECODER, data)
    if len(raw) != count:
        raise WireError("message", "a field twice", "every field once")
    return raw


def check_version(v: object) -> None:
    """Raise unless a peer's protocol version is understood.

    Raises:
        WireError: with outcome ``unknown`` for a newer version, naming the supported one.
    """
    if type(v) is not int or v < OLDEST_VERSION:
        raise WireError("v", short_repr(v), f"a protocol version from {OLDEST_VERSION} to {VERSION}")
    if v > VERSION:
        expected = f"at most {VERSION}, the protocol version spoken here"
        raise WireError("v", short_repr(v), expected, ReplyOutcome.UNKNOWN)


def _map_length(data: bytes) -> int:
    """Return the length in the head of a MessagePack map, before anything is built."""
    first = data[0] if data else 0
    if 0x80 <= first <= 0x8F:
        return first & 0x0F
    if first in {0xDE, 0xDF}:
        return int.from_bytes(data[1 : 3 if first == 0xDE else 5], "big")
    raise WireError("message", f"{data[:1].hex() or 'no'} as first byte", "a MessagePack map")


_INT64: Final = np.dtype("<i8")
_FLOAT64: Final = np.dtype("<f8")


def encode_array(array: Floats | Ints) -> bytes:
    """Return the elements of a float64 or int64 array in row-major order, little-endian, bit for bit."""
    wanted = _INT64 if array.dtype.kind == "i" else _FLOAT64
    return array.tobytes() if array.dtype is wanted else array.astype(wanted).tobytes()


def decode_times(field: str, value: bytes | list[int]) -> Ints:
    """Return (n,) int64.

    Raises:
        WireError: for ``bin`` that is no whole number of elements.
    """
    if isinstance(value, bytes):
        array: Ints = _decode_bin(field, value, _INT64)
        return array
    return np.array(value, dtype=np.int64)


def decode_floats(field: str, value: bytes | list[float], length: int | None = None) -> Floats:
    """Return (n,) float64, of ``length`` elements unless that is None.

    Raises:
        WireError: for another length, or ``bin`` that is no whole number of elements.
    """
    array: Floats = (
        _decode_bin(field, value, _FLOAT64) if isinstance(value, bytes) else np.array(value, dtype=np.float64)
    )
    if length is not None and len(array) != length:
        raise WireError(field, f"{len(array)} elements", str(length))
    return array


def decode_float_rows(field: str, value: bytes | list[list[float]], n: int, columns: int | None) -> Floats:
    """Return (n, columns) float64; where ``columns`` is None, as many as there are.

    Raises:
        WireError: for another number of rows or columns, naming the first row that is wrong.
    """
    if columns is None:
        columns = _count_columns(field, value, n)
    if isinstance(value, bytes):
        flat: Floats = _decode_bin(field, value, _FLOAT64)
        if len(flat) != n * columns:
            raise WireError(field, f"{len(value)} bytes", f"{n} × {columns} × 8, a row for every time")
        return flat.reshape(n, columns)
    if len(value) != n:
        raise WireError(field, f"{len(value)} rows", f"{n}, one for every time")
    for i, row in enumerate(value):
        if len(row) != columns:
            raise WireError(f"{field}[{i}]", f"{len(row)} columns", str(columns))
    return np.array(value, dtype=np.float64).reshape(n, columns)


def _count_columns(field: str, value: bytes | list[list[float]], n: int) -> int:
    if n == 0:
        return 0
    if not isinstance(value, bytes):
        columns = len(value[0]) if value else 0
    elif len(value) % (8 * n):
        raise WireError(field, f"{len(value)} bytes", f"a multiple of {n} × 8, a row for every time")
    else:
        columns = len(value) // (8 * n)
    if not 1 <= columns <= MAX_COLUMNS:
        raise WireError(field, f"{columns} columns", f"1 to {MAX_COLUMNS}")
    return columns


def _decode_bin(field: str, value: bytes, dtype: np.dtype[Any]) -> Any:
    if len(value) % 8:
        raise WireError(field, f"{len(value)} bytes", "a multiple of 8")
    return np.frombuffer(value, dtype)
