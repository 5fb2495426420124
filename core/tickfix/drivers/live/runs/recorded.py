"""A journal's devices as walks: what a live run took in, to be surveyed, replayed and compared like any recording."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

from tickfix.api import Event
from tickfix.config import Config
from tickfix.drivers.live.runs.manifests import config_of, manifest_of, site_of
from tickfix.journal import JournalReader, Kind, Record
from tickfix.plugins import Registry
from tickfix.readers.event_file import SUFFIX, write_events
from tickfix.wire import decode_event
from tickfix.wire.decisions import Finish, decode_decision


def write_walks(journal: Path, folder: Path) -> tuple[Path, ...]:
    """Write what a journal's newest run took in, a file a device, and a further one each time a device came back.

    Damaged parts of the journal are left out.

    Raises:
        JournalError: when nothing of it can be read.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, events in walks(JournalReader(journal).records(on_damage=lambda _: None)):
        path = folder / f"{quote(name, safe=' ')}{SUFFIX}"
        write_events(path, events)
        written.append(path)
    return tuple(sorted(written))


def journaled_site(journal: Path) -> Path:
    """Return the folder of the site that the journal's newest run served.

    Raises:
        TickfixError: when there is no intact manifest.
    """
    return site_of(manifest_of(journal))


def journaled_config(journal: Path, registry: Registry) -> Config:
    """Return the configuration of the journal's newest run.

    Raises:
        TickfixError: when there is no intact manifest, or its configuration cannot be used here.
    """
    return config_of(manifest_of(journal), registry)


def walks(records: Iterable[Record]) -> Iterator[tuple[str, list[Event]]]:
    """Yield name and events of each walk, when it ends: with the device's goodbye, its silence, or the run."""
    open_walks: dict[str, list[Event]] = {}
    counts: dict[str, int] = {}

    def closed(device: str) -> tuple[str, list[Event]]:
        counts[device] = counts.get(device, 0) + 1
        name = device if counts[device] == 1 else f"{device}-{counts[device]}"
        return name, on_own_clock([replace(event, device=name) for event in open_walks.pop(device)])

    for record in records:
        if record.kind is Kind.EVENT:
            event = decode_event(record.payload)
            open_walks.setdefault(event.device, []).append(event)
        elif record.kind is Kind.DECISION:
            decision = decode_decision(record.payload)
            if isinstance(decision, Finish) and decision.device in open_walks:
                yield closed(decision.device)
    for device in list(open_walks):
        yield closed(device)


def on_own_clock(events: list[Event]) -> list[Event]:
    """Return the events with arrivals on the device's own clock, as in a recording: never before they were measured.

    The offset between the clocks is the smallest difference between arrival and measurement so far: no message arrives
    before it was sent.
    """
    result: list[Event] = []
    latest_ns, offset_ns = 0, 2**63
    for event in events:
        offset_ns = min(offset_ns, event.arrival_ns - event.t_ns)
        latest_ns = max(latest_ns, event.t_ns, event.arrival_ns - offset_ns)
        result.append(replace(event, arrival_ns=latest_ns))
    return result
