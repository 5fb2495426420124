"""A journal after the run.

Replayed and compared estimate by estimate, byte by byte, or written out as walks that can be surveyed, replayed and
compared like any recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from urllib.parse import quote

from tickfix.api import Estimate, Event
from tickfix.config import Config, build_pipelines
from tickfix.journal import JournalReader, JournalRecord, RecordKind, RunManifest, SegmentDamage, SegmentInfo
from tickfix.kernel.determinism import numeric_probe
from tickfix.live.protocol import EngineError
from tickfix.live.recovery import (
    apply_record,
    disabled_stages,
    manifest_config,
    manifest_site,
    newest_manifest,
    restore_snapshot,
)
from tickfix.live.replica import Replica
from tickfix.readers.event_file import EVENT_FILE_SUFFIX, write_events
from tickfix.registry import Registry
from tickfix.replay.site_survey import site_context
from tickfix.site import load_site
from tickfix.wire import decode_estimate, decode_event, encode_estimate
from tickfix.wire.engine_messages import FinishDevice, decode_decision
from tickfix.wire.validation import MAP_DECODER


@dataclass(frozen=True, slots=True)
class EstimateDifference:
    """The first estimate that a repetition says differently.

    Attributes:
        number: of the record.
        journaled, replayed: what the journal has and what came out now; None where one of them says nothing.
        fields: names of what differs.
    """

    number: int
    journaled: Estimate | None
    replayed: Estimate | None
    fields: tuple[str, ...]

    def __str__(self) -> str:
        """Return a sentence that names record, device, tick, pipeline and what differs."""
        produced = self.journaled or self.replayed
        if produced is None:
            return f"record {self.number}"
        at = f"epoch {produced.epoch}, tick {produced.tick}"
        where = f"record {self.number}, device {produced.device!r}, {at}, {produced.pipeline}"
        if self.replayed is None:
            return f"{where}: the journal has an estimate that the repetition does not make"
        if self.journaled is None:
            return f"{where}: the repetition makes an estimate that the journal does not have"
        stages = self.replayed.failed_by or self.journaled.failed_by
        return f"{where}: {', '.join(self.fields)} differ" + (f" (failed: {stages})" if stages else "")


def replay_records(
    records: Iterator[JournalRecord], replica: Replica
) -> Iterator[tuple[JournalRecord, Estimate | None, EstimateDifference | None]]:
    """Apply a journal's records and compare every estimate with what comes out now, byte by byte.

    Yields:
        Each estimate's record, what came out now, and the difference if there is one.
    """
    produced: list[Estimate] = []
    started = False
    for record in records:
        if record.kind in (RecordKind.ESTIMATE, RecordKind.REVISION):
            if not started:
                continue
            replayed = produced.pop(0) if produced else None
            yield record, replayed, _compare_estimate(record, replayed)
            continue
        if produced:
            yield record, produced[0], EstimateDifference(record.number, None, produced[0], ())
            produced = []
        if record.kind is RecordKind.SNAPSHOT:
            if not started:
                restore_snapshot(replica, record)
        else:
            produced = apply_record(replica, record)
        started = True


@dataclass(slots=True)
class JournalReplay:
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
    first: EstimateDifference | None = None
    published: str = ""
    damage: list[SegmentDamage] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def replay_journal(
    folder: Path,
    registry: Registry,
    *,
    site: Path | None = None,
    progress: Callable[[str, int, int], None] = lambda *_: None,
) -> JournalReplay:
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
    result, digest = JournalReplay(run), sha256()
    chosen = [s for s in segments if s.manifest is not None and s.manifest.run == run]
    for n, segment in enumerate(chosen):
        progress("replaying", n, len(chosen))
        if segment.replayable:
            _replay_segment(segment, registry, site, result, digest.update)
        else:
            result.skipped.append(f"{segment.path}: begins neither with a snapshot nor with the run")
    progress("replaying", len(chosen), len(chosen))
    result.published = digest.hexdigest()
    return result


def _replay_segment(
    segment: SegmentInfo,
    registry: Registry,
    site: Path | None,
    result: JournalReplay,
    published: Callable[[bytes], None],
) -> None:
    assert segment.manifest is not None  # noqa: S101 - chosen for it
    replica = _build_replica(segment.manifest, registry, site)
    if segment.manifest.probe != numeric_probe():
        result.warnings.append(f"{segment.path}: made where arithmetic has other last bits; bytes may differ here")
    records = JournalReader(segment.path).records(on_damage=result.damage.append)
    result.segments += 1
    for record, replayed, difference in replay_records(records, replica):
        if difference is not None:
            result.differences += 1
            result.first = result.first or difference
        if replayed is not None and replayed.revision == 0:
            published(encode_estimate(replayed))
        result.estimates += record.kind is RecordKind.ESTIMATE
        result.revisions += record.kind is RecordKind.REVISION


def _build_replica(manifest: RunManifest, registry: Registry, place: Path | None) -> Replica:
    config = manifest_config(manifest, registry)
    site = load_site(manifest_site(manifest) if place is None else place)
    disabled = disabled_stages(manifest)
    pipelines = [
        pipeline
        for pipeline in build_pipelines(config.pipelines, site_context(site), site.models)
        if not any(stage.key in disabled for stage in pipeline.stages)
    ]
    return Replica(pipelines, replace(config.kernel, seed=manifest.seed))


def _compare_estimate(record: JournalRecord, replayed: Estimate | None) -> EstimateDifference | None:
    body = b"" if replayed is None else encode_estimate(replayed)
    if body == record.payload:
        return None
    journaled = decode_estimate(record.payload)
    if replayed is None:
        return EstimateDifference(record.number, journaled, None, ())
    one, other = MAP_DECODER.decode(record.payload), MAP_DECODER.decode(body)
    names = tuple(
        name for name in Estimate.__dataclass_fields__ if bytes(one.get(name, b"")) != bytes(other.get(name, b""))
    )
    return EstimateDifference(record.number, journaled, replayed, names or ("bytes",))


def write_walks(journal: Path, folder: Path) -> tuple[Path, ...]:
    """Write what a journal's newest run took in, a file a device, and a further one each time a device came back.

    Damaged parts of the journal are left out.

    Raises:
        JournalError: when nothing of it can be read.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, events in journaled_walks(JournalReader(journal).records(on_damage=lambda _: None)):
        path = folder / f"{quote(name, safe=' ')}{EVENT_FILE_SUFFIX}"
        write_events(path, events)
        written.append(path)
    return tuple(sorted(written))


