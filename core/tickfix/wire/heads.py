"""The head of a message: how many fields it has, which version it speaks, and its scalars."""

from __future__ import annotations

import msgspec

from tickfix.kernel import Outcome
from tickfix.wire.errors import WireError
from tickfix.wire.messages import OLDEST_VERSION, VERSION
from tickfix.wire.raw import FIELDS, Unbuilt, look, shown
from tickfix.wire.refusals import decode_as


def decode_head(data: bytes, fields: int = 64) -> dict[str, object]:
    """Return the fields of a message that are numbers, texts, booleans or nil; nothing else is built.

    Raises:
        WireError: for bytes that are no message at all.
    """
    values = ((name, look(raw)) for name, raw in raw_fields(data, fields).items())
    return {name: value for name, value in values if not isinstance(value, Unbuilt)}


def raw_fields(data: bytes, fields: int) -> dict[str, msgspec.Raw]:
    """Return the fields of a message as bytes.

    Raises:
        WireError: for bytes that are no map, and for one with more than ``fields`` fields or with one of them twice.
    """
    count = _map_length(data)
    if count > fields:
        raise WireError("message", f"{count} fields", f"at most {fields}")
    raw = decode_as(FIELDS, data)
    if len(raw) != count:
        raise WireError("message", "a field twice", "every field once")
    return raw


def check_version(v: object) -> None:
    """Raise unless a peer's protocol version is understood.

    Raises:
        WireError: with outcome ``unknown`` for a newer version, saying which is spoken here.
    """
    if type(v) is not int or v < OLDEST_VERSION:
        raise WireError("v", shown(v), f"a protocol version from {OLDEST_VERSION} to {VERSION}")
    if v > VERSION:
        expected = f"at most {VERSION}, the protocol version spoken here"
        raise WireError("v", shown(v), expected, Outcome.UNKNOWN)


def _map_length(data: bytes) -> int:
    """Return what the head of a MessagePack map says about its length, before anything is built."""
    first = data[0] if data else 0
    if 0x80 <= first <= 0x8F:
        return first & 0x0F
    if first in {0xDE, 0xDF}:
        return int.from_bytes(data[1 : 3 if first == 0xDE else 5], "big")
    raise WireError("message", f"{data[:1].hex() or 'no'} as first byte", "a MessagePack map")
