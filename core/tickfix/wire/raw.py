"""Values as bytes: what a peer sent is looked at, and said in an error, before anything of it is built."""

from __future__ import annotations

from typing import Final

import msgspec

FIELDS: Final = msgspec.msgpack.Decoder(dict[str, msgspec.Raw])
"""Takes a map apart and leaves its values as bytes."""

BROKEN: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""What decoding raises for bytes that are no MessagePack."""

_ANY: Final = msgspec.msgpack.Decoder()


def look(raw: msgspec.Raw) -> object:
    """Return a scalar, or an :class:`Unbuilt` that says what else it is; containers are not built."""
    first = bytes(memoryview(raw)[:1])[0]
    if 0x80 <= first <= 0x8F or first in {0xDE, 0xDF}:
        return Unbuilt("a map")
    if 0x90 <= first <= 0x9F or first in {0xDC, 0xDD}:
        return Unbuilt("an array")
    if first in {0xC7, 0xC8, 0xC9, 0xD4, 0xD5, 0xD6, 0xD7, 0xD8}:
        return Unbuilt("an extension type")
    try:
        return _ANY.decode(raw)
    except BROKEN:
        return Unbuilt("broken bytes")


class Unbuilt:
    """Stands for a value that is not shown."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __repr__(self) -> str:
        return self._name


def shown(value: object) -> str:
    """Return a value for an error message: short, and on one line."""
    if isinstance(value, str | bytes) and len(value) > 40:
        return f"{value[:40]!r}… ({len(value)} long)"
    if isinstance(value, list | dict | tuple):
        return f"{type(value).__name__} of {len(value)}"
    return f"{value!r:.60}"
