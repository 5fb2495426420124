"""Going on after a crash: what a journal holds, applied to a replica."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from tickfix.api import Estimate
from tickfix.drivers.live.errors import EngineError
from tickfix.drivers.live.folding import Feed, Folding, Step
from tickfix.drivers.live.replica import Replica
from tickfix.drivers.live.runs.manifests import manifest_of
from tickfix.journal import Damage, JournalReader, Kind, Manifest, Record, Since
from tickfix.wire import decode_estimate, decode_event
from tickfix.wire.decisions import decode_decision

_TOGETHER: Final = 256
"""Steps that are applied at once."""


@dataclass(slots=True)
class Resumed:
    """Where a run stood.

    Attributes:
        manifest: of its newest segment.
        next_number: of the next record.
        records: applied since the snapshot.
        last: the newest published estimate of each device and pipeline, as bytes.
        damage: what could not be read.
    """

    manifest: Manifest
    next_number: int
    records: int = 0
    last: dict[tuple[str, str], Record] = field(default_factory=dict)
    damage: list[Damage] = field(default_factory=list)


def resumable(folder: Path) -> str:
    """Return the id of the run that could be resumed.

    Raises:
        TickfixError: when there is none.
    """
    return manifest_of(folder).run


def resume(folder: Path, replica: Folding, alive: Callable[[], None]) -> Resumed:
    """Bring a replica to where the journal's newest run stood.

    Args:
        alive: called as a sign of life.

    Raises:
        JournalError: when the run cannot be repeated from what is left of the journal.
        EngineError: when the journal's run had another seed or horizon.
    """
    resumed = Resumed(manifest_of(folder), 1)
    begun = False
    steps: list[Step] = []
    for record in JournalReader(folder).records(Since.REPLAYABLE, on_damage=resumed.damage.append):
        alive()
        resumed.next_number = record.number + 1
        resumed.records += 1
        if record.kind is Kind.SNAPSHOT:
            if not begun:
                restore(replica, record)
        elif record.kind is Kind.ESTIMATE:
            estimate = decode_estimate(record.payload)
            resumed.last[estimate.device, estimate.pipeline] = record
        elif record.kind is Kind.EVENT:
            steps.append(Feed(record.number, decode_event(record.payload), record.payload))
        elif record.kind is Kind.DECISION:
            steps.append(decode_decision(record.payload))
        if len(steps) >= _TOGETHER:
            replica.apply(steps)
            steps = []
        begun = True
    replica.apply(steps)
    return resumed


def apply(replica: Replica, record: Record) -> list[Estimate]:
    """Apply an event or a decision; return what the kernel says, in the order in which the journal has it."""
    if record.kind is Kind.EVENT:
        replica.event(record.number, decode_event(record.payload))
        return []
    if record.kind is not Kind.DECISION:
        return []
    output, _ = replica.decide(decode_decision(record.payload))
    return [*output.revised, *output.published]


def restore(replica: Folding, record: Record) -> None:
    """Restore a replica from the record of a snapshot.

    Raises:
        EngineError: when it cannot be used.
    """
    try:
        replica.restore(record.payload)
    except ValueError as error:
        raise EngineError(f"the journal's snapshot (record {record.number}) cannot be used: {error}") from error
