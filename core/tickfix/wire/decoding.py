"""Bytes to messages: checked before anything is built, and every refusal names field, value and what is expected."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import Any, Final, TypeVar

import msgspec

from tickfix.kernel import Outcome
from tickfix.wire import messages
from tickfix.wire.errors import WireError
from tickfix.wire.limits import MessageLimits
from tickfix.wire.messages import OLDEST_VERSION, VERSION, Message

T = TypeVar("T")

_FIELDS: Final = msgspec.msgpack.Decoder(dict[str, msgspec.Raw])
_ANY: Final = msgspec.msgpack.Decoder()
_TYPES: Final[Mapping[str, type[Message]]] = {
    "hello": messages.Hello,
    "motion": messages.Motion,
    "scan": messages.Scan,
    "pressure": messages.Pressure,
    "fix": messages.Fix,
    "truth": messages.Truth,
    "bye": messages.Bye,
}
_DECODERS: Final = {name: msgspec.msgpack.Decoder(kind) for name, kind in _TYPES.items()}
_KINDS: Final = {msgspec.msgpack.encode(name): name for name in _TYPES}
_VERSIONS: Final = frozenset(map(msgspec.msgpack.encode, range(OLDEST_VERSION, VERSION + 1)))
"""Types and versions as most peers write them."""

_KNOWN: Final = {name: {"type", *kind.__struct_fields__} for name, kind in _TYPES.items()}
_TEXTS: Final[Mapping[type[Message], Callable[[Message], tuple[str, ...]]]] = {
    kind: attrgetter(*(field.name for field in msgspec.structs.fields(kind) if field.type is str))
    for kind in _TYPES.values()
}
_MAPPED: Final[Mapping[str, Any]] = {"motion": messages.SensorBatch, "hello": float}
_CONTROL: Final = re.compile(r"[\x00-\x1f\x7f-\x9f]")
_PATH: Final = re.compile(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]")
_EXPECTED: Final = re.compile(r"Expected (.+?)(?:, got (.+))?$")
_BROKEN: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
_MISSING: Final = re.compile(r"Object missing required field `(.+)`$")


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
    _check_texts(message, limits.text_chars)
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
    return _decode(_DECODERS[kind], data, _MAPPED.get(kind))


def unknown_fields(data: bytes) -> tuple[str, ...]:
    """Return the names of a message's fields that this version does not know, to be counted.

    ``data`` must be a message that :func:`decode_message` took.
    """
    raw = _FIELDS.decode(data)
    kind = raw["type"]
    known = _KNOWN[_KINDS.get(bytes(kind)) or _ANY.decode(kind)]
    return () if raw.keys() <= known else tuple(name for name in raw if name not in known)


def decode_as(decoder: msgspec.msgpack.Decoder[T], data: bytes) -> T:
    """Return what ``decoder`` makes of ``data``; its refusals become :class:`WireError`.

    Raises:
        WireError: naming the field.
    """
    return _decode(decoder, data, None)


def _head(data: bytes, fields: int) -> str:
    raw = _raw_fields(data, fields)
    if "v" in raw and "type" in raw and bytes(raw["v"]) in _VERSIONS and (usual := _KINDS.get(bytes(raw["type"]))):
        return usual
    check_version(_scalar(raw, "v"))
    kind = _scalar(raw, "type")
    if not isinstance(kind, str):
        raise WireError("type", shown(kind), "a name")
    if kind not in _DECODERS:
        raise WireError("type", shown(kind), " | ".join(_DECODERS), Outcome.UNKNOWN)
    return kind


def _raw_fields(data: bytes, fields: int) -> dict[str, msgspec.Raw]:
    count = _map_length(data)
    if count > fields:
        raise WireError("message", f"{count} fields", f"at most {fields}")
    raw = _decode(_FIELDS, data, None)
    if len(raw) != count:
        raise WireError("message", "a field twice", "every field once")
    return raw


def decode_head(data: bytes, fields: int = 64) -> dict[str, object]:
    """Return the fields of a message that are numbers, texts, booleans or nil; nothing else is built.

    Raises:
        WireError: for bytes that are no message at all.
    """
    values = ((name, _look(raw)) for name, raw in _raw_fields(data, fields).items())
    return {name: value for name, value in values if not isinstance(value, _Kind)}


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


def shown(value: object) -> str:
    """Return a value for an error message: short, and on one line."""
    if isinstance(value, str | bytes) and len(value) > 40:
        return f"{value[:40]!r}… ({len(value)} long)"
    if isinstance(value, list | dict | tuple):
        return f"{type(value).__name__} of {len(value)}"
    return f"{value!r:.60}"


def _map_length(data: bytes) -> int:
    """Return what the head of a MessagePack map says about its length, before anything is built."""
    first = data[0] if data else 0
    if 0x80 <= first <= 0x8F:
        return first & 0x0F
    if first in {0xDE, 0xDF}:
        return int.from_bytes(data[1 : 3 if first == 0xDE else 5], "big")
    raise WireError("message", f"{data[:1].hex() or 'no'} as first byte", "a MessagePack map")


def _scalar(raw: Mapping[str, msgspec.Raw], field: str) -> object:
    if field not in raw:
        raise WireError(field, "nothing", "the field")
    return _look(raw[field])


def _look(raw: msgspec.Raw) -> object:
    """Return a scalar, or say what else it is; containers are not built."""
    first = bytes(memoryview(raw)[:1])[0]
    if 0x80 <= first <= 0x8F or first in {0xDE, 0xDF}:
        return _Kind("a map")
    if 0x90 <= first <= 0x9F or first in {0xDC, 0xDD}:
        return _Kind("an array")
    if first in {0xC7, 0xC8, 0xC9, 0xD4, 0xD5, 0xD6, 0xD7, 0xD8}:
        return _Kind("an extension type")
    try:
        return _ANY.decode(raw)
    except _BROKEN:
        return _Kind("broken bytes")


class _Kind:
    """Stands for a value that is not shown."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __repr__(self) -> str:
        return self._name


