"""The bytes of a segment: records, the run's manifest, and the MCAP file around them.

    magic · header · manifest (metadata) · channels
    chunk · message indexes          once for every commit
    data end · summary · footer · magic      when the segment is closed

A record becomes one MCAP message on the channel of its kind: ``log_time`` is the wall clock when it was appended,
``publish_time`` its ``t_ns``, ``sequence`` the low 32 bits of its number, and the data the MessagePack array
``[number, device, payload]``, since 32 bits would not last for months.

Why not :class:`mcap.writer.Writer`: a commit must become one chunk with its indexes in one ``write()``, so that a kill
leaves all of it or a recognisable part; a failed write must be undone when the disk is full; and the reader builds the
same bytes again, so that every byte that no checksum covers is compared with its expected value. ``Writer`` writes
chunk
and indexes one by one, keeps counting what could not be written, and keeps its indexes as objects while the file is
open. Records are built with :mod:`mcap.records` and ``RecordBuilder``; only messages and their index are packed here
with
:mod:`struct`: they are written thousands of times a second, and a test holds both to the same bytes."""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from hashlib import sha256
from types import MappingProxyType
from typing import Any, Final

import msgspec
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC


class RecordKind(StrEnum):
    """What a record is; every kind has a channel of its own."""

    EVENT = "event"
    DECISION = "decision"
    ESTIMATE = "estimate"
    REVISION = "revision"
    SNAPSHOT = "snapshot"


CHANNEL_IDS: Final[Mapping[RecordKind, int]] = MappingProxyType(
    {kind: number for number, kind in enumerate(RecordKind, 1)}
)
"""Ids of the channels; they are part of the format."""

KINDS_BY_CHANNEL: Final[Mapping[int, RecordKind]] = MappingProxyType(
    {number: kind for kind, number in CHANNEL_IDS.items()}
)

_MESSAGE_STRUCT: Final = struct.Struct("<BQHIQq")  # opcode, length, channel, sequence, log time, publish time
_MIN_MESSAGE_LENGTH: Final = _MESSAGE_STRUCT.size - 9
_SEQUENCE_MASK: Final = 0xFFFF_FFFF
_record_encoder: Final = msgspec.msgpack.Encoder()
_record_decoder: Final = msgspec.msgpack.Decoder(tuple[int, str, bytes])


@dataclass(frozen=True, slots=True)
class JournalRecord:
    """One thing that a run remembers.

    Attributes:
        number: counts the records of a run from 1, across segments, without gaps.
        device: whom it is about; empty where it is about none.
        t_ns: on the device's clock.
        wall_ns: when it was appended, nanoseconds since 1970 on the wall clock.
        payload: encoded as its kind requires; opaque here.
    """

    kind: RecordKind
    number: int
    device: str
    t_ns: int
    wall_ns: int
    payload: bytes


class RecordFormatError(ValueError):
    """Bytes that no journal writes."""


class RecordBatch:
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

    def add(self, kind: RecordKind, device: str, t_ns: int, wall_ns: int, payload: bytes) -> int:
        """Append a record and return its number.

        Raises:
            ValueError: for a time that 64 bits cannot hold, or a device name that UTF-8 cannot.
        """
        number = self.next
        body = _record_encoder.encode((number, device, payload))
        channel = CHANNEL_IDS[kind]
        length = _MIN_MESSAGE_LENGTH + len(body)
        try:
            head = _MESSAGE_STRUCT.pack(Opcode.MESSAGE, length, channel, number & _SEQUENCE_MASK, wall_ns, t_ns)
        except struct.error as error:
            raise ValueError(f"times: found t_ns = {t_ns}, wall_ns = {wall_ns}; expected what 64 bits hold") from error
        self._parts += (head, body)
        self.index_message(channel, wall_ns)
        self.size += 9 + length
        self.next = number + 1
        return number

    def index_message(self, channel: int, wall_ns: int) -> None:
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


def parse_batch(data: bytes) -> tuple[RecordBatch, tuple[JournalRecord, ...]]:
    """Return the records in a chunk's data, and the group that they were, without its bytes.

    Raises:
        RecordFormatError: when it is anything but messages of known kinds with numbers that follow one another.
    """
    records: list[JournalRecord] = []
    view = memoryview(data)
    batch = RecordBatch(0)
    while batch.size < len(data):
        try:
            opcode, length, channel, sequence, wall_ns, t_ns = _MESSAGE_STRUCT.unpack_from(data, batch.size)
            end = batch.size + 9 + length
            if (
                opcode != Opcode.MESSAGE
                or channel not in KINDS_BY_CHANNEL
                or length < _MIN_MESSAGE_LENGTH
                or end > len(data)
            ):
                raise RecordFormatError(f"opcode {opcode}, channel {channel}, length {length}; expected a message")
            number, device, payload = _record_decoder.decode(view[batch.size + _MESSAGE_STRUCT.size : end])
        except (struct.error, msgspec.MsgspecError, UnicodeDecodeError) as error:
            raise RecordFormatError(str(error)) from error
        if not records:
            batch.first = batch.next = number
        if number != batch.next or sequence != number & _SEQUENCE_MASK:
            raise RecordFormatError(f"record {number} with sequence {sequence}; expected record {batch.next}")
        records.append(JournalRecord(KINDS_BY_CHANNEL[channel], number, device, t_ns, wall_ns, payload))
        batch.index_message(channel, wall_ns)
        batch.size = end
        batch.next = number + 1
    if not records:
        raise RecordFormatError("no messages")
    return batch, tuple(records)


