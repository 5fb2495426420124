"""Recordings on disk, whatever their format: the registry's readers say which are theirs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from tickfix.api import Reader, ReaderError, Recording
from tickfix.drivers.workers import spread
from tickfix.plugins import Offer, Registry

Progress: TypeAlias = Callable[[str, int, int], None]
"""Told what is being done, how much of it is done, and how much there is to do."""

_OWN = "tickfix"


def silent(what: str, done: int, total: int) -> None:
    """Tell nobody."""


@dataclass(frozen=True, slots=True)
class Source:
    """A file and the reader that takes it for a recording."""

    path: Path
    name: str
    reader: Reader

    def read(self) -> Recording:
        """Read the file.

        Raises:
            ReaderError: when nothing of it can be read, or the reader fails.
        """
        try:
            return self.reader.read(self.path)
        except ReaderError:
            raise
        except Exception as error:
            problem = f"reader '{self.name}' failed: {type(error).__name__}: {error}"
            raise ReaderError(f"{self.path}: {problem}") from error


@dataclass(frozen=True, slots=True)
class Found:
    """Recordings in the order they were found, each once, and what was wrong with readers."""

    sources: tuple[Source, ...]
    problems: tuple[str, ...] = ()


def find(paths: Sequence[Path], registry: Registry) -> Found:
    """Find the recordings at ``paths``, files and folders, with the readers of ``registry``.

    A file that several readers take is read by tickfix's own reader, else by the first by name.

    Raises:
        ReaderError: for a path that does not exist or that no reader recognises.
    """
    readers, problems = _readers(registry)
    sources: dict[Path, Source] = {}
    for path in paths:
        if not path.exists():
            raise ReaderError(f"{path}: found no such file or folder")
        claimed: dict[Path, Source] = {}
        for name, reader in readers:
            try:
                files = reader.recordings(path)
            except Exception as error:  # noqa: BLE001 - whatever a reader raises, it must not disturb the others
                problems.append(f"reader '{name}' failed on {path}: {type(error).__name__}: {error}; it is left out")
                continue
            for file in files:
                claimed.setdefault(file.resolve(), Source(file, name, reader))
        if not claimed:
            names = ", ".join(name for name, _ in readers) or "none is installed"
            raise ReaderError(f"{path}: found no recording that a reader recognises (readers: {names})")
        for resolved in sorted(claimed):
            sources.setdefault(resolved, claimed[resolved])
    return Found(tuple(sources.values()), tuple(dict.fromkeys(problems)))


def read_all(
    sources: Sequence[Source], progress: Progress = silent, *, processes: int | None = None
) -> Iterator[Recording | ReaderError]:
    """Read recordings on all cores, in their order; one that cannot be read gives its error instead."""
    progress("reading", 0, len(sources))
    for done, recording in enumerate(spread(_read, sources, processes=processes), start=1):
        progress("reading", done, len(sources))
        yield recording


def _read(source: Source) -> Recording | ReaderError:
    try:
        return source.read()
    except ReaderError as error:
        return error


def _readers(registry: Registry) -> tuple[list[tuple[str, Reader]], list[str]]:
    readers, problems = [], []
    for offer in sorted(registry.of_kind("reader"), key=_own_first):
        try:
            readers.append((offer.name, offer.cls()))
        except Exception as error:  # noqa: BLE001 - a reader that cannot be built is left out, by name
            problems.append(f"reader '{offer.name}' cannot be built: {type(error).__name__}: {error}; it is left out")
    return readers, problems


def _own_first(offer: Offer) -> tuple[bool, str]:
    return (offer.distribution != _OWN, offer.name)
