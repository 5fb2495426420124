"""What can go wrong with a journal; each error names the file, and what to do."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Final

from tickfix.api.errors import TickfixError

_FULL: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


class JournalError(TickfixError):
    """A journal that cannot be written or read: names the file and the cause."""


class JournalFull(JournalError):  # noqa: N818 - a state that passes, like queue.Full
    """There is no room for what was to be written; what was written before is intact.

    Attributes:
        path: the segment that could not grow, or could not begin.
    """

    def __init__(self, path: Path, cause: OSError) -> None:
        super().__init__(f"{path}: no room for more ({cause.strerror}); what is in it stays intact: make room")
        self.path = path


class JournalLocked(JournalError):  # noqa: N818 - says what the folder is
    """Another process writes to the folder."""

    def __init__(self, folder: Path, holder: str) -> None:
        who = f"process {holder}" if holder else "another process"
        super().__init__(f"{folder}: {who} writes to this journal; stop it, or name another folder")
        self.folder = folder


class JournalDamaged(JournalError):  # noqa: N818 - says what the journal is
    """Records are missing from the middle of a journal, so that what follows cannot be replayed.

    Attributes:
        path, offset: the place where reading found it.
    """

    def __init__(self, path: Path, offset: int, what: str) -> None:
        super().__init__(f"{path}: at byte {offset}: {what}")
        self.path = path
        self.offset = offset


class JournalCrowded(JournalError):  # noqa: N818 - says what the process is
    """The process has no file descriptor left for another file; the one that is open can still be written."""


def write_error(path: Path, cause: OSError) -> JournalError:
    """Return the error that stands for a failed write."""
    if cause.errno in _FULL:
        return JournalFull(path, cause)
    kind = JournalCrowded if cause.errno in (errno.EMFILE, errno.ENFILE) else JournalError
    return kind(f"{path}: cannot be written ({cause.strerror or cause})")
