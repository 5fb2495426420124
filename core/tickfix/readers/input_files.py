"""What readers share: bytes of a file that may be gzipped or damaged, and counts of rejected lines by reason."""

from __future__ import annotations

import zlib
from collections import Counter
from pathlib import Path
from typing import Final

from tickfix.api import ReaderError

MAX_DESCRIBED: Final = 20
"""How many problems are described; all are counted."""


class RejectCounter:
    """Counts what is rejected while one file is read."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._problems: list[str] = []

    def add(self, reason: str, line: int, found: object) -> None:
        """Count one rejection at ``line`` (from 1), where ``found`` stood: bytes of the file, or a description."""
        self._counts[reason] += 1
        if len(self._problems) < MAX_DESCRIBED:
            text = repr(found.decode("utf-8", "replace")) if isinstance(found, bytes) else str(found)
            self._problems.append(f"line {line}: {reason}: found {text if len(text) <= 120 else text[:117] + '…'}")

    @property
    def counts(self) -> dict[str, int]:
        """Rejections by reason, reasons in alphabetical order."""
        return dict(sorted(self._counts.items()))

    @property
    def problems(self) -> tuple[str, ...]:
        """The first few, in the order they were met."""
        return tuple(self._problems)


GZIP_MAGIC: Final = b"\x1f\x8b"
_CHUNK: Final = 1024


def read_bytes(path: Path, limit: int | None = None) -> tuple[bytes, str]:
    """Return what ``path`` holds, decompressed if its content (not its name) is gzipped.

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
