"""Recordings: what a reader makes of files on disk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Protocol

from tickfix.api.events import Event, Truth
from tickfix.api.site import Floor
from tickfix.api.values import Estimate


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Recording:
    """One walk as it was recorded.

    Attributes:
        name: the file's name without extensions; also the device that the events speak of.
        floor: where it was walked, empty when the walk changes floors or the recording has no floor.
        events: in the order they were logged; truth among them.
        rejected: what could not be used, counted by reason.
        problems: the first few of these, each with its line and what was found there.
        path: where it was read from, None for a simulated walk.
    """

    name: str
    floor: str
    events: tuple[Event, ...]
    rejected: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    problems: tuple[str, ...] = ()
    path: Path | None = None

    @property
    def truth(self) -> tuple[Truth, ...]:
        """The waypoints in the order of their time."""
        return tuple(sorted((e for e in self.events if isinstance(e, Truth)), key=lambda e: e.t_ns))


class Reader(Protocol):
    """Reads one format of recordings. A plugin of kind ``reader``; built without arguments."""

    kind: ClassVar[str]
    name: ClassVar[str]

    def recordings(self, path: Path) -> Sequence[Path]:
        """Return the files of this format at ``path``, a file or a folder, sorted by name; empty if there are none."""
        ...

    def read(self, path: Path) -> Recording:
        """Read one file; broken lines are counted in the result.

        Raises:
            ReaderError: when nothing of the file can be read.
        """
        ...

    def floor(self, path: Path) -> Floor | None:
        """Return the plan of the floor that the recording at ``path`` was walked on, None where none is stored."""
        ...


class Sink(Protocol):
    """Writes estimates somewhere. A plugin of kind ``sink``; built as ``Sink(path)``, chosen by the path's ending."""

    kind: ClassVar[str]
    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]

    def __init__(self, path: Path) -> None: ...

    def write(self, estimate: Estimate) -> None:
        """Take one estimate; they come in the order of their ticks."""
        ...

    def close(self) -> None:
        """Finish what was written. Nothing is there under the path before."""
        ...

    def discard(self) -> None:
        """Drop what was written, because the run broke off."""
        ...
