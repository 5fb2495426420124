"""Reading one segment, believing nothing that is not intact.

A chunk's messages have a CRC. Everything else in a segment follows from them and from the manifest, which has a
checksum of its own: it is laid out again and compared, byte by byte. Where a chunk is damaged, reading goes on at the
next: by the summary where there is an intact one, else by the chunk's length, which its head tells three times.
"""

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
from mcap.records import Metadata

from tickfix.journal.errors import JournalError
from tickfix.journal.layout import CHANNEL_RECORDS, CHUNK_HEAD, FRAME, MANIFEST, Layout, frame_group
from tickfix.journal.manifest import Manifest, ManifestError, parse_manifest
from tickfix.journal.records import Kind, Record, RecordsError, parse
from tickfix.journal.summary import Summary, read_summary

_HEADS: Final = (1 << 16, 1 << 24)
_HEAD_REST: Final = CHUNK_HEAD.size - FRAME.size
_INDEX_REST: Final = 6


@dataclass(frozen=True, slots=True)
class Damage:
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
        complete: after :meth:`groups` was exhausted: it is closed, and every byte is as it was written.

    Raises:
        JournalError: when the file cannot be read at all.
    """

    def __init__(self, path: Path) -> None:
        """Read the beginning."""
        self.path = path
        self.damage: list[Damage] = []
        self.complete = False
        self.manifest: Manifest | None = None
        self._layout: Layout | None = None
        self._begin: int | None = None
        with self._open() as file:
            self.size = os.fstat(file.fileno()).st_size
            self._read_beginning(file)

    def summary(self) -> Summary | None:
        """Return what the end of the file says, or None where it is missing or damaged; it may flatter the rest."""
        with self._open() as file:
            return read_summary(file, self.size)

    def groups(self) -> Iterator[tuple[int, tuple[Record, ...]]]:
        """Yield the offset and the records of every intact chunk; what is not is added to ``damage``."""
        at = self._begin
        if at is None:
            return
        with self._open() as file:
            last = 0
            while at is not None and at < self.size:
                head = _read(file, at, CHUNK_HEAD.size)
                if _is_data_end(head):
                    self._read_ending(file, at)
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

    def _found(self, offset: int, what: str) -> None:
        self.damage.append(Damage(self.path, offset, what))

    def _read_beginning(self, file: BinaryIO) -> None:
        head = b""
        end = -1
        for size in _HEADS:
            head = _read(file, 0, min(size, self.size))
            end = head.find(CHANNEL_RECORDS)
            if end >= 0 or len(head) == self.size:
                break
        try:
            self.manifest = _manifest(head)
        except ManifestError as error:
            self._found(0, str(error))
        else:
            self._layout = Layout(self.manifest)
            expected = self._layout.beginning
            self._compare(0, _read(file, 0, len(expected)), expected, "beginning")
            end = len(expected) - len(CHANNEL_RECORDS)
        if end >= 0:
            self._begin = end + len(CHANNEL_RECORDS)

    def _read_chunk(self, file: BinaryIO, at: int, head: bytes, last: int) -> tuple[tuple[Record, ...], int] | None:
        """Return a chunk's records and the bytes it takes with its indexes; None where they cannot be believed."""
        try:
            data = self._chunk_data(file, at, head)
            group, records = parse(data)
            if group.first <= last:
                raise RecordsError(f"record {group.first} after record {last}")  # noqa: TRY301 - one kind of damage
        except RecordsError as error:
            self._found(at, f"a chunk that is not as it was written: {error}")
            return None
        framed = frame_group(at, group, data)
        after = framed.chunk_size
        self._compare(at, head, framed.data[: len(head)], "head of a chunk")
        self._compare(at + after, _read(file, at + after, len(framed.data) - after), framed.data[after:], "index")
        if self._layout is not None:
            self._layout.count(framed)
        return records, len(framed.data)

    def _chunk_data(self, file: BinaryIO, at: int, head: bytes) -> bytes:
        """Return the messages in a chunk, their checksum being right."""
        length = _data_length(head)
        if len(head) < CHUNK_HEAD.size:
            raise RecordsError(f"cut off: {len(head)} bytes, its head alone takes {CHUNK_HEAD.size}")
        if length is None:
            raise RecordsError(f"opcode {head[0]} and lengths that contradict each other")
        if at + CHUNK_HEAD.size + length > self.size:
            raise RecordsError(f"cut off: {self.size - at} of {CHUNK_HEAD.size + length} bytes")
        data = _read(file, at + CHUNK_HEAD.size, length)
        crc = CHUNK_HEAD.unpack(head)[5]
        if zlib.crc32(data) != crc:
            raise RecordsError(f"found checksum {zlib.crc32(data):08x}, expected {crc:08x}")
        return data

    def _next_chunk(self, file: BinaryIO, at: int, head: bytes) -> int | None:
        """Return where to go on after damage, or None."""
        summary = read_summary(file, self.size)
        if summary is not None:
            return summary.after(at)
        length = _data_length(head)
        if length is None:
            return None
        at += CHUNK_HEAD.size + length
        if at > self.size:
            return None
        while (index := _index_length(_read(file, at, FRAME.size + _INDEX_REST))) is not None:
            at += FRAME.size + index
        return at

    def _read_ending(self, file: BinaryIO, at: int) -> None:
        if self.damage or self._layout is None:
            # The ending follows from all that is before it; it has a checksum to be judged by alone.
            if read_summary(file, self.size) is None:
                self._found(at, "the summary is damaged or cut off")
            return
        expected = self._layout.ending()
        self._compare(at, _read(file, at, self.size - at), expected, "ending")
        self.complete = not self.damage

    def _compare(self, at: int, found: bytes, expected: bytes, what: str) -> None:
        if found == expected:
            return
        same = next((i for i, (a, b) in enumerate(zip(found, expected, strict=False)) if a != b), None)
        if same is not None:
            self._found(at + same, f"the {what} is not as it was written: found byte {found[same]:#04x}, expected "
                        f"{expected[same]:#04x}")  # fmt: skip
        elif len(found) < len(expected):
            self._found(at + len(found), f"the {what} is cut off: {len(found)} of {len(expected)} bytes")
        else:
            self._found(at + len(expected), f"{len(found) - len(expected)} bytes after the {what}")


