"""Texts of a message: neither too long nor able to pretend to be anything where they are shown."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import Final, get_args

import msgspec

from tickfix.wire import messages
from tickfix.wire.errors import WireError
from tickfix.wire.messages import Message
from tickfix.wire.raw import shown

_TEXTS: Final[Mapping[type[Message], Callable[[Message], tuple[str, ...]]]] = {
    kind: attrgetter(*(field.name for field in msgspec.structs.fields(kind) if field.type is str))
    for kind in get_args(Message)
}
_CONTROL: Final = re.compile(r"[\x00-\x1f\x7f-\x9f]")


def check_texts(message: Message, most: int) -> None:
    """Refuse a text of more than ``most`` characters, or with a control character in it.

    Raises:
        WireError: naming the field.
    """
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
