"""Reads one segment and verifies every byte of it.

A chunk's messages have a CRC. Everything else in a segment follows from them and from the manifest, which has a
checksum of its own: it is laid out again and compared byte by byte. After a damaged chunk, reading resumes at the next
one: by the summary section where it is intact, else by the chunk's length, which its header states three times."""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Metadata, Statistics
from mcap.stream_reader import StreamReader

from tickfix.journal.journal_folder import JournalError
from tickfix.journal.segment_layout import (
    CHANNEL_RECORDS,
    CHUNK_HEADER,
    DATA_END_SIZE,
    FOOTER_SIZE,
    FRAME_STRUCT,
    MANIFEST_NAME,
    MCAP_MAGIC,
    JournalRecord,
    RecordFormatError,
    RecordKind,
    RunManifest,
    RunManifestError,
    SegmentLayout,
    frame_batch,
    parse_batch,
    parse_run_manifest,
)

_FOOTER_STRUCT: Final = struct.Struct("<BQQQI")


@dataclass(frozen=True, slots=True)
class SegmentSummary:
    """The contents of an intact summary.

    Attributes:
        count: number of records.
        start_ns, end_ns: wall clock of the oldest and the newest record.
        chunks: where chunks begin, ascending.
        data_end: where the data end.
    """

    count: int
    start_ns: int
    end_ns: int
    chunks: tuple[int, ...]
    data_end: int

    def after(self, offset: int) -> int | None:
        """Return where the next chunk begins, or the data end; None where nothing comes after ``offset``."""
        return next((at for at in (*self.chunks, self.data_end) if at > offset), None)


def read_segment_summary(file: BinaryIO, size: int) -> SegmentSummary | None:
    """Read the summary of a file of ``size`` bytes; None where there is none or its checksum differs."""
    tail = FOOTER_SIZE + len(MCAP_MAGIC)
    if size < tail:
        return None
    file.seek(size - tail)
    footer = file.read(tail)
    opcode, length, start, _, crc = _FOOTER_STRUCT.unpack_from(footer)
    if opcode != Opcode.FOOTER or length != FOOTER_SIZE - FRAME_STRUCT.size or footer[FOOTER_SIZE:] != MCAP_MAGIC:
        return None
    if not 0 < start <= size - tail:
        return None
    file.seek(start)
    raw = file.read(size - tail - start)
    if zlib.crc32(footer[: FOOTER_SIZE - 4], zlib.crc32(raw)) != crc:
        return None
    chunks = []
    statistics = None
    for record in StreamReader(io.BytesIO(raw + footer), skip_magic=True).records:
        if isinstance(record, ChunkIndex):
            chunks.append(record.chunk_start_offset)
        elif isinstance(record, Statistics):
            statistics = record
    if statistics is None:
        return None
    return SegmentSummary(
        count=statistics.message_count,
        start_ns=statistics.message_start_time,
        end_ns=statistics.message_end_time,
        chunks=tuple(sorted(chunks)),
        data_end=start - DATA_END_SIZE,
    )


_PREAMBLE_READ_SIZES: Final = (1 << 16, 1 << 24)
_CHUNK_HEADER_REST: Final = CHUNK_HEADER.size - FRAME_STRUCT.size
_INDEX_HEADER_REST: Final = 6


@dataclass(frozen=True, slots=True)
class SegmentDamage:
    """A place in a segment that is not as it was written, or that ends too early."""

    path: Path
    offset: int
    what: str

    def __str__(self) -> str:
        """Return one sentence for the user."""
        return f"{self.path}: at byte {self.offset}: {self.what}"


