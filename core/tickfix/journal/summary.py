"""The end of a closed segment: what is in it and where, without reading it all."""

from __future__ import annotations

import io
import struct
import zlib
from dataclasses import dataclass
from typing import BinaryIO, Final

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Statistics
from mcap.stream_reader import StreamReader

from tickfix.journal.layout import DATA_END_SIZE, FOOTER_SIZE, FRAME, MAGIC

_FOOTER: Final = struct.Struct("<BQQQI")


@dataclass(frozen=True, slots=True)
class Summary:
    """What an intact summary says.

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


def read_summary(file: BinaryIO, size: int) -> Summary | None:
    """Read the summary of a file of ``size`` bytes; None where there is none or its checksum differs."""
    tail = FOOTER_SIZE + len(MAGIC)
    if size < tail:
        return None
    file.seek(size - tail)
    footer = file.read(tail)
    opcode, length, start, _, crc = _FOOTER.unpack_from(footer)
    if opcode != Opcode.FOOTER or length != FOOTER_SIZE - FRAME.size or footer[FOOTER_SIZE:] != MAGIC:
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
    return Summary(
        count=statistics.message_count,
        start_ns=statistics.message_start_time,
        end_ns=statistics.message_end_time,
        chunks=tuple(sorted(chunks)),
        data_end=start - DATA_END_SIZE,
    )