JOURNAL_FORMAT: Final = "1"
"""Version of the journal's format, see docs/journal.md."""

_PLUGIN_PREFIX: Final = "plugin/"
_NOTE_PREFIX: Final = "note/"
_MANIFEST_KEYS: Final = ("format", "run", "tickfix", "config", "seed", "probe", "wall_start_ns", "first_number")


class RunManifestError(ValueError):
    """Entries that are no manifest."""


@dataclass(frozen=True, slots=True)
class RunManifest:
    """What made a run, and with which record a segment begins.

    Attributes:
        run: id of the run.
        tickfix_version: of the package.
        config: the configuration file's text.
        seed: of all random streams.
        probe: the result of :func:`tickfix.kernel.determinism.numeric_probe`.
        wall_start_ns: when the run began, nanoseconds since 1970.
        plugins: versions by distribution.
        notes: what else the run records, such as the site.
        first_number: number of the segment's first record; the writer fills it in.
    """

    run: str
    tickfix_version: str
    config: str
    seed: int
    probe: str
    wall_start_ns: int
    plugins: Mapping[str, str] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)
    first_number: int = 1

    def __post_init__(self) -> None:
        """Freeze the mappings, sorted: equal manifests become equal bytes."""
        for name in ("plugins", "notes"):
            object.__setattr__(self, name, MappingProxyType(dict(sorted(getattr(self, name).items()))))

    def entries(self) -> dict[str, str]:
        """Return it as the entries of an MCAP metadata record, with a checksum, which MCAP does not have there."""
        plain = (JOURNAL_FORMAT, self.run, self.tickfix_version, self.config, str(self.seed), self.probe)
        result = dict(zip(_MANIFEST_KEYS, (*plain, str(self.wall_start_ns), str(self.first_number)), strict=True))
        result |= {_PLUGIN_PREFIX + name: version for name, version in self.plugins.items()}
        result |= {_NOTE_PREFIX + name: text for name, text in self.notes.items()}
        return result | {"sha256": _manifest_checksum(result)}


def parse_run_manifest(entries: Mapping[str, str]) -> RunManifest:
    """Return the manifest that became these entries.

    Raises:
        RunManifestError: when its checksum differs, or another version of the format wrote it.
    """
    rest = dict(entries)
    stored = rest.pop("sha256", "none")
    if stored != _manifest_checksum(rest):
        raise RunManifestError(f"the manifest's checksum is {_manifest_checksum(rest)}, expected {stored}")
    if rest.get("format") != JOURNAL_FORMAT:
        raise RunManifestError(
            f"a journal of format {rest.get('format')}, expected {JOURNAL_FORMAT}: an older tickfix reads it"
        )
    try:
        plain = {name: rest.pop(name) for name in _MANIFEST_KEYS}
        return RunManifest(
            run=plain["run"],
            tickfix_version=plain["tickfix"],
            config=plain["config"],
            seed=int(plain["seed"]),
            probe=plain["probe"],
            wall_start_ns=int(plain["wall_start_ns"]),
            plugins={k.removeprefix(_PLUGIN_PREFIX): v for k, v in rest.items() if k.startswith(_PLUGIN_PREFIX)},
            notes={k.removeprefix(_NOTE_PREFIX): v for k, v in rest.items() if k.startswith(_NOTE_PREFIX)},
            first_number=int(plain["first_number"]),
        )
    except (KeyError, ValueError) as error:
        raise RunManifestError(f"a manifest without a usable {error}") from error


def _manifest_checksum(entries: Mapping[str, str]) -> str:
    digest = sha256()
    for key, value in sorted(entries.items()):
        for text in (key, value):
            raw = text.encode()
            digest.update(len(raw).to_bytes(8, "little") + raw)
    return digest.hexdigest()


MCAP_MAGIC: Final = bytes(MCAP0_MAGIC)
MCAP_PROFILE: Final = "tickfix-journal"
MANIFEST_NAME: Final = "tickfix.manifest"
FRAME_STRUCT: Final = struct.Struct("<BQ")  # opcode, length of what follows
CHUNK_HEADER: Final = struct.Struct("<BQQQQIIQ")  # frame, start, end, size, crc, length of "" (compression), length
DATA_END_SIZE: Final = FRAME_STRUCT.size + 4
FOOTER_SIZE: Final = FRAME_STRUCT.size + 20
_INDEX_HEADER: Final = struct.Struct("<BQHI")