class SegmentReader:
    """Reads a segment from its beginning, one chunk in memory at a time.

    Attributes:
        path: of the segment.
        manifest: None where it is damaged.
        size: bytes of the file when it was opened; what a writer adds later is not seen.
        damage: what was found so far.
        complete: after :meth:`batches` was exhausted: it is closed, and every byte is as it was written.

    Raises:
        JournalError: when the file cannot be read at all.
    """

    def __init__(self, path: Path) -> None:
        """Read the beginning."""
        self.path = path
        self.damage: list[SegmentDamage] = []
        self.complete = False
        self.manifest: RunManifest | None = None
        self._layout: SegmentLayout | None = None
        self._first_chunk_offset: int | None = None
        with self._open() as file:
            self.size = os.fstat(file.fileno()).st_size
            self._read_preamble(file)

    def summary(self) -> SegmentSummary | None:
        """Return the summary at the end of the file, None if missing or damaged; the rest may still be damaged."""
        with self._open() as file:
            return read_segment_summary(file, self.size)

    def batches(self) -> Iterator[tuple[int, tuple[JournalRecord, ...]]]:
        """Yield the offset and the records of every intact chunk; what is not is added to ``damage``."""
        at = self._first_chunk_offset
        if at is None:
            return
        with self._open() as file:
            last = 0
            while at is not None and at < self.size:
                head = _read_at(file, at, CHUNK_HEADER.size)
                if _is_data_end(head):
                    self._read_closing_section(file, at)
                    return
                chunk = self._read_chunk(file, at, head, last)
                if chunk is None:
                    at = self._next_chunk(file, at, head)
                    continue
                records, size = chunk
                yield at, records
                last = records[-1].number
                at += size

    def _open(self) -> BinaryIO:
        try:
            return self.path.open("rb")
        except OSError as error:
            raise JournalError(f"{self.path}: cannot be read ({error.strerror})") from error

    def _add_damage(self, offset: int, what: str) -> None:
        self.damage.append(SegmentDamage(self.path, offset, what))

    def _read_preamble(self, file: BinaryIO) -> None:
        head = b""
        end = -1
        for size in _PREAMBLE_READ_SIZES:
            head = _read_at(file, 0, min(size, self.size))
            end = head.find(CHANNEL_RECORDS)
            if end >= 0 or len(head) == self.size:
                break
        try:
            self.manifest = _read_manifest(head)
        except RunManifestError as error:
            self._add_damage(0, str(error))
        else:
            self._layout = SegmentLayout(self.manifest)
            expected = self._layout.preamble
            self._compare(0, _read_at(file, 0, len(expected)), expected, "beginning")
            end = len(expected) - len(CHANNEL_RECORDS)
        if end >= 0:
            self._first_chunk_offset = end + len(CHANNEL_RECORDS)

    def _read_chunk(
        self, file: BinaryIO, at: int, head: bytes, last: int
    ) -> tuple[tuple[JournalRecord, ...], int] | None:
        """Return a chunk's records and the bytes it takes with its indexes; None where they cannot be believed."""
        try:
            data = self._chunk_data(file, at, head)
            batch, records = parse_batch(data)
            if batch.first <= last:
                raise RecordFormatError(f"record {batch.first} after record {last}")  # noqa: TRY301 - one kind of damage
        except RecordFormatError as error:
            self._add_damage(at, f"a chunk that is not as it was written: {error}")
            return None
        framed = frame_batch(at, batch, data)
        after = framed.chunk_size
        self._compare(at, head, framed.data[: len(head)], "head of a chunk")
        self._compare(at + after, _read_at(file, at + after, len(framed.data) - after), framed.data[after:], "index")
        if self._layout is not None:
            self._layout.count(framed)
        return records, len(framed.data)

    def _chunk_data(self, file: BinaryIO, at: int, head: bytes) -> bytes:
        """Return the messages in a chunk, their checksum being right."""
        length = _chunk_data_length(head)
        if len(head) < CHUNK_HEADER.size:
            raise RecordFormatError(f"cut off: {len(head)} bytes, its head alone takes {CHUNK_HEADER.size}")
        if length is None:
            raise RecordFormatError(f"opcode {head[0]} and lengths that contradict each other")
        if at + CHUNK_HEADER.size + length > self.size:
            raise RecordFormatError(f"cut off: {self.size - at} of {CHUNK_HEADER.size + length} bytes")
        data = _read_at(file, at + CHUNK_HEADER.size, length)
        crc = CHUNK_HEADER.unpack(head)[5]
        if zlib.crc32(data) != crc:
            raise RecordFormatError(f"found checksum {zlib.crc32(data):08x}, expected {crc:08x}")
        return data

    def _next_chunk(self, file: BinaryIO, at: int, head: bytes) -> int | None:
        """Return where to go on after damage, or None."""
        summary = read_segment_summary(file, self.size)
        if summary is not None:
            return summary.after(at)
        length = _chunk_data_length(head)
        if length is None:
            return None
        at += CHUNK_HEADER.size + length
        if at > self.size:
            return None
        while (index := _message_index_length(_read_at(file, at, FRAME_STRUCT.size + _INDEX_HEADER_REST))) is not None:
            at += FRAME_STRUCT.size + index
        return at

    def _read_closing_section(self, file: BinaryIO, at: int) -> None:
        if self.damage or self._layout is None:
            # The ending follows from all that is before it; it has a checksum to be judged by alone.
            if read_segment_summary(file, self.size) is None:
                self._add_damage(at, "the summary is damaged or cut off")
            return
        expected = self._layout.closing_section()
        self._compare(at, _read_at(file, at, self.size - at), expected, "ending")
        self.complete = not self.damage

    def _compare(self, at: int, found: bytes, expected: bytes, what: str) -> None:
        if found == expected:
            return
        same = next((i for i, (a, b) in enumerate(zip(found, expected, strict=False)) if a != b), None)
        if same is not None:
            self._add_damage(at + same, f"the {what} is not as it was written: found byte {found[same]:#04x}, expected "
                        f"{expected[same]:#04x}")  # fmt: skip
        elif len(found) < len(expected):
            self._add_damage(at + len(found), f"the {what} is cut off: {len(found)} of {len(expected)} bytes")
        else:
            self._add_damage(at + len(expected), f"{len(found) - len(expected)} bytes after the {what}")


