"""Writes a journal: append, commit, roll to a new segment, and delete expired segments."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from tickfix.journal.journal_folder import (
    FolderLock,
    JournalError,
    JournalSettings,
    make_folder,
    remove_temporary_segments,
    segment_index,
    segment_path,
    segment_paths,
    sync_folder,
)
from tickfix.journal.segment_layout import RecordBatch, RecordKind, RunManifest
from tickfix.journal.segment_reader import begins_with_snapshot
from tickfix.journal.segment_writer import FsyncThread, SegmentFile

_BYTES_PER_MB: Final = 1_000_000


def delete_expired_segments(folder: Path, settings: JournalSettings, wall_ns: int) -> tuple[Path, ...]:
    """Drop the oldest segments that are too many MB or too old, whole, and return them.

    The newest segment that begins with an intact snapshot stays, with all after it: from there the run can be repeated.
    A segment's age is that of its file's last change.

    Raises:
        JournalError: naming the segment that cannot be dropped.
    """
    if settings.keep_mb is None and settings.keep_s is None:
        return ()
    paths = segment_paths(folder)
    kept_from = next((i for i in reversed(range(len(paths))) if begins_with_snapshot(paths[i])), 0)
    dropped: list[Path] = []
    try:
        states = [path.stat() for path in paths]
        total_mb = sum(state.st_size for state in states) / _BYTES_PER_MB
        for path, state in list(zip(paths, states, strict=True))[:kept_from]:
            age_s = (wall_ns - state.st_mtime_ns) * 1e-9
            large = settings.keep_mb is not None and total_mb > settings.keep_mb
            old = settings.keep_s is not None and age_s > settings.keep_s
            if not (large or old):
                break
            path.unlink()
            dropped.append(path)
            total_mb -= state.st_size / _BYTES_PER_MB
        if dropped:
            sync_folder(folder)
    except OSError as error:
        raise JournalError(f"{error.filename or folder}: cannot be dropped ({error.strerror})") from error
    return tuple(dropped)


_MIN_GROWTH_IN_SNAPSHOTS: Final = 4
_BYTES_PER_MEGABYTE: Final = 1_000_000


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
        manifest: RunManifest,
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
            remove_temporary_segments(folder)
            index = max(map(segment_index, segment_paths(folder)), default=0) + 1
            now_ns = wall_ns()
            snapshot_batch = None if snapshot is None else _snapshot_batch(first_number, now_ns, snapshot)
            self._file = self._create_segment(index, first_number, snapshot_batch)
        except BaseException:
            self._lock.release()
            raise
        self._index = index
        self._segment_started_ns = now_ns
        self._snapshot_size = self._file.layout.offset
        self._batch = RecordBatch(first_number if snapshot_batch is None else snapshot_batch.next)
        self._fsync_thread = FsyncThread(folder, self._settings.sync_ms / 1e3, first_number - 1, self._delete_expired)
        self._fsync_thread.notify_written(self._file, self._batch.next - 1)
        self._open = True

    @property
    def next_number(self) -> int:
        """The number that the next record gets."""
        return self._batch.next

    @property
    def pending(self) -> int:
        """How many records are appended and not committed."""
        return len(self._batch)

    @property
    def durable(self) -> int:
        """Every record up to this number is on the disk."""
        return self._fsync_thread.durable

    @property
    def path(self) -> Path:
        """The segment that is being written."""
        return self._file.path

    def append(self, kind: RecordKind, device: str, t_ns: int, payload: bytes) -> int:
        """Append a record and return its number; it is in memory until :meth:`commit`.

        Args:
            kind: what it is.
            device: whom it is about; empty where it is about none.
            t_ns: on the device's clock.
            payload: kept as it is.

        Raises:
            ValueError: for a time that 64 bits cannot hold, or a device name that UTF-8 cannot.
        """
        return self._batch.add(kind, device, t_ns, self._wall_ns(), payload)

    def commit(self) -> None:
        """Write what was appended, as one checksummed chunk in one call.

        Raises:
            JournalFull: when there is no room. What was committed stays as it was, and what was appended stays in
                memory: commit again when there is room, or :meth:`discard` it.
            JournalError: when it cannot be written, or an earlier commit did not reach the disk.
        """
        self._raise_if_unusable()
        if not self._batch:
            return
        self._file.write(self._batch)
        self._fsync_thread.notify_written(self._file, self._batch.next - 1)
        self._batch = RecordBatch(self._batch.next)

    def discard(self) -> int:
        """Forget what was appended and not committed, and return how many records that were; their numbers are free."""
        count = len(self._batch)
        self._batch = RecordBatch(self._batch.first)
        return count

    def should_roll_segment(self) -> bool:
        """Return whether the segment is as large or as old as the settings allow.

        The snapshot that it begins with does not count, and four times as much must follow it: of many devices it is
        large, the loop waits while it is made, and a journal of snapshots would be useless.
        """
        age_s = (self._wall_ns() - self._segment_started_ns) * 1e-9
        grown = self._file.layout.offset + self._batch.size - self._snapshot_size
        return (
            grown
            >= max(self._settings.segment_mb * _BYTES_PER_MEGABYTE, _MIN_GROWTH_IN_SNAPSHOTS * self._snapshot_size)
            or age_s >= self._settings.segment_s
        )

    def roll_segment(self, snapshot: bytes) -> None:
        """Commit, begin a segment with the snapshot as its first record, and close the one before.

        The new segment appears with its snapshot whole. Waiting for the disk, and dropping old segments after it, is
        left to the disk's thread.

        Raises:
            JournalFull: when there is no room; then the old segment goes on.
            JournalError: as :meth:`commit`.
        """
        self.commit()
        now_ns = self._wall_ns()
        snapshot_batch = _snapshot_batch(self._batch.first, now_ns, snapshot)
        new = self._create_segment(self._index + 1, snapshot_batch.first, snapshot_batch)
        # Without its ending a segment can be read all the same, and more slowly.
        with suppress(JournalError):
            self._file.write_closing_section()
        self._file = new
        self._index += 1
        self._segment_started_ns = now_ns
        self._snapshot_size = new.layout.offset
        self._batch = RecordBatch(snapshot_batch.next)
        self._fsync_thread.notify_written(new, snapshot_batch.first)

    def when_durable(self, number: int, callback: Callable[[], None]) -> None:
        """Have ``callback`` called from the disk's thread once every record up to ``number`` is on the disk.

        Calls come in the order of their numbers. One that raises does not keep the next from its turn; the next
        :meth:`commit` raises it. Those for numbers that were never committed are not called.
        """
        self._fsync_thread.when_durable(number, callback)

    def close(self) -> None:
        """Commit, close the segment, wait for the disk, and give the folder back.

        Raises:
            JournalFull, JournalError: as :meth:`commit`; the journal is closed all the same.
        """
        if not self._open:
            return
        self._open = False
        try:
            if self._batch:
                self._file.write(self._batch)
                self._fsync_thread.notify_written(self._file, self._batch.next - 1)
            self._file.write_closing_section()
        finally:
            self._fsync_thread.close()
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

    def _create_segment(self, index: int, first_number: int, snapshot_batch: RecordBatch | None) -> SegmentFile:
        manifest = replace(self._manifest, first_number=first_number)
        return SegmentFile(segment_path(self._folder, index), manifest, snapshot_batch)

    def _delete_expired(self) -> None:
        delete_expired_segments(self._folder, self._settings, self._wall_ns())

    def _raise_if_unusable(self) -> None:
        if not self._open:
            raise JournalError(f"{self._folder}: this journal is closed")
        self._raise_failure()

    def _raise_failure(self) -> None:
        failure = self._fsync_thread.pop_failure()
        if failure is not None:
            raise failure


def _snapshot_batch(number: int, now_ns: int, snapshot: bytes) -> RecordBatch:
    snapshot_batch = RecordBatch(number)
    snapshot_batch.add(RecordKind.SNAPSHOT, "", now_ns, now_ns, snapshot)
    return snapshot_batch
