"""Repeating a run from its journal, estimate by estimate and byte by byte."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path

from tickfix.api import Estimate
from tickfix.config import build
from tickfix.drivers.live.errors import EngineError
from tickfix.drivers.live.replica import Replica
from tickfix.drivers.live.runs.manifests import config_of, disabled_in, site_of
from tickfix.drivers.live.runs.resuming import apply, restore
from tickfix.drivers.surveying import context_of
from tickfix.journal import Damage, JournalReader, Kind, Manifest, Record, Segment
from tickfix.kernel.probe import numeric_probe
from tickfix.plugins import Registry
from tickfix.site.folder import load as load_site
from tickfix.wire import decode_estimate, encode_estimate
from tickfix.wire.raw import FIELDS


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
                restore(replica, record)
        else:
            said = apply(replica, record)
        begun = True


@dataclass(slots=True)
class Repetition:
    """What became of repeating a journal.

    Attributes:
        run: its id.
        segments: repeated, each from its own snapshot.
        skipped: segments that cannot be repeated, and why.
        estimates, revisions: records compared.
        differences: how many came out differently.
        first: the first of them.
        published: SHA-256 of the bytes of all estimates of revision 0 as they came out now, in their order.
        damage: what could not be read.
        warnings: why bytes may differ here.
    """

    run: str
    segments: int = 0
    skipped: list[str] = field(default_factory=list)
    estimates: int = 0
    revisions: int = 0
    differences: int = 0
    first: Difference | None = None
    published: str = ""
    damage: list[Damage] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def repeat_journal(
    folder: Path,
    registry: Registry,
    *,
    site: Path | None = None,
    progress: Callable[[str, int, int], None] = lambda *_: None,
) -> Repetition:
    """Repeat the newest run of a journal, each segment from its own snapshot.

    Args:
        folder: of the journal.
        registry: the plugins installed here.
        site: the site's folder, if it is not where the journal says.
        progress: told how many segments of how many are done.

    Raises:
        TickfixError: when journal, site or configuration cannot be read.
    """
    segments = [s for s in JournalReader(folder).segments() if s.manifest is not None]
    if not segments or segments[-1].manifest is None:
        raise EngineError(f"{folder}: no segment has an intact manifest")
    run = segments[-1].manifest.run
    result, digest = Repetition(run), sha256()
    chosen = [s for s in segments if s.manifest is not None and s.manifest.run == run]
    for n, segment in enumerate(chosen):
        progress("repeating", n, len(chosen))
        if segment.replayable:
            _repeat_segment(segment, registry, site, result, digest.update)
        else:
            result.skipped.append(f"{segment.path}: begins neither with a snapshot nor with the run")
    progress("repeating", len(chosen), len(chosen))
    result.published = digest.hexdigest()
    return result


def _repeat_segment(
    segment: Segment, registry: Registry, site: Path | None, result: Repetition, published: Callable[[bytes], None]
) -> None:
    assert segment.manifest is not None  # noqa: S101 - chosen for it
    replica = _replica(segment.manifest, registry, site)
    if segment.manifest.probe != numeric_probe():
        result.warnings.append(f"{segment.path}: made where arithmetic has other last bits; bytes may differ here")
    records = JournalReader(segment.path).records(on_damage=result.damage.append)
    result.segments += 1
    for record, repeated, difference in repeat(records, replica):
        if difference is not None:
            result.differences += 1
            result.first = result.first or difference
        if repeated is not None and repeated.revision == 0:
            published(encode_estimate(repeated))
        result.estimates += record.kind is Kind.ESTIMATE
        result.revisions += record.kind is Kind.REVISION


def _replica(manifest: Manifest, registry: Registry, place: Path | None) -> Replica:
    config = config_of(manifest, registry)
    site = load_site(site_of(manifest) if place is None else place)
    disabled = disabled_in(manifest)
    pipelines = [
        pipeline
        for pipeline in build(config.pipelines, context_of(site), site.models)
        if not any(stage.key in disabled for stage in pipeline.stages)
    ]
    return Replica(pipelines, replace(config.kernel, seed=manifest.seed))


def _difference(record: Record, repeated: Estimate | None) -> Difference | None:
    body = b"" if repeated is None else encode_estimate(repeated)
    if body == record.payload:
        return None
    journaled = decode_estimate(record.payload)
    if repeated is None:
        return Difference(record.number, journaled, None, ())
    one, other = FIELDS.decode(record.payload), FIELDS.decode(body)
    names = tuple(name for name in Estimate.__dataclass_fields__ if bytes(one.get(name, b"")) != bytes(other[name]))
    return Difference(record.number, journaled, repeated, names or ("bytes",))
