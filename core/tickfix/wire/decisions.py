"""What a driver decided and no event shows: in the journal before what it led to is said, and on the follow port.

Events and decisions in their order are all that a kernel was ever asked, so whoever applies them gets the same bytes.
"""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import msgspec

from tickfix.wire.refusals import decode_as


class Fold(msgspec.Struct, tag_field="type", tag="fold", kw_only=True, frozen=True):
    """A scan that was located beside the loop enters its timeline now; ``number`` is the record that holds it."""

    number: int


class Drop(msgspec.Struct, tag_field="type", tag="drop", kw_only=True, frozen=True):
    """A scan was not located in time and never enters its timeline."""

    number: int
    reason: str


class Run(msgspec.Struct, tag_field="type", tag="run", kw_only=True, frozen=True):
    """What is due for a device is folded; ``tick`` closes the ticks up to it though the data has not passed them.

    At most ``most`` ticks are closed, where it is told.
    """

    device: str
    tick: int | None = None
    most: int | None = None


class Finish(msgspec.Struct, tag_field="type", tag="finish", kw_only=True, frozen=True):
    """Nothing more is expected of a device: it said so, or was silent for too long."""

    device: str
    reason: str


class Primary(msgspec.Struct, tag_field="type", tag="primary", kw_only=True, frozen=True):
    """From now on this pipeline's estimates are the ones that are published."""

    pipeline: str


Decision: TypeAlias = Fold | Drop | Run | Finish | Primary

_ENCODER: Final = msgspec.msgpack.Encoder()
_DECODER: Final[msgspec.msgpack.Decoder[Any]] = msgspec.msgpack.Decoder(Decision)


def encode_decision(decision: Decision) -> bytes:
    """Return the bytes of a decision."""
    return _ENCODER.encode(decision)


def decode_decision(data: bytes) -> Decision:
    """Return the decision whose bytes these are.

    Raises:
        tickfix.wire.WireError: when they are none.
    """
    decision: Decision = decode_as(_DECODER, data)
    return decision
