"""A journal's folder: names of segments, and the lock of the one who writes."""

from __future__ import annotations

import fcntl
import os
import re
from pathlib import Path
from typing import Final

from tickfix.journal.errors import JournalError, JournalLocked

_NAME: Final = re.compile(r"(\d{6,})\.mcap")
_LOCK: Final = "lock"
UNBORN: Final = ".new"
"""Ending of a segment whose beginning is not yet written."""


def segment_path(folder: Path, index: int) -> Path:
    """Return the place of a segment; segments count from 1."""
    return folder / f"{index:06d}.mcap"


def segment_index(path: Path) -> int:
    """Return which segment of its folder a file is; 0 where its name is not a segment's."""
    match = _NAME.fullmatch(path.name)
    return int(match[1]) if match else 0


def segment_paths(folder: Path) -> tuple[Path, ...]:
    """Return the segments in their order.

    Raises:
        JournalError: when there is no such folder.
    """
    try:
        found = [path for path in folder.iterdir() if segment_index(path)]
    except OSError as error:
        raise JournalError(f"{folder}: no readable folder ({error.strerror}); expected a journal's") from error
    return tuple(sorted(found, key=segment_index))


def clear_unborn(folder: Path) -> None:
    """Remove segments whose writer died before they had a beginning; the caller has the lock."""
    for path in folder.glob(f"*.mcap{UNBORN}"):
        path.unlink()


def make_folder(folder: Path) -> None:
    """Make the folder, and see that it outlives a loss of power.

    Raises:
        JournalError: when it cannot be made.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path in missing:
            sync_folder(path.parent)
    except OSError as error:
        raise JournalError(f"{folder}: cannot be a journal's folder ({error.strerror})") from error


def sync_folder(folder: Path) -> None:
    """Wait until the folder's names are on the disk."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


class FolderLock:
    """The right to write to a folder; the system takes it back when the process dies.

    It goes with an open file (``flock``): a child that was forked, not spawned, shares it until it ends.
    """

    def __init__(self, folder: Path) -> None:
        """Take the lock.

        Raises:
            JournalLocked: when another writer has it.
        """
        try:
            handle = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise JournalError(f"{folder / _LOCK}: cannot be opened ({error.strerror})") from error
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(handle, 32, 0).decode("ascii", "replace").strip()
            os.close(handle)
            raise JournalLocked(folder, holder) from None
        os.ftruncate(handle, 0)
        try:
            os.pwrite(handle, f"{os.getpid()}\n".encode(), 0)
        except OSError:
            # On a full disk the lock is as good without the name of its holder.
            os.ftruncate(handle, 0)
        self._handle = handle

    def release(self) -> None:
        """Give the lock back."""
        os.close(self._handle)


def is_being_written(folder: Path) -> bool:
    """Tell whether a writer has the folder's lock."""
    try:
        handle = os.open(folder / _LOCK, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False
