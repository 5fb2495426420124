"""Dropping old segments."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tickfix.journal.errors import JournalError
from tickfix.journal.folder import segment_paths, sync_folder
from tickfix.journal.segment_reader import begins_with_snapshot
from tickfix.journal.settings import JournalSettings

_MB: Final = 1_000_000


def drop_old(folder: Path, settings: JournalSettings, wall_ns: int) -> tuple[Path, ...]:
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
        total_mb = sum(state.st_size for state in states) / _MB
        for path, state in list(zip(paths, states, strict=True))[:kept_from]:
            age_s = (wall_ns - state.st_mtime_ns) * 1e-9
            large = settings.keep_mb is not None and total_mb > settings.keep_mb
            old = settings.keep_s is not None and age_s > settings.keep_s
            if not (large or old):
                break
            path.unlink()
            dropped.append(path)
            total_mb -= state.st_size / _MB
        if dropped:
            sync_folder(folder)
    except OSError as error:
        raise JournalError(f"{error.filename or folder}: cannot be dropped ({error.strerror})") from error
    return tuple(dropped)
