"""What msgspec refuses, said as the field, the value found there and what is expected."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final, TypeVar

import msgspec

from tickfix.wire.errors import WireError
from tickfix.wire.raw import BROKEN, FIELDS, Unbuilt, look, shown

T = TypeVar("T")

_PATH: Final = re.compile(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]")
_EXPECTED: Final = re.compile(r"Expected (.+?)(?:, got (.+))?$")
_MISSING: Final = re.compile(r"Object missing required field `(.+)`$")


def decode_as(decoder: msgspec.msgpack.Decoder[T], data: bytes, mapped: Any = None) -> T:
    """Return what ``decoder`` makes of ``data``; its refusals become :class:`WireError`.

    Args:
        mapped: the type of the values, where a field is a map by name: the path of msgspec does not say which it was.

    Raises:
        WireError: naming the field.
    """
    try:
        return decoder.decode(data)
    except msgspec.ValidationError as error:
        raise _named(str(error), data, mapped) from None
    except UnicodeDecodeError as error:
        raise WireError("message", f"text with {error.object[error.start : error.end]!r}", "UTF-8") from None
    except RecursionError:
        raise WireError("message", "too many levels of nesting", "a map of a few levels") from None
    except msgspec.DecodeError as error:
        raise WireError("message", f"{len(data)} bytes: {error}", "one whole MessagePack map") from None


def _named(text: str, data: bytes, mapped: Any) -> WireError:
    """Turn msgspec's ``Expected `float`, got `bool` - at `$.sensors[...].values[3][1]` `` into a field and a value."""
    body, _, path = text.partition(" - at ")
    if path.startswith("`key`"):
        return WireError("message", body.partition("got ")[2].replace("`", "") + " as a key", "texts as keys")
    field, value = _walk(data, path.strip("`"), mapped)
    missing = _MISSING.match(body)
    if missing:
        return WireError(f"{field}.{missing[1]}" if field else missing[1], "nothing", "the field")
    expected = _EXPECTED.match(body)
    wanted = expected[1].replace("`", "") if expected else body.replace("`", "")
    if body.startswith("Invalid "):
        wanted = "one of the values known here"
    found = shown(value)
    if isinstance(value, Unbuilt) and "of length" in wanted:
        found = f"{value!r} that is longer"
    return WireError(field or "message", found, wanted)


def _walk(data: bytes, path: str, mapped: Any) -> tuple[str, object]:
    """Return the readable name of msgspec's path, and the scalar found there."""
    raw = msgspec.Raw(data)
    name = ""
    for field, index in _PATH.findall(path):
        try:
            if field:
                name += f".{field}" if name else field
                raw = FIELDS.decode(raw)[field]
            elif index == "...":
                key, raw = _first_refused(FIELDS.decode(raw), mapped)
                name += f".{key:.40}"
            else:
                name += f"[{index}]"
                raw = msgspec.msgpack.decode(raw, type=list[msgspec.Raw])[int(index)]
        except BROKEN:
            # Refused at the first error from the left; what is broken to the right of it comes to light only here.
            return name, Unbuilt("something in broken bytes")
    return name, look(raw)


def _first_refused(entries: Mapping[str, msgspec.Raw], kind: Any) -> tuple[str, msgspec.Raw]:
    decoder: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(kind)
    for key, raw in entries.items():
        try:
            decoder.decode(raw)
        except BROKEN:
            return key, raw
    return "…", next(iter(entries.values()))
