"""Reader of tickfix's own event files: what a live run took in from one device, walk by walk.

A file ``NAME.events`` is a stream of MessagePack ``bin`` objects, each a canonical event of the wire
(docs/wire-protocol.md), in the order of arrival. ``tickfix compare --journal`` and :func:`write_events` make them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Final

import msgpack

from tickfix.api import Event, Floor, ReaderError, Recording, Truth
from tickfix.readers.input_files import RejectCounter
from tickfix.wire import WireError, decode_event, encode_event

EVENT_FILE_SUFFIX: Final = ".events"
_MAX_EVENT_BYTES: Final = 16 * 2**20


class EventFileReader:
    """Reads walks that a live run took in."""

    kind: ClassVar[str] = "reader"
    name: ClassVar[str] = "events"

    def recordings(self, path: Path) -> Sequence[Path]:
        """Return the event files at ``path``, a file or a folder, sorted by path."""
        if path.is_file():
            return [path] if path.suffix == EVENT_FILE_SUFFIX else []
        return sorted(file for file in path.rglob(f"*{EVENT_FILE_SUFFIX}") if file.is_file())

    def read(self, path: Path) -> Recording:
        """Read one walk; events that cannot be understood are counted in ``rejected``, and so is a broken end.

        Raises:
            ReaderError: when the file cannot be opened, or holds nothing that could be used.
        """
        rejects, events = RejectCounter(), []
        try:
            data = path.read_bytes()
        except OSError as error:
            raise ReaderError(f"{path}: {error.strerror or error}") from error
        for number, body in enumerate(_event_bodies(data, rejects), 1):
            try:
                events.append(decode_event(body))
            except WireError as error:
                rejects.add("no event", number, error)
        if not events:
            raise ReaderError(f"{path}: found {len(data)} bytes without an event; expected what a live run took in")
        floors = {event.floor for event in events if isinstance(event, Truth)}
        return Recording(
            name=path.name.removesuffix(EVENT_FILE_SUFFIX),
            floor=floors.pop() if len(floors) == 1 else "",
            events=tuple(events),
            rejected=MappingProxyType(rejects.counts),
            problems=rejects.problems,
            path=path,
        )

    def floor(self, path: Path) -> Floor | None:  # noqa: ARG002 - the interface
        """Return None: an event file knows no plan."""
        return None


def write_events(path: Path, events: Iterable[Event]) -> None:
    """Write an event file.

    Raises:
        OSError: when it cannot be written.
    """
    with path.open("wb") as file:
        for event in events:
            file.write(msgpack.packb(encode_event(event), use_bin_type=True))


def _event_bodies(data: bytes, rejects: RejectCounter) -> Iterable[bytes]:
    unpacker: Any = msgpack.Unpacker(max_buffer_size=max(len(data), 1), max_bin_len=_MAX_EVENT_BYTES)
    unpacker.feed(data)
    number = 0
    try:
        for number, body in enumerate(unpacker, 1):
            if isinstance(body, bytes):
                yield body
            else:
                rejects.add("no bytes", number, type(body).__name__)
    except (ValueError, msgpack.UnpackException) as error:
        rejects.add("broken", number + 1, f"{type(error).__name__} at byte {unpacker.tell()}: {error}")
    if unpacker.tell() < len(data) and not rejects.counts.get("broken"):
        rejects.add("cut", number + 1, f"{len(data) - unpacker.tell()} bytes that are no whole event")
