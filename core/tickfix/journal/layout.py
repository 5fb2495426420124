"""The bytes of a segment, from the first magic to the last.

    magic · header · manifest (metadata) · channels
    chunk · message indexes          once for every commit
    data end · summary · footer · magic      when the segment is closed

Why not :class:`mcap.writer.Writer`: a commit must become one chunk with its indexes in one ``write()``, so that a kill
leaves all of it or a recognisable half; it must be possible to take a failed one back when the disk is full; and the
reader wants to build the same bytes again, so that every byte of a segment that no checksum covers is compared with
what it has to be. ``Writer`` writes chunk and indexes one by one, keeps counting what could not be written, and its
indexes as objects for as long as the file is open. Records are built with its parts: :mod:`mcap.records` and
``RecordBuilder``.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import Any, Final

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

from tickfix.journal.manifest import Manifest
from tickfix.journal.records import CHANNELS, Group

MAGIC: Final = bytes(MCAP0_MAGIC)
PROFILE: Final = "tickfix-journal"
MANIFEST: Final = "tickfix.manifest"
FRAME: Final = struct.Struct("<BQ")  # opcode, length of what follows
CHUNK_HEAD: Final = struct.Struct("<BQQQQIIQ")  # frame, start, end, size, crc, length of "" (compression), length
DATA_END_SIZE: Final = FRAME.size + 4
FOOTER_SIZE: Final = FRAME.size + 20
_INDEX_HEAD: Final = struct.Struct("<BQHI")


@dataclass(frozen=True, slots=True)
class Framed:
    """A group of records as it stands in the file.

    Attributes:
        data: the chunk and, after ``chunk_size`` bytes, its message indexes.
        index: the chunk's entry in the summary.
    """

    data: bytes
    chunk_size: int
    index: bytes
    group: Group


def frame_group(offset: int, group: Group, data: bytes) -> Framed:
    """Return a group, ``data`` being its messages, as the bytes to stand at ``offset``."""
    chunk = Chunk("", data, group.end_ns, group.start_ns, zlib.crc32(data), len(data))
    parts = [_build(chunk)]
    at = offset + len(parts[0])
    places = {}
    for channel, index in group.indexes.items():
        entries = index.tobytes()
        places[channel] = at
        parts.append(_INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)) + entries)
        at += len(parts[-1])
    entry = ChunkIndex(
        chunk_length=len(parts[0]),
        chunk_start_offset=offset,
        compression="",
        compressed_size=len(data),
        message_end_time=group.end_ns,
        message_index_length=at - offset - len(parts[0]),
        message_index_offsets=places,
        message_start_time=group.start_ns,
        uncompressed_size=len(data),
    )
    return Framed(b"".join(parts), len(parts[0]), _build(entry), group)


class Layout:
    """Lays out a segment piece by piece: the writer to write it, the reader to compare.

    Attributes:
        beginning: the bytes before the first chunk.
        offset: where the next chunk begins.
        start_ns, end_ns: wall clock of the oldest and the newest record.
    """

    def __init__(self, manifest: Manifest) -> None:
        """Lay out the beginning."""
        header = MAGIC + _build(Header(PROFILE, f"tickfix {manifest.tickfix_version}"))
        entries = _build(Metadata(MANIFEST, manifest.entries()))
        self._manifest_index = _build(MetadataIndex(len(header), len(entries), MANIFEST))
        self.beginning = header + entries + CHANNEL_RECORDS
        self.offset = len(self.beginning)
        self.start_ns = self.end_ns = 0
        self._crc = zlib.crc32(self.beginning)
        self._counts = dict.fromkeys(CHANNELS.values(), 0)
        self._chunks = 0
        self._chunk_indexes = bytearray()

    def count(self, framed: Framed) -> None:
        """Count a group that is in the file."""
        group = framed.group
        self.start_ns = group.start_ns if self._chunks == 0 else min(self.start_ns, group.start_ns)
        self.end_ns = max(self.end_ns, group.end_ns)
        for channel, index in group.indexes.items():
            self._counts[channel] += len(index) // 2
        self._chunks += 1
        self._chunk_indexes += framed.index
        self._crc = zlib.crc32(framed.data, self._crc)
        self.offset += len(framed.data)

    def ending(self) -> bytes:
        """Return what closes the segment."""
        data_end = _build(DataEnd(self._crc))
        begin = self.offset + len(data_end)
        counts = {channel: count for channel, count in self._counts.items() if count}
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(CHANNELS),
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
            (Opcode.STATISTICS, _build(statistics)),
            (Opcode.CHUNK_INDEX, bytes(self._chunk_indexes)),
            (Opcode.METADATA_INDEX, self._manifest_index),
        )
        offsets = []
        at = begin
        for opcode, raw in groups:
            if raw:
                offsets.append(SummaryOffset(opcode, at, len(raw)))
            at += len(raw)
        summary = b"".join(raw for _, raw in groups) + _build(*offsets)
        footer = FRAME.pack(Opcode.FOOTER, 20) + struct.pack("<QQ", begin, at)
        crc = zlib.crc32(footer, zlib.crc32(summary))
        return data_end + summary + _build(Footer(begin, at, crc)) + MAGIC


def _build(*records: McapRecord) -> bytes:
    builder: Any = RecordBuilder()  # Any: mcap leaves its methods without types
    for record in records:
        record.write(builder)
    return bytes(builder.end())


CHANNEL_RECORDS: Final = _build(*(Channel(number, kind.value, "msgpack", {}, 0) for kind, number in CHANNELS.items()))
"""The end of every segment's beginning."""