def journaled_site(journal: Path) -> Path:
    """Return the folder of the site that the journal's newest run served.

    Raises:
        TickfixError: when there is no intact manifest.
    """
    return manifest_site(newest_manifest(journal))


def journaled_config(journal: Path, registry: Registry) -> Config:
    """Return the configuration of the journal's newest run.

    Raises:
        TickfixError: when there is no intact manifest, or its configuration cannot be used here.
    """
    return manifest_config(newest_manifest(journal), registry)


def journaled_walks(records: Iterable[JournalRecord]) -> Iterator[tuple[str, list[Event]]]:
    """Yield name and events of each walk, when it ends: with the device's goodbye, its silence, or the run."""
    open_walks: dict[str, list[Event]] = {}
    counts: dict[str, int] = {}

    def closed(device: str) -> tuple[str, list[Event]]:
        counts[device] = counts.get(device, 0) + 1
        name = device if counts[device] == 1 else f"{device}-{counts[device]}"
        return name, on_device_clock([replace(event, device=name) for event in open_walks.pop(device)])

    for record in records:
        if record.kind is RecordKind.EVENT:
            event = decode_event(record.payload)
            open_walks.setdefault(event.device, []).append(event)
        elif record.kind is RecordKind.DECISION:
            decision = decode_decision(record.payload)
            if isinstance(decision, FinishDevice) and decision.device in open_walks:
                yield closed(decision.device)
    for device in list(open_walks):
        yield closed(device)


def on_device_clock(events: list[Event]) -> list[Event]:
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
