"""Going on after a crash, and repeating a run: what a journal holds, applied to a replica."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tickfix.api import Estimate
from tickfix.drivers.live.errors import EngineError
from tickfix.drivers.live.replica import Replica
from tickfix.journal import Damage, JournalReader, Kind, Manifest, Record, Since
from tickfix.wire import decode_estimate, decode_event, encode_estimate
from tickfix.wire.decisions import decode_decision


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


def manifest_of(folder: Path) -> Manifest:
    """Return the manifest of a journal's newest segment that has one.

    Raises:
        JournalError: when there is no journal.
        EngineError: when no segment has an intact manifest.
    """
    manifests = [segment.manifest for segment in JournalReader(folder).segments() if segment.manifest is not None]
    if not manifests:
        raise EngineError(f"{folder}: no segment has an intact manifest, so nothing can be resumed")
    return manifests[-1]


def resume(folder: Path, replica: Replica, alive: Callable[[], None]) -> Resumed:
    """Bring a replica to where the journal's newest run stood.

    Args:
        alive: called as a sign of life.

    Raises:
        JournalError: when the run cannot be repeated from what is left of the journal.
        EngineError: when the journal's run had another seed or horizon.
    """
    resumed = Resumed(manifest_of(folder), 1)
    begun = False
    for record in JournalReader(folder).records(Since.REPLAYABLE, on_damage=resumed.damage.append):
        alive()
        resumed.next_number = record.number + 1
        resumed.records += 1
        if record.kind is Kind.SNAPSHOT:
            if not begun:
                _restore(replica, record)
        elif record.kind is Kind.ESTIMATE:
            estimate = decode_estimate(record.payload)
            resumed.last[estimate.device, estimate.pipeline] = record
        else:
            apply(replica, record)
        begun = True
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


@dataclass(frozen=True, slots=True)
class Difference:
    """The first estimate that a repetition says differently.

    Attributes:
        number: of the record.
        journaled, repeated: what the journal has and what came out now; None where one of them says nothing.
        fields: names of what differs.
    """

    number: int
    journaled: Estimate | None
    repeated: Estimate | None
    fields: tuple[str, ...]

    def __str__(self) -> str:
        """Return a sentence that names record, device, tick, pipeline and what differs."""
        said = self.journaled or self.repeated
        if said is None:
            return f"record {self.number}"
        where = f"record {self.number}, device {said.device!r}, epoch {said.epoch}, tick {said.tick}, {said.pipeline}"
        if self.repeated is None:
            return f"{where}: the journal has an estimate that the repetition does not make"
        if self.journaled is None:
            return f"{where}: the repetition makes an estimate that the journal does not have"
        stages = self.repeated.failed_by or self.journaled.failed_by
        return f"{where}: {', '.join(self.fields)} differ" + (f" (failed: {stages})" if stages else "")


def repeat(records: Iterator[Record], replica: Replica) -> Iterator[tuple[Record, Estimate | None, Difference | None]]:
    """Apply a journal's records and compare every estimate with what comes out now, byte by byte.

    Yields:
        Each estimate's record, what came out now, and the difference if there is one.
    """
    said: list[Estimate] = []
    begun = False
    for record in records:
        if record.kind in (Kind.ESTIMATE, Kind.REVISION):
            if not begun:
                continue
            repeated = said.pop(0) if said else None
            yield record, repeated, _difference(record, repeated)
            continue
        if said:
            yield record, said[0], Difference(record.number, None, said[0], ())
            said = []
        if record.kind is Kind.SNAPSHOT:
            if not begun:
                _restore(replica, record)
        else:
            said = apply(replica, record)
        begun = True


def _restore(replica: Replica, record: Record) -> None:
    try:
        replica.restore(record.payload)
    except ValueError as error:
        raise EngineError(f"the journal's snapshot (record {record.number}) cannot be used: {error}") from error


def _difference(record: Record, repeated: Estimate | None) -> Difference | None:
    if repeated is not None and encode_estimate(repeated) == record.payload:
        return None
    journaled = decode_estimate(record.payload)
    if repeated is None:
        return Difference(record.number, journaled, None, ())
    names = tuple(
        name
        for name in Estimate.__dataclass_fields__
        if repr(getattr(journaled, name)) != repr(getattr(repeated, name))
    )
    return Difference(record.number, journaled, repeated, names or ("bytes",))
