"""Bytes of files that may be gzipped, and may be damaged."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Final

from tickfix.api import ReaderError

GZIP_MAGIC: Final = b"\x1f\x8b"
_CHUNK: Final = 1024


def read_bytes(path: Path, limit: int | None = None) -> tuple[bytes, str]:
    """Return what ``path`` holds, decompressed where its content (not its name) says that it is gzipped.

    Args:
        path: the file.
        limit: stop after about so many compressed bytes; enough to recognise a format.

    Returns:
        The bytes, as many as could be read, and why there are no more: empty unless the gzip is cut or corrupt.

    Raises:
        ReaderError: when the file cannot be opened.
    """
    try:
        with path.open("rb") as file:
            data = file.read() if limit is None else file.read(limit)
    except OSError as error:
        raise ReaderError(f"{path}: cannot be read: {error.strerror or error}") from error
    return _gunzip(data) if data.startswith(GZIP_MAGIC) else (data, "")


def _gunzip(data: bytes) -> tuple[bytes, str]:
    """Decompress member by member and in small chunks, so that a damaged one costs little of what stands before it."""
    out: list[bytes] = []
    while data:
        member = zlib.decompressobj(wbits=31)
        for start in range(0, len(data), _CHUNK):
            try:
                out.append(member.decompress(data[start : start + _CHUNK]))
            except zlib.error as error:
                return b"".join(out), f"a corrupt gzip ({error})"
            if member.eof:
                data = member.unused_data + data[start + _CHUNK :]
                break
        else:
            return b"".join(out), "a gzip that ends too early"
    return b"".join(out), ""
