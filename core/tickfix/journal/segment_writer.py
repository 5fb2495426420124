"""Writes one segment, whole batches or nothing, and syncs it to disk on a thread of its own, so that the engine loop
never waits for fsync.
"""

from __future__ import annotations

import heapq
import itertools
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from tickfix.journal.journal_folder import TEMPORARY_SUFFIX, JournalError, sync_folder, write_error
from tickfix.journal.segment_layout import FramedBatch, RecordBatch, RunManifest, SegmentLayout, frame_batch


class SegmentFile:
    """A segment that grows by whole groups, or not at all.

    Attributes:
        path: of the file.
        handle: its descriptor; closed when the segment is retired.
        layout: what is in it so far.
    """

    def __init__(self, path: Path, manifest: RunManifest, first_batch: RecordBatch | None = None) -> None:
        """Create the file; under its name it appears with its beginning and the first group whole. The caller has
        the folder's lock, and sees to it that no such segment is there.

        Raises:
            JournalFull: when there is no room; then there is no file.
            JournalError: when it cannot be created.
        """
        self.path = path
        self.layout = SegmentLayout(manifest)
        self._has_partial_write = False
        temporary = path.with_name(path.name + TEMPORARY_SUFFIX)
        framed = None if first_batch is None else frame_batch(self.layout.offset, first_batch, first_batch.data())
        try:
            self.handle = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o644)
        except OSError as error:
            raise write_error(path, error) from error
        try:
            _write_at(self.handle, self.layout.preamble + (b"" if framed is None else framed.data), 0)
            temporary.rename(path)
        except OSError as error:
            os.close(self.handle)
            with suppress(OSError):
                temporary.unlink()
            raise write_error(path, error) from error
        if framed is not None:
            self.layout.count(framed)

    def write(self, batch: RecordBatch) -> FramedBatch:
        """Write a group with one call.

        Raises:
            JournalFull: when there is no room; then the file is as it was.
            JournalError: when it cannot be written; likewise.
        """
        framed = frame_batch(self.layout.offset, batch, batch.data())
        self._append(framed.data)
        self.layout.count(framed)
        return framed

    def write_closing_section(self) -> None:
        """Close the segment's contents; the file stays open until it is synced.

        Raises:
            JournalFull, JournalError: as :meth:`write`; a segment without its ending can be read all the same.
        """
        self._append(self.layout.closing_section())

    def _append(self, data: bytes) -> None:
        offset = self.layout.offset
        try:
            if self._has_partial_write:
                os.ftruncate(self.handle, offset)
                self._has_partial_write = False
            _write_at(self.handle, data, offset)
        except OSError as error:
            self._has_partial_write = True
            with suppress(OSError):
                os.ftruncate(self.handle, offset)
                self._has_partial_write = False
            raise write_error(self.path, error) from error


def _write_at(handle: int, data: bytes, offset: int) -> None:
    done = os.pwrite(handle, data, offset)
    # A disk that fills up takes a part; asking for the rest brings the reason.
    while done < len(data):
        done += os.pwrite(handle, memoryview(data)[done:], offset + done)


class FsyncThread:
    """Syncs what was written to disk at most every ``interval_s``, in its order, and reports it.

    Args:
        folder: whose names are brought to the disk when a segment is new.
        written: number of the newest record that is in older segments.
        after_new_segment: called when a new segment's beginning is on the disk.
    """

    def __init__(self, folder: Path, interval_s: float, written: int, after_new_segment: Callable[[], None]) -> None:
        """Start the thread."""
        self.durable = written
        self._disk_error: JournalError | None = None
        self._callback_error: JournalError | None = None
        self._folder = folder
        self._interval_s = interval_s
        self._after_new_segment = after_new_segment
        self._changed = threading.Condition()
        self._written = written
        self._file: SegmentFile | None = None
        self._closed_files: list[SegmentFile] = []
        self._new = self._dirty = self._closing = False
        self._waiting: list[tuple[int, int, Callable[[], None]]] = []
        self._tie_breaker = itertools.count()
        self._thread = threading.Thread(target=self._run, name="tickfix-journal-disk", daemon=True)
        self._thread.start()

    def notify_written(self, file: SegmentFile, number: int) -> None:
        """Record that all records up to ``number`` are written, the newest to ``file``; another file is retired."""
        with self._changed:
            if file is not self._file:
                if self._file is not None:
                    self._closed_files.append(self._file)
                self._file = file
                self._new = True
            self._written = number
            if not self._dirty:
                # Otherwise the thread knows, and naps until it may ask the disk again.
                self._dirty = True
                self._changed.notify()

    def when_durable(self, number: int, callback: Callable[[], None]) -> None:
        """Have the thread call ``callback`` once all records up to ``number`` are on the disk, in order."""
        with self._changed:
            heapq.heappush(self._waiting, (number, next(self._tie_breaker), callback))
            if self._has_due_callback():
                self._changed.notify()

    def pop_failure(self) -> JournalError | None:
        """Return what went wrong: for ever when the disk did, once when something else did."""
        if self._disk_error is not None:
            return self._disk_error
        failure, self._callback_error = self._callback_error, None
        return failure

    def close(self) -> None:
        """Bring everything to the disk and end the thread; files are closed."""
        with self._changed:
            self._closing = True
            if self._file is not None:
                self._closed_files.append(self._file)
                self._file = None
                self._dirty = True
            self._changed.notify()
        self._thread.join()
        for left in self._closed_files:
            os.close(left.handle)
        self._closed_files = []

    def _run(self) -> None:
        next_s = 0.0
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._dirty or self._closing or self._has_due_callback())
                # What is committed meanwhile goes to the disk with the same call.
                self._changed.wait_for(
                    lambda: self._closing or self._has_due_callback(), max(0.0, next_s - time.monotonic())
                )
                closing = self._closing
            self._run_due_callbacks()
            if self._dirty and (closing or time.monotonic() >= next_s):
                next_s = time.monotonic() + self._interval_s
                try:
                    self._sync()
                except OSError as error:
                    # After a failed fsync the system may have dropped the pages: asking again would lie.
                    self._disk_error = write_error(self._folder, error)
                    return
                self._run_due_callbacks()
            if closing:
                return

    def _has_due_callback(self) -> bool:
        return bool(self._waiting) and self._waiting[0][0] <= self.durable

    def _sync(self) -> None:
        with self._changed:
            written, file, closed_files, new = self._written, self._file, self._closed_files, self._new
            self._closed_files = []
            self._dirty = self._new = False
        try:
            for old in closed_files:
                os.fsync(old.handle)
            if file is not None:
                os.fsync(file.handle)
            if new:
                sync_folder(self._folder)
        finally:
            for old in closed_files:
                os.close(old.handle)
        with self._changed:
            self.durable = written
        if new:
            self._run_guarded(self._after_new_segment)

    def _run_due_callbacks(self) -> None:
        while True:
            with self._changed:
                if not self._has_due_callback():
                    return
                callback = heapq.heappop(self._waiting)[2]
            self._run_guarded(callback)

    def _run_guarded(self, call: Callable[[], None]) -> None:
        try:
            call()
        except Exception as error:  # noqa: BLE001 - others wait for their turn; the writer raises it
            self._callback_error = error if isinstance(error, JournalError) else _callback_failure(self._folder, error)


def _callback_failure(folder: Path, error: Exception) -> JournalError:
    failure = JournalError(f"{folder}: a callback of the journal failed ({type(error).__name__}: {error})")
    failure.__cause__ = error
    return failure