def begins_with_snapshot(path: Path) -> bool:
    """Tell whether a segment's first record is there, intact, and a snapshot."""
    try:
        reader = SegmentReader(path)
        batches = reader.batches()
        first = next(batches, None)
    except JournalError:
        return False
    if first is None or reader.manifest is None:
        return False
    record = first[1][0]
    return record.kind is RecordKind.SNAPSHOT and record.number == reader.manifest.first_number


def _read_manifest(head: bytes) -> RunManifest:
    name_at = head.find(MANIFEST_NAME.encode())
    if name_at < 0:
        raise RunManifestError("no manifest; expected one at the beginning of a segment")
    raw = head[name_at - 4 :]
    stream: Any = ReadDataStream(io.BytesIO(raw))
    try:
        name = stream.read_prefixed_string()
        length = stream.read4()
        if name != MANIFEST_NAME or length > len(raw):
            raise RunManifestError("the manifest is damaged or cut off")
        entries = Metadata.read(ReadDataStream(io.BytesIO(raw))).metadata
    except (ValueError, McapError, struct.error) as error:
        raise RunManifestError(f"the manifest is damaged or cut off ({error})") from error
    return parse_run_manifest(entries)


def _read_at(file: BinaryIO, at: int, size: int) -> bytes:
    file.seek(at)
    return file.read(size)


def _is_data_end(head: bytes) -> bool:
    return len(head) >= FRAME_STRUCT.size and FRAME_STRUCT.unpack_from(head) == (Opcode.DATA_END, 4)


def _chunk_data_length(head: bytes) -> int | None:
    """Return how long a chunk's data is: the value that two of the three lengths in its head agree on."""
    if len(head) < CHUNK_HEADER.size:
        return None
    _, length, _, _, size, _, _, data = CHUNK_HEADER.unpack(head)
    lengths = [int(length) - _CHUNK_HEADER_REST, int(size), int(data)]
    return next((n for n in lengths if n > 0 and lengths.count(n) >= 2), None)


def _message_index_length(head: bytes) -> int | None:
    if len(head) < FRAME_STRUCT.size + _INDEX_HEADER_REST:
        return None
    opcode, length = FRAME_STRUCT.unpack_from(head)
    entries = int.from_bytes(head[FRAME_STRUCT.size + 2 :], "little")
    return int(length) if opcode == Opcode.MESSAGE_INDEX and length == _INDEX_HEADER_REST + entries else None