def begins_with_snapshot(path: Path) -> bool:
    """Tell whether a segment's first record is there, intact, and a snapshot."""
    try:
        reader = SegmentReader(path)
        groups = reader.groups()
        first = next(groups, None)
    except JournalError:
        return False
    if first is None or reader.manifest is None:
        return False
    record = first[1][0]
    return record.kind is Kind.SNAPSHOT and record.number == reader.manifest.first_number


def _manifest(head: bytes) -> Manifest:
    name_at = head.find(MANIFEST.encode())
    if name_at < 0:
        raise ManifestError("no manifest; expected one at the beginning of a segment")
    raw = head[name_at - 4 :]
    stream: Any = ReadDataStream(io.BytesIO(raw))
    try:
        name = stream.read_prefixed_string()
        length = stream.read4()
        if name != MANIFEST or length > len(raw):
            raise ManifestError("the manifest is damaged or cut off")
        entries = Metadata.read(ReadDataStream(io.BytesIO(raw))).metadata
    except (ValueError, McapError, struct.error) as error:
        raise ManifestError(f"the manifest is damaged or cut off ({error})") from error
    return parse_manifest(entries)


def _read(file: BinaryIO, at: int, size: int) -> bytes:
    file.seek(at)
    return file.read(size)


def _is_data_end(head: bytes) -> bool:
    return len(head) >= FRAME.size and FRAME.unpack_from(head) == (Opcode.DATA_END, 4)


def _data_length(head: bytes) -> int | None:
    """Return how long a chunk's data is: what two of the three lengths in its head say."""
    if len(head) < CHUNK_HEAD.size:
        return None
    _, length, _, _, size, _, _, data = CHUNK_HEAD.unpack(head)
    told = [int(length) - _HEAD_REST, int(size), int(data)]
    return next((n for n in told if n > 0 and told.count(n) >= 2), None)


def _index_length(head: bytes) -> int | None:
    if len(head) < FRAME.size + _INDEX_REST:
        return None
    opcode, length = FRAME.unpack_from(head)
    entries = int.from_bytes(head[FRAME.size + 2 :], "little")
    return int(length) if opcode == Opcode.MESSAGE_INDEX and length == _INDEX_REST + entries else None
