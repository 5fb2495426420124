"""The thread that waits for the disk, so that the loop never does."""

from __future__ import annotations

import heapq
import itertools
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

from tickfix.journal.errors import JournalError, write_error
from tickfix.journal.folder import sync_folder
from tickfix.journal.segment_file import SegmentFile


class DiskThread:
    """Brings what was written to the disk at most every ``interval_s``, in its order, and says so.

    Args:
        folder: whose names are brought to the disk when a segment is new.
        written: number of the newest record that is in older segments.
        after_new_segment: called when a new segment's beginning is on the disk.
    """

    def __init__(self, folder: Path, interval_s: float, written: int, after_new_segment: Callable[[], None]) -> None:
        """Start the thread."""
        self.durable = written
        self._broken: JournalError | None = None
        self._complaint: JournalError | None = None
        self._folder = folder
        self._interval_s = interval_s
        self._after_new_segment = after_new_segment
        self._changed = threading.Condition()
        self._written = written
        self._file: SegmentFile | None = None
        self._retired: list[SegmentFile] = []
        self._new = self._dirty = self._closing = False
        self._waiting: list[tuple[int, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._thread = threading.Thread(target=self._run, name="tickfix-journal-disk", daemon=True)
        self._thread.start()

    def wrote(self, file: SegmentFile, number: int) -> None:
        """Tell that all records up to ``number`` are written, the newest to ``file``; another file is retired."""
        with self._changed:
            if file is not self._file:
                if self._file is not None:
                    self._retired.append(self._file)
                self._file = file
                self._new = True
            self._written = number
            if not self._dirty:
                # Otherwise the thread knows, and naps until it may ask the disk again.
                self._dirty = True
                self._changed.notify()

    def when_durable(self, number: int, then: Callable[[], None]) -> None:
        """Have ``then`` called, by the thread, once all records up to ``number`` are on the disk; in their order."""
        with self._changed:
            heapq.heappush(self._waiting, (number, next(self._order), then))
            if self._due():
                self._changed.notify()

    def take_failure(self) -> JournalError | None:
        """Return what went wrong: for ever when the disk did, once when something else did."""
        if self._broken is not None:
            return self._broken
        failure, self._complaint = self._complaint, None
        return failure

    def close(self) -> None:
        """Bring everything to the disk and end the thread; files are closed."""
        with self._changed:
            self._closing = True
            if self._file is not None:
                self._retired.append(self._file)
                self._file = None
                self._dirty = True
            self._changed.notify()
        self._thread.join()
        for left in self._retired:
            os.close(left.handle)
        self._retired = []

    def _run(self) -> None:
        next_s = 0.0
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._dirty or self._closing or self._due())
                # What is committed meanwhile goes to the disk with the same call.
                self._changed.wait_for(lambda: self._closing or self._due(), max(0.0, next_s - time.monotonic()))
                ending = self._closing
            self._call_due()
            if self._dirty and (ending or time.monotonic() >= next_s):
                next_s = time.monotonic() + self._interval_s
                try:
                    self._bring_to_disk()
                except OSError as error:
                    # After a failed fsync the system may have dropped the pages: asking again would lie.
                    self._broken = write_error(self._folder, error)
                    return
                self._call_due()
            if ending:
                return

    def _due(self) -> bool:
        return bool(self._waiting) and self._waiting[0][0] <= self.durable

    def _bring_to_disk(self) -> None:
        with self._changed:
            written, file, retired, new = self._written, self._file, self._retired, self._new
            self._retired = []
            self._dirty = self._new = False
        try:
            for old in retired:
                os.fsync(old.handle)
            if file is not None:
                os.fsync(file.handle)
            if new:
                sync_folder(self._folder)
        finally:
            for old in retired:
                os.close(old.handle)
        with self._changed:
            self.durable = written
        if new:
            self._guarded(self._after_new_segment)

    def _call_due(self) -> None:
        while True:
            with self._changed:
                if not self._due():
                    return
                then = heapq.heappop(self._waiting)[2]
            self._guarded(then)

    def _guarded(self, call: Callable[[], None]) -> None:
        try:
            call()
        except Exception as error:  # noqa: BLE001 - others wait for their turn; the writer raises it
            self._complaint = error if isinstance(error, JournalError) else _unexpected(self._folder, error)


def _unexpected(folder: Path, error: Exception) -> JournalError:
    failure = JournalError(f"{folder}: a callback of the journal failed ({type(error).__name__}: {error})")
    failure.__cause__ = error
    return failure