@dataclass(frozen=True, slots=True)
class FramedBatch:
    """A group of records as it stands in the file.

    Attributes:
        data: the chunk and, after ``chunk_size`` bytes, its message indexes.
        index: the chunk's entry in the summary.
    """

    data: bytes
    chunk_size: int
    index: bytes
    batch: RecordBatch


def frame_batch(offset: int, batch: RecordBatch, data: bytes) -> FramedBatch:
    """Return a group, ``data`` being its messages, as the bytes to stand at ``offset``."""
    chunk = Chunk("", data, batch.end_ns, batch.start_ns, zlib.crc32(data), len(data))
    parts = [_record_bytes(chunk)]
    at = offset + len(parts[0])
    places = {}
    for channel, index in batch.indexes.items():
        entries = index.tobytes()
        places[channel] = at
        parts.append(_INDEX_HEADER.pack(Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)) + entries)
        at += len(parts[-1])
    entry = ChunkIndex(
        chunk_length=len(parts[0]),
        chunk_start_offset=offset,
        compression="",
        compressed_size=len(data),
        message_end_time=batch.end_ns,
        message_index_length=at - offset - len(parts[0]),
        message_index_offsets=places,
        message_start_time=batch.start_ns,
        uncompressed_size=len(data),
    )
    return FramedBatch(b"".join(parts), len(parts[0]), _record_bytes(entry), batch)


class SegmentLayout:
    """Lays out a segment piece by piece: the writer to write it, the reader to compare.

    Attributes:
        preamble: the bytes before the first chunk.
        offset: where the next chunk begins.
        start_ns, end_ns: wall clock of the oldest and the newest record.
    """

    def __init__(self, manifest: RunManifest) -> None:
        """Lay out the beginning."""
        header = MCAP_MAGIC + _record_bytes(Header(MCAP_PROFILE, f"tickfix {manifest.tickfix_version}"))
        entries = _record_bytes(Metadata(MANIFEST_NAME, manifest.entries()))
        self._manifest_index = _record_bytes(MetadataIndex(len(header), len(entries), MANIFEST_NAME))
        self.preamble = header + entries + CHANNEL_RECORDS
        self.offset = len(self.preamble)
        self.start_ns = self.end_ns = 0
        self._crc = zlib.crc32(self.preamble)
        self._counts = dict.fromkeys(CHANNEL_IDS.values(), 0)
        self._chunks = 0
        self._chunk_indexes = bytearray()

    def count(self, framed: FramedBatch) -> None:
        """Count a group that is in the file."""
        batch = framed.batch
        self.start_ns = batch.start_ns if self._chunks == 0 else min(self.start_ns, batch.start_ns)
        self.end_ns = max(self.end_ns, batch.end_ns)
        for channel, index in batch.indexes.items():
            self._counts[channel] += len(index) // 2
        self._chunks += 1
        self._chunk_indexes += framed.index
        self._crc = zlib.crc32(framed.data, self._crc)
        self.offset += len(framed.data)

    def closing_section(self) -> bytes:
        """Return what closes the segment."""
        data_end = _record_bytes(DataEnd(self._crc))
        begin = self.offset + len(data_end)
        counts = {channel: count for channel, count in self._counts.items() if count}
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(CHANNEL_IDS),
            channel_message_counts=counts,
            chunk_count=self._chunks,
            message_count=sum(counts.values()),
            message_end_time=self.end_ns,
            message_start_time=self.start_ns,
            metadata_count=1,
            schema_count=0,
        )
        groups = (
            (Opcode.CHANNEL, CHANNEL_RECORDS),
            (Opcode.STATISTICS, _record_bytes(statistics)),
            (Opcode.CHUNK_INDEX, bytes(self._chunk_indexes)),
            (Opcode.METADATA_INDEX, self._manifest_index),
        )
        offsets = []
        at = begin
        for opcode, raw in groups:
            if raw:
                offsets.append(SummaryOffset(opcode, at, len(raw)))
            at += len(raw)
        summary = b"".join(raw for _, raw in groups) + _record_bytes(*offsets)
        footer = FRAME_STRUCT.pack(Opcode.FOOTER, 20) + struct.pack("<QQ", begin, at)
        crc = zlib.crc32(footer, zlib.crc32(summary))
        return data_end + summary + _record_bytes(Footer(begin, at, crc)) + MCAP_MAGIC


def _record_bytes(*records: McapRecord) -> bytes:
    builder: Any = RecordBuilder()  # Any: mcap leaves its methods without types
    for record in records:
        record.write(builder)
    return bytes(builder.end())


CHANNEL_RECORDS: Final = _record_bytes(
    *(Channel(number, kind.value, "msgpack", {}, 0) for kind, number in CHANNEL_IDS.items())
)
"""The end of every segment's beginning."""
