"""Finds the recordings in files and folders with the registered readers, and reads them in parallel."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from tickfix.api import Reader, ReaderError, Recording, Source
from tickfix.api.sources import check_declared
from tickfix.registry import Offer, Registry
from tickfix.replay.process_pool import parallel_map

Progress: TypeAlias = Callable[[str, int, int], None]
"""Called with the name of the task, how much of it is done, and the total."""

_TICKFIX = "tickfix"


def no_progress(what: str, done: int, total: int) -> None:
    """Report nothing."""


@dataclass(frozen=True, slots=True)
class RecordingFile:
    """A file and the reader that takes it for a recording; ``sources`` are those whose columns are checked."""

    path: Path
    name: str
    reader: Reader
    sources: tuple[Source, ...] = ()

    def read(self) -> Recording:
        """Read the file.

        Raises:
            ReaderError: when nothing of it can be read, or the reader fails or gives a declared source other columns.
        """
        try:
            recording = self.reader.read(self.path)
            declared = {source.name: source for source in self.sources}
            for event in recording.events if declared else ():
                check_declared(event, declared)
        except ReaderError:
            raise
        except Exception as error:
            problem = f"reader '{self.name}' failed: {type(error).__name__}: {error}"
            raise ReaderError(f"{self.path}: {problem}") from error
        return recording


@dataclass(frozen=True, slots=True, eq=False)
class LoadedRecording:
    """A recording that is in memory, where a file is expected."""

    recording: Recording

    @property
    def path(self) -> Path:
        """The file that it was read from; its name alone where there is none."""
        return self.recording.path or Path(self.recording.name)

    @property
    def name(self) -> str:
        """What stands for the name of a reader."""
        return "memory"

    def read(self) -> Recording:
        """Return the recording."""
        return self.recording


@dataclass(frozen=True, slots=True)
class FoundRecordings:
    """Recordings in the order they were found, each once, and what was wrong with readers."""

    sources: tuple[RecordingFile, ...]
    problems: tuple[str, ...] = ()


def find_recordings(paths: Sequence[Path], registry: Registry) -> FoundRecordings:
    """Find the recordings at ``paths``, files and folders, with the readers of ``registry``.

    A file that several readers take is read by tickfix's own reader, else by the first by name.

    Raises:
        ReaderError: for a path that does not exist or that no reader recognises.
    """
    readers, problems = _build_readers(registry)
    sources: dict[Path, RecordingFile] = {}
    for path in paths:
        if not path.exists():
            raise ReaderError(f"{path}: found no such file or folder")
        claimed: dict[Path, RecordingFile] = {}
        for name, reader in readers:
            try:
                files = reader.recordings(path)
            except Exception as error:  # noqa: BLE001 - whatever a reader raises, it must not disturb the others
                problems.append(f"reader '{name}' failed on {path}: {type(error).__name__}: {error}; it is left out")
                continue
            for file in files:
                claimed.setdefault(file.resolve(), RecordingFile(file, name, reader, tuple(registry.sources.values())))
        if not claimed:
            names = ", ".join(name for name, _ in readers) or "none is installed"
            raise ReaderError(f"{path}: found no recording that a reader recognises (readers: {names})")
        for resolved in sorted(claimed):
            sources.setdefault(resolved, claimed[resolved])
    return FoundRecordings(tuple(sources.values()), tuple(dict.fromkeys(problems)))


def read_recordings(
    sources: Sequence[RecordingFile], progress: Progress = no_progress, *, processes: int | None = None
) -> Iterator[Recording | ReaderError]:
    """Read recordings on all cores, in their order; one that cannot be read gives its error instead."""
    progress("reading", 0, len(sources))
    for done, recording in enumerate(parallel_map(_read_or_error, sources, processes=processes), start=1):
        progress("reading", done, len(sources))
        yield recording


def _read_or_error(source: RecordingFile) -> Recording | ReaderError:
    try:
        return source.read()
    except ReaderError as error:
        return error


def _build_readers(registry: Registry) -> tuple[list[tuple[str, Reader]], list[str]]:
    readers, problems = [], []
    for offer in sorted(registry.of_kind("reader"), key=_tickfix_first):
        try:
            readers.append((offer.name, offer.cls()))
        except Exception as error:  # noqa: BLE001 - a reader that cannot be built is left out, by name
            problems.append(f"reader '{offer.name}' cannot be built: {type(error).__name__}: {error}; it is left out")
    return readers, problems


def _tickfix_first(offer: Offer) -> tuple[bool, str]:
    return (offer.distribution != _TICKFIX, offer.name)
