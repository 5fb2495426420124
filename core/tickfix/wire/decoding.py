"""Bytes to messages: checked before anything is built, and every refusal names field, value and what is expected."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, get_args

import msgspec

from tickfix.kernel import Outcome
from tickfix.wire import messages
from tickfix.wire.errors import WireError
from tickfix.wire.heads import check_version, raw_fields
from tickfix.wire.limits import MessageLimits
from tickfix.wire.messages import OLDEST_VERSION, VERSION, Message
from tickfix.wire.raw import FIELDS, look, shown
from tickfix.wire.refusals import decode_as
from tickfix.wire.texts import check_texts

_TYPES: Final[Mapping[str, type[Message]]] = {str(kind.__struct_config__.tag): kind for kind in get_args(Message)}
_DECODERS: Final = {name: msgspec.msgpack.Decoder(kind) for name, kind in _TYPES.items()}
_KINDS: Final = {msgspec.msgpack.encode(name): name for name in _TYPES}
_VERSIONS: Final = frozenset(map(msgspec.msgpack.encode, range(OLDEST_VERSION, VERSION + 1)))
"""Types and versions as most peers write them."""

_KNOWN: Final = {name: {"type", *kind.__struct_fields__} for name, kind in _TYPES.items()}
_MAPPED: Final[Mapping[str, Any]] = {"motion": messages.SensorBatch, "hello": float}


def decode_message(data: bytes, limits: MessageLimits) -> Message:
    """Return the message that a device sent.

    Times and values stay as they came; :func:`tickfix.wire.events.to_event` checks them against each other.

    Raises:
        WireError: for whatever cannot be used, with outcome ``unknown`` for a type or version that a newer peer may
            speak, ``malformed`` otherwise.
    """
    if len(data) > limits.message_bytes:
        raise WireError("message", f"{len(data)} bytes", f"at most {limits.message_bytes}")
    message = read_message(data, limits.fields)
    check_texts(message, limits.text_chars)
    if not message.device:
        raise WireError("device", "''", "the device's name")
    match message:
        case messages.Motion():
            for name, batch in message.sensors.items():
                n = len(batch.t_ns) // 8 if isinstance(batch.t_ns, bytes) else len(batch.t_ns)
                if n > limits.samples:
                    raise WireError(f"sensors.{name}.t_ns", f"{n} samples", f"at most {limits.samples}")
        case messages.Scan() if len(message.transmitters) > limits.readings:
            raise WireError("transmitters", f"{len(message.transmitters)} readings", f"at most {limits.readings}")
    return message


def read_message(data: bytes, fields: int = 64) -> Message:
    """Return the message of these bytes, whatever its length, with at most ``fields`` fields.

    Raises:
        WireError: see :func:`decode_message`.
    """
    kind = _head(data, fields)
    return decode_as(_DECODERS[kind], data, _MAPPED.get(kind))


def unknown_fields(data: bytes) -> tuple[str, ...]:
    """Return the names of a message's fields that this version does not know, to be counted.

    ``data`` must be a message that :func:`decode_message` took.
    """
    raw = FIELDS.decode(data)
    kind = raw["type"]
    known = _KNOWN[_KINDS.get(bytes(kind)) or str(look(kind))]
    return () if raw.keys() <= known else tuple(name for name in raw if name not in known)


def _head(data: bytes, fields: int) -> str:
    raw = raw_fields(data, fields)
    if "v" in raw and "type" in raw and bytes(raw["v"]) in _VERSIONS and (usual := _KINDS.get(bytes(raw["type"]))):
        return usual
    check_version(_scalar(raw, "v"))
    kind = _scalar(raw, "type")
    if not isinstance(kind, str):
        raise WireError("type", shown(kind), "a name")
    if kind not in _DECODERS:
        raise WireError("type", shown(kind), " | ".join(_DECODERS), Outcome.UNKNOWN)
    return kind


def _scalar(raw: Mapping[str, msgspec.Raw], field: str) -> object:
    if field not in raw:
        raise WireError(field, "nothing", "the field")
    return look(raw[field])
