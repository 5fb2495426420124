"""A journal's folder: settings, errors, names of segments, and the writer's lock."""

from __future__ import annotations

import errno
import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Final

from tickfix.api.errors import ConfigError, TickfixError

try:
    import fcntl
except ImportError:  # Windows: journals can be read there, not written
    fcntl = None  # type: ignore[assignment]

_NO_SPACE_ERRNOS: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


class JournalError(TickfixError):
    """A journal that cannot be written or read: names the file and the cause."""

    kind: ClassVar[str] = "journal"


class JournalFull(JournalError):  # noqa: N818 - a state that passes, like queue.Full
    """There is no room for what was to be written; what was written before is intact.

    Attributes:
        path: the segment that could not grow, or could not begin.
    """

    kind: ClassVar[str] = "journal_full"

    def __init__(self, path: Path, cause: OSError) -> None:
        super().__init__(f"{path}: no room for more ({cause.strerror}); what is in it stays intact: make room")
        self.path = path


class JournalLocked(JournalError):  # noqa: N818 - says what the folder is
    """Another process writes to the folder."""

    kind: ClassVar[str] = "journal_locked"

    def __init__(self, folder: Path, holder: str) -> None:
        who = f"process {holder}" if holder else "another process"
        super().__init__(f"{folder}: {who} writes to this journal; stop it, or name another folder")
        self.folder = folder


class JournalDamaged(JournalError):  # noqa: N818 - says what the journal is
    """Records are missing from the middle of a journal, so that what follows cannot be replayed.

    Attributes:
        path, offset: the place where reading found it.
    """

    kind: ClassVar[str] = "journal_damaged"

    def __init__(self, path: Path, offset: int, what: str) -> None:
        super().__init__(f"{path}: at byte {offset}: {what}")
        self.path = path
        self.offset = offset


class JournalOutOfDescriptors(JournalError):  # noqa: N818 - says what the process is
    """The process has no file descriptor left for another file; the one that is open can still be written."""

    kind: ClassVar[str] = "journal_out_of_descriptors"


def write_error(path: Path, cause: OSError) -> JournalError:
    """Return the error that stands for a failed write."""
    if cause.errno in _NO_SPACE_ERRNOS:
        return JournalFull(path, cause)
    kind = JournalOutOfDescriptors if cause.errno in (errno.EMFILE, errno.ENFILE) else JournalError
    return kind(f"{path}: cannot be written ({cause.strerror or cause})")


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalSettings:
    """How a journal is cut into segments, when it is on the disk, and how much of it is kept.

    Attributes:
        sync_ms: how long what is committed may wait for the disk; a loss of power loses at most this and the time
            that the disk takes. The death of the process loses nothing that is committed.
        segment_mb, segment_s: size and age at which a new segment is wanted.
        keep_mb, keep_s: old segments are dropped when the folder holds more than this, or when they were last written
            longer ago; None keeps them. The newest segment that begins with a snapshot, and what follows, always stay.
    """

    sync_ms: float = 50.0
    segment_mb: float = 64.0
    segment_s: float = 900.0
    keep_mb: float | None = None
    keep_s: float | None = None

    def __post_init__(self) -> None:
        """Check that every limit is one.

        Raises:
            ConfigError: naming the setting.
        """
        for name in self.__slots__:
            value = getattr(self, name)
            if name == "sync_ms" and not value >= 0:
                raise ConfigError("journal.sync_ms", repr(value), "a number ≥ 0")
            if name != "sync_ms" and value is not None and not value > 0:
                raise ConfigError(f"journal.{name}", repr(value), "a number > 0")


_SEGMENT_NAME: Final = re.compile(r"(\d{6,})\.mcap")
_LOCK_FILE: Final = "lock"
TEMPORARY_SUFFIX: Final = ".new"
"""Ending of a segment whose beginning is not yet written."""


def segment_path(folder: Path, index: int) -> Path:
    """Return the place of a segment; segments count from 1."""
    return folder / f"{index:06d}.mcap"


def segment_index(path: Path) -> int:
    """Return which segment of its folder a file is; 0 where its name is not a segment's."""
    match = _SEGMENT_NAME.fullmatch(path.name)
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


def remove_temporary_segments(folder: Path) -> None:
    """Remove segments whose writer died before they had a beginning; the caller has the lock."""
    for path in folder.glob(f"*.mcap{TEMPORARY_SUFFIX}"):
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
            JournalError: where the system has no ``fcntl``, or the lock file cannot be opened.
        """
        if fcntl is None:
            raise JournalError(f"{folder}: writing a journal needs fcntl, which this system ({sys.platform}) lacks")
        try:
            handle = os.open(folder / _LOCK_FILE, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise JournalError(f"{folder / _LOCK_FILE}: cannot be opened ({error.strerror})") from error
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
    """Return whether a writer holds the folder's lock; False where the system has no such locks and so no writers."""
    if fcntl is None:
        return False
    try:
        handle = os.open(folder / _LOCK_FILE, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False
