"""What a crew and its workers write to each other, as MessagePack. Both ends are the same program."""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import msgspec

from tickfix.drivers.live.folding import Done, Feed, Step
from tickfix.drivers.live.locating import Located
from tickfix.kernel import Standing
from tickfix.wire import encode_event
from tickfix.wire.decisions import encode_decision


class Enter(msgspec.Struct, frozen=True, array_like=True, tag=0):
    """An event enters, as canonical bytes."""

    number: int
    body: bytes


class Decide(msgspec.Struct, frozen=True, array_like=True, tag=1):
    """A decision, as its bytes."""

    body: bytes


class Forget(msgspec.Struct, frozen=True, array_like=True, tag=2):
    """A device that was finished is remembered no more; nothing comes of it."""

    device: str


Entry: TypeAlias = Enter | Decide | Forget


class Apply(msgspec.Struct, frozen=True, array_like=True, tag=0):
    """Do this in its order; the answer is a list of what came of each, but for what is forgotten."""

    entries: list[Entry]


class Locate(msgspec.Struct, frozen=True, array_like=True, tag=1):
    """Locate the scan that waits under this number, beside the work; a notice tells when it is done."""

    number: int


class Count(msgspec.Struct, frozen=True, array_like=True, tag=2):
    """The answer is a :class:`Tally`."""


class Save(msgspec.Struct, frozen=True, array_like=True, tag=3):
    """The answer is a :class:`Saved`."""


class Load(msgspec.Struct, frozen=True, array_like=True, tag=4):
    """Become what this snapshot says; the answer is a :class:`Loaded`."""

    snapshot: bytes


class Leave(msgspec.Struct, frozen=True, array_like=True, tag=5):
    """Nothing more will be asked: end."""


Request: TypeAlias = Apply | Locate | Count | Save | Load | Leave


class Tally(msgspec.Struct, frozen=True, array_like=True):
    """The counters of a worker."""

    measurements: dict[str, int]
    missing: int
    failures: dict[str, int]


class Saved(msgspec.Struct, frozen=True, array_like=True):
    """A worker's devices, each by name with its packed snapshot, and its kernel's snapshot without them.

    Or else why there is none.
    """

    devices: list[tuple[str, bytes]]
    rest: bytes
    refused: str = ""


class Loaded(msgspec.Struct, frozen=True, array_like=True):
    """How far each device has come; or why the snapshot cannot be used."""

    standings: dict[str, Standing]
    refused: str = ""


def entry_of(step: Step) -> Entry:
    """Return what a worker is sent of a step."""
    if isinstance(step, Feed):
        return Enter(step.number, encode_event(step.event) if step.body is None else step.body)
    return Decide(encode_decision(step))


_ENCODER: Final = msgspec.msgpack.Encoder()
REQUESTS: Final[msgspec.msgpack.Decoder[Request]] = msgspec.msgpack.Decoder(Request)
DONE: Final = msgspec.msgpack.Decoder(list[Done])
TALLIES: Final = msgspec.msgpack.Decoder(Tally)
SAVED: Final = msgspec.msgpack.Decoder(Saved)
LOADED: Final = msgspec.msgpack.Decoder(Loaded)
NOTICES: Final = msgspec.msgpack.Decoder(list[Located])


def encode(message: Any) -> bytes:
    """Return the bytes of a message, or of a list of them."""
    return _ENCODER.encode(message)