def _decode(decoder: msgspec.msgpack.Decoder[T], data: bytes, mapped: Any) -> T:
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
    if isinstance(value, _Kind) and "of length" in wanted:
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
                raw = _FIELDS.decode(raw)[field]
            elif index == "...":
                key, raw = _first_refused(_FIELDS.decode(raw), mapped)
                name += f".{key:.40}"
            else:
                name += f"[{index}]"
                raw = msgspec.msgpack.decode(raw, type=list[msgspec.Raw])[int(index)]
        except _BROKEN:
            # Refused at the first error from the left; what is broken to the right of it comes to light only here.
            return name, _Kind("something in broken bytes")
    return name, _look(raw)


def _first_refused(entries: Mapping[str, msgspec.Raw], kind: Any) -> tuple[str, msgspec.Raw]:
    decoder: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(kind)
    for key, raw in entries.items():
        try:
            decoder.decode(raw)
        except _BROKEN:
            return key, raw
    return "…", next(iter(entries.values()))


def _check_texts(message: Message, most: int) -> None:
    text = "".join(_TEXTS[type(message)](message))
    if isinstance(message, messages.Motion | messages.Hello):
        text += "".join(message.sensors)
    longest = max(map(len, message.transmitters), default=0) if isinstance(message, messages.Scan) else 0
    # No control character is printable, and if all together are not too long, none is.
    if not text.isprintable() or len(text) > most or longest > most:
        _refuse_texts(message, most)


def _refuse_texts(message: Message, most: int) -> None:
    """Raise for the first text that cannot be; there may be none."""
    texts: list[tuple[str, str]] = [
        (name, value) for name in message.__struct_fields__ if isinstance(value := getattr(message, name), str)
    ]
    if isinstance(message, messages.Motion | messages.Hello):
        texts.extend(("sensors", name) for name in message.sensors)
    for name, text in texts:
        # They are shown on terminals and written to logs, where a control character could pretend to be anything.
        if _CONTROL.search(text):
            raise WireError(name, shown(text), "text without control characters")
    if isinstance(message, messages.Scan):
        texts.extend((f"transmitters[{i}]", text) for i, text in enumerate(message.transmitters))
    for name, text in texts:
        if len(text) > most:
            raise WireError(name, f"{len(text)} characters", f"at most {most}")
