"""How much one message may hold."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

CEILING: Final = 65_536
"""No list of a message may be longer, whatever the limits say: arrays this long are refused before they are built."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageLimits:
    """What a message may hold at most; told to a device in its ``welcome``.

    Attributes:
        message_bytes: length of the message.
        samples: samples of one sensor in one message.
        readings: readings of one scan.
        text_chars: characters of a name or any other text.
        fields: fields of the message, unknown ones included.
    """

    message_bytes: int = 262_144
    samples: int = 4_096
    readings: int = 1_024
    text_chars: int = 256
    fields: int = 64

    def __post_init__(self) -> None:
        """Check the limits themselves.

        Raises:
            ValueError: for a limit below 1, or a number of elements above :data:`CEILING`.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            most = 2**31 if field.name == "message_bytes" else CEILING
            if not 1 <= value <= most:
                raise ValueError(f"{field.name}: found {value}; expected 1 to {most}")
