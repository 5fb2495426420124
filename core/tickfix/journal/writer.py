"""Writing a journal: append, commit, and a new segment now and then."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from tickfix.journal.disk_thread import DiskThread
from tickfix.journal.errors import JournalError
from tickfix.journal.folder import FolderLock, clear_unborn, make_folder, segment_index, segment_path, segment_paths
from tickfix.journal.manifest import Manifest
from tickfix.journal.records import Group, Kind
from tickfix.journal.retention import drop_old
from tickfix.journal.segment_file import SegmentFile
from tickfix.journal.settings import JournalSettings

_SNAPSHOTS: Final = 4
_MB: Final = 1_000_000


class JournalWriter:
    """The one who writes to a folder; for one thread, save :meth:`when_durable` and ``durable``.

    A new segment always begins, and the older ones are never touched, save by retention. What is appended is in memory
    until :meth:`commit`; what is committed survives the death of this process; what is durable, a loss of power.

    Args:
        folder: made if there is none.
        manifest: of the run; its ``first_number`` is filled in.
        first_number: of the next record: 1 in a new run, one more than the last intact one where a run goes on.
        snapshot: where a run goes on, the first record; the segment appears with it whole.
        wall_ns: the wall clock.

    Raises:
        JournalLocked: when another process writes to the folder.
        JournalFull: when there is no room for a segment.
        JournalError: when the folder cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        manifest: Manifest,
        settings: JournalSettings | None = None,
        *,
        first_number: int = 1,
        snapshot: bytes | None = None,
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """Take the folder's lock and begin a segment."""
        self._folder = folder
        self._manifest = manifest
        self._settings = settings or JournalSettings()
        self._wall_ns = wall_ns
        make_folder(folder)
        self._lock = FolderLock(folder)
        try:
            clear_unborn(folder)
            index = max(map(segment_index, segment_paths(folder)), default=0) + 1
            now_ns = wall_ns()
            opening = None if snapshot is None else _opening(first_number, now_ns, snapshot)
            self._file = self._begin(index, first_number, opening)
        except BaseException:
            self._lock.release()
            raise
        self._index = index
        self._begun_ns = now_ns
        self._opening_size = self._file.layout.offset
        self._group = Group(first_number if opening is None else opening.next)
        self._disk = DiskThread(folder, self._settings.sync_ms / 1e3, first_number - 1, self._drop_old)
        self._disk.wrote(self._file, self._group.next - 1)
        self._open = True

    @property
    def next_number(self) -> int:
        """The number that the next record gets."""
        return self._group.next

    @property
    def pending(self) -> int:
        """How many records are appended and not committed."""
        return len(self._group)

    @property
    def durable(self) -> int:
        """Every record up to this number is on the disk."""
        return self._disk.durable

    @property
    def path(self) -> Path:
        """The segment that is being written."""
        return self._file.path

    def append(self, kind: Kind, device: str, t_ns: int, payload: bytes) -> int:
        """Append a record and return its number; it is in memory until :meth:`commit`.

        Args:
            kind: what it is.
            device: whom it is about; empty where it is about none.
            t_ns: on the device's clock.
            payload: kept as it is.

        Raises:
            ValueError: for a time that 64 bits cannot hold, or a device name that UTF-8 cannot.
        """
        return self._group.add(kind, device, t_ns, self._wall_ns(), payload)

    def commit(self) -> None:
        """Write what was appended, as one checksummed chunk in one call.

        Raises:
            JournalFull: when there is no room. What was committed stays as it was, and what was appended stays in
                memory: commit again when there is room, or :meth:`discard` it.
            JournalError: when it cannot be written, or an earlier commit did not reach the disk.
        """
        self._check()
        if not self._group:
            return
        self._file.write(self._group)
        self._disk.wrote(self._file, self._group.next - 1)
        self._group = Group(self._group.next)

    def discard(self) -> int:
        """Forget what was appended and not committed, and return how many records that were; their numbers are free."""
        count = len(self._group)
        self._group = Group(self._group.first)
        return count

    def wants_segment(self) -> bool:
        """Tell whether the segment is as large or as old as the settings allow.

        The snapshot that it begins with does not count, and four times as much must follow it: of many devices it is
        large, the loop waits while it is made, and a journal of snapshots would serve nobody.
        """
        age_s = (self._wall_ns() - self._begun_ns) * 1e-9
        grown = self._file.layout.offset + self._group.size - self._opening_size
        return (
            grown >= max(self._settings.segment_mb * _MB, _SNAPSHOTS * self._opening_size)
            or age_s >= self._settings.segment_s
        )

    def new_segment(self, snapshot: bytes) -> None:
        """Commit, begin a segment with the snapshot as its first record, and close the one before.

        The new segment appears with its snapshot whole. Waiting for the disk, and dropping old segments after it, is
        left to the disk's thread.

        Raises:
            JournalFull: when there is no room; then the old segment goes on.
            JournalError: as :meth:`commit`.
        """
        self.commit()
        now_ns = self._wall_ns()
        opening = _opening(self._group.first, now_ns, snapshot)
        new = self._begin(self._index + 1, opening.first, opening)
        # Without its ending a segment can be read all the same, and more slowly.
        with suppress(JournalError):
            self._file.write_ending()
        self._file = new
        self._index += 1
        self._begun_ns = now_ns
        self._opening_size = new.layout.offset
        self._group = Group(opening.next)
        self._disk.wrote(new, opening.first)

    def when_durable(self, number: int, then: Callable[[], None]) -> None:
        """Have ``then`` called from the disk's thread once every record up to ``number`` is on the disk.

        Calls come in the order of their numbers. One that raises does not keep the next from its turn; the next
        :meth:`commit` raises it. Those for numbers that were never committed are not called.
        """
        self._disk.when_durable(number, then)

    def close(self) -> None:
        """Commit, close the segment, wait for the disk, and give the folder back.

        Raises:
            JournalFull, JournalError: as :meth:`commit`; the journal is closed all the same.
        """
        if not self._open:
            return
        self._open = False
        try:
            if self._group:
                self._file.write(self._group)
                self._disk.wrote(self._file, self._group.next - 1)
            self._file.write_ending()
        finally:
            self._disk.close()
            self._lock.release()
        self._raise_failure()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()

    def _begin(self, index: int, first_number: int, opening: Group | None) -> SegmentFile:
        manifest = replace(self._manifest, first_number=first_number)
        return SegmentFile(segment_path(self._folder, index), manifest, opening)

    def _drop_old(self) -> None:
        drop_old(self._folder, self._settings, self._wall_ns())

    def _check(self) -> None:
        if not self._open:
            raise JournalError(f"{self._folder}: this journal is closed")
        self._raise_failure()

    def _raise_failure(self) -> None:
        failure = self._disk.take_failure()
        if failure is not None:
            raise failure


def _opening(number: int, now_ns: int, snapshot: bytes) -> Group:
    opening = Group(number)
    opening.add(Kind.SNAPSHOT, "", now_ns, now_ns, snapshot)
    return opening
