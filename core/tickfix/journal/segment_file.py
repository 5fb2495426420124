"""One segment as its writer holds it."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from tickfix.journal.errors import write_error
from tickfix.journal.folder import UNBORN
from tickfix.journal.layout import Framed, Layout, frame_group
from tickfix.journal.manifest import Manifest
from tickfix.journal.records import Group


class SegmentFile:
    """A segment that grows by whole groups, or not at all.

    Attributes:
        path: of the file.
        handle: its descriptor; whoever retires the segment closes it.
        layout: what is in it so far.
    """

    def __init__(self, path: Path, manifest: Manifest, opening: Group | None = None) -> None:
        """Create the file; under its name it appears with its beginning and the first group whole. The caller has
        the folder's lock, and sees to it that no such segment is there.

        Raises:
            JournalFull: when there is no room; then there is no file.
            JournalError: when it cannot be created.
        """
        self.path = path
        self.layout = Layout(manifest)
        self._ragged = False
        unborn = path.with_name(path.name + UNBORN)
        framed = None if opening is None else frame_group(self.layout.offset, opening, opening.data())
        try:
            self.handle = os.open(unborn, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o644)
        except OSError as error:
            raise write_error(path, error) from error
        try:
            _write(self.handle, self.layout.beginning + (b"" if framed is None else framed.data), 0)
            unborn.rename(path)
        except OSError as error:
            os.close(self.handle)
            with suppress(OSError):
                unborn.unlink()
            raise write_error(path, error) from error
        if framed is not None:
            self.layout.count(framed)

    def write(self, group: Group) -> Framed:
        """Write a group with one call.

        Raises:
            JournalFull: when there is no room; then the file is as it was.
            JournalError: when it cannot be written; likewise.
        """
        framed = frame_group(self.layout.offset, group, group.data())
        self._append(framed.data)
        self.layout.count(framed)
        return framed

    def write_ending(self) -> None:
        """Close the segment's contents; the file stays open, for whoever waits for the disk.

        Raises:
            JournalFull, JournalError: as :meth:`write`; a segment without its ending can be read all the same.
        """
        self._append(self.layout.ending())

    def _append(self, data: bytes) -> None:
        offset = self.layout.offset
        try:
            if self._ragged:
                os.ftruncate(self.handle, offset)
                self._ragged = False
            _write(self.handle, data, offset)
        except OSError as error:
            self._ragged = True
            with suppress(OSError):
                os.ftruncate(self.handle, offset)
                self._ragged = False
            raise write_error(self.path, error) from error


def _write(handle: int, data: bytes, offset: int) -> None:
    done = os.pwrite(handle, data, offset)
    # A disk that fills up takes a part; asking for the rest brings the reason.
    while done < len(data):
        done += os.pwrite(handle, memoryview(data)[done:], offset + done)
