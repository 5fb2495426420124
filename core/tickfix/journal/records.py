"""Records, and the bytes of those that are committed together.

A record becomes one MCAP message on the channel of its kind: ``log_time`` is the wall clock when it was appended,
``publish_time`` its ``t_ns``, ``sequence`` the low 32 bits of its number, and the data the MessagePack array
``[number, device, payload]``, since 32 bits would not last for months.

Messages and their index are the only parts that are packed here with :mod:`struct` and not by the classes of
:mod:`mcap.records`: they are written thousands of times a second, and a test holds both to the same bytes.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Final

import msgspec
from mcap.opcode import Opcode


class Kind(StrEnum):
    """What a record is; every kind has a channel of its own."""

    EVENT = "event"
    DECISION = "decision"
    ESTIMATE = "estimate"
    REVISION = "revision"
    SNAPSHOT = "snapshot"


CHANNELS: Final[Mapping[Kind, int]] = MappingProxyType({kind: number for number, kind in enumerate(Kind, 1)})
"""Ids of the channels; they are part of the format."""

KINDS: Final[Mapping[int, Kind]] = MappingProxyType({number: kind for kind, number in CHANNELS.items()})

_MESSAGE: Final = struct.Struct("<BQHIQq")  # opcode, length, channel, sequence, log time, publish time
_AFTER_LENGTH: Final = _MESSAGE.size - 9
_LOW: Final = 0xFFFF_FFFF
_encoder: Final = msgspec.msgpack.Encoder()
_decoder: Final = msgspec.msgpack.Decoder(tuple[int, str, bytes])


@dataclass(frozen=True, slots=True)
class Record:
    """One thing that a run remembers.

    Attributes:
        number: counts the records of a run from 1, across segments, without gaps.
        device: whom it is about; empty where it is about none.
        t_ns: on the device's clock.
        wall_ns: when it was appended, nanoseconds since 1970 on the wall clock.
        payload: what the kind says; opaque here.
    """

    kind: Kind
    number: int
    device: str
    t_ns: int
    wall_ns: int
    payload: bytes


class RecordsError(ValueError):
    """Bytes that no journal writes."""


class Group:
    """Records that are committed together, kept as the messages they become.

    Args:
        first: number of the first one.
    """

    __slots__ = ("_parts", "end_ns", "first", "indexes", "next", "size", "start_ns")

    def __init__(self, first: int) -> None:
        """Begin without records."""
        self.first = self.next = first
        self.size = 0
        self.indexes: dict[int, array[int]] = {}
        """By channel: log time and offset of every message, flat."""
        self.start_ns = 2**64 - 1
        self.end_ns = 0
        self._parts: list[bytes] = []

    def __len__(self) -> int:
        """Return the number of records."""
        return self.next - self.first

    def add(self, kind: Kind, device: str, t_ns: int, wall_ns: int, payload: bytes) -> int:
        """Append a record and return its number.

        Raises:
            ValueError: for a time that 64 bits cannot hold, or a device name that UTF-8 cannot.
        """
        number = self.next
        body = _encoder.encode((number, device, payload))
        channel = CHANNELS[kind]
        length = _AFTER_LENGTH + len(body)
        try:
            head = _MESSAGE.pack(Opcode.MESSAGE, length, channel, number & _LOW, wall_ns, t_ns)
        except struct.error as error:
            raise ValueError(f"times: found t_ns = {t_ns}, wall_ns = {wall_ns}; expected what 64 bits hold") from error
        self._parts += (head, body)
        self.note(channel, wall_ns)
        self.size += 9 + length
        self.next = number + 1
        return number

    def note(self, channel: int, wall_ns: int) -> None:
        """Index a message that begins at the present size."""
        index = self.indexes.get(channel)
        if index is None:
            index = self.indexes[channel] = array("Q")
        index.append(wall_ns)
        index.append(self.size)
        self.start_ns = min(self.start_ns, wall_ns)
        self.end_ns = max(self.end_ns, wall_ns)

    def data(self) -> bytes:
        """Return the messages one after the other."""
        return b"".join(self._parts)


def parse(data: bytes) -> tuple[Group, tuple[Record, ...]]:
    """Return the records in a chunk's data, and the group that they were, without its bytes.

    Raises:
        RecordsError: when it is anything but messages of known kinds with numbers that follow one another.
    """
    records: list[Record] = []
    view = memoryview(data)
    group = Group(0)
    while group.size < len(data):
        try:
            opcode, length, channel, sequence, wall_ns, t_ns = _MESSAGE.unpack_from(data, group.size)
            end = group.size + 9 + length
            if opcode != Opcode.MESSAGE or channel not in KINDS or length < _AFTER_LENGTH or end > len(data):
                raise RecordsError(f"opcode {opcode}, channel {channel}, length {length}; expected a message")
            number, device, payload = _decoder.decode(view[group.size + _MESSAGE.size : end])
        except (struct.error, msgspec.MsgspecError, UnicodeDecodeError) as error:
            raise RecordsError(str(error)) from error
        if not records:
            group.first = group.next = number
        if number != group.next or sequence != number & _LOW:
            raise RecordsError(f"record {number} with sequence {sequence}; expected record {group.next}")
        records.append(Record(KINDS[channel], number, device, t_ns, wall_ns, payload))
        group.note(channel, wall_ns)
        group.size = end
        group.next = number + 1
    if not records:
        raise RecordsError("no messages")
    return group, tuple(records)
