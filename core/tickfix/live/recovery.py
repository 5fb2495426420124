"""A run and its journal: the manifest of a new run, and how one goes on from its journal after its engine has ended."""

from __future__ import annotations

import logging
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Final, TypeVar

from tickfix.api import Estimate
from tickfix.api.errors import PortError
from tickfix.config import Config, parse_config
from tickfix.journal import (
    JournalLocked,
    JournalReader,
    JournalRecord,
    JournalSettings,
    JournalWriter,
    ReadStart,
    RecordKind,
    RunManifest,
    SegmentDamage,
)
from tickfix.kernel.determinism import numeric_probe
from tickfix.live.heartbeat import WatchdogHeartbeat
from tickfix.live.protocol import EngineError, Executor, FeedEvent, ReplicaStep
from tickfix.live.replica import Replica
from tickfix.live.serve_options import ServeOptions
from tickfix.ports import Publication
from tickfix.registry import Registry
from tickfix.version import __version__
from tickfix.wire import decode_estimate, decode_event
from tickfix.wire.engine_messages import decode_decision

_LOGGER = logging.getLogger(__name__)

_LOCK_TIMEOUT_S: Final = 3.0

T = TypeVar("T")


def retry_while_locked(attempt: Callable[[], T]) -> T:
    """Try for a while: the process that held ports and journal may be dying just now."""
    until = time.monotonic() + _LOCK_TIMEOUT_S
    while True:
        try:
            return attempt()
        except (PortError, JournalLocked):
            if time.monotonic() > until:
                raise
            time.sleep(0.05)


def new_manifest(options: ServeOptions, registry: Registry, run: str, before: RunManifest | None) -> RunManifest:
    """Return the manifest of a run that begins, or goes on from where ``before`` was written."""
    libraries = {name: version(name) for name in ("numpy", "scipy", "shapely", "pyzmq", "msgspec", "mcap")}
    return RunManifest(
        run=run,
        tickfix_version=__version__,
        config=options.config.text,
        seed=options.config.kernel.seed,
        probe=numeric_probe(),
        wall_start_ns=time.time_ns() if before is None else before.wall_start_ns,
        plugins=libraries | {offer.distribution: offer.version for offer in registry.offers if offer.distribution},
        notes={
            "site": str(options.site.resolve()),
            "boot": str(1 if before is None else boot_number(before) + 1),
            "pipelines": ",".join(p.name for p in options.config.pipelines),
            "disabled": "\n".join(f"{key}\t{why}" for key, why in sorted(options.disabled.items())),
        }
        | _tolerance_note(options),
    )


def _tolerance_note(options: ServeOptions) -> dict[str, str]:
    """Return a note of the stages whose batches are equal to single steps within a tolerance only, if any."""
    stages = {
        choice.offer.label: choice.offer.cls
        for p in options.config.pipelines
        for choice in (p.pdr, p.fingerprint, p.filter)
        if choice is not None
    }
    tolerances = {label: float(getattr(cls, "batch_tolerance", 0.0)) for label, cls in sorted(stages.items())}
    within = ",".join(f"{label}={tolerance:g}" for label, tolerance in tolerances.items() if tolerance)
    return {"batch_tolerance": within} if within else {}


def newest_manifest(folder: Path) -> RunManifest:
    """Return the manifest of a journal's newest segment that has one.

    Raises:
        JournalError: when there is no journal.
        EngineError: when no segment has an intact manifest.
    """
    manifests = [segment.manifest for segment in JournalReader(folder).segments() if segment.manifest is not None]
    if not manifests:
        raise EngineError(f"{folder}: no segment has an intact manifest, so nothing can be resumed")
    return manifests[-1]


def boot_number(manifest: RunManifest) -> int:
    """Return which engine of its run wrote this, from 1."""
    return int(manifest.notes.get("boot", "1"))


def manifest_site(manifest: RunManifest) -> Path:
    """Return the folder of the site that the run served."""
    return Path(manifest.notes["site"])


def manifest_config(manifest: RunManifest, registry: Registry) -> Config:
    """Return the run's configuration, with the pipelines that were chosen of it.

    Raises:
        ConfigError: when it cannot be used here.
    """
    config = parse_config(manifest.config, "the journal's configuration", registry)
    return config.only(manifest.notes["pipelines"].split(","))


def disabled_stages(manifest: RunManifest) -> frozenset[str]:
    """Return the keys of the stages that had to be left out."""
    lines = manifest.notes.get("disabled", "").split("\n")
    return frozenset(line.split("\t")[0] for line in lines if line)


_STEPS_PER_BATCH: Final = 256
"""Steps that are applied at once."""


@dataclass(slots=True)
class ResumedRun:
    """Where a run stood.

    Attributes:
        manifest: of its newest segment.
        next_number: of the next record.
        records: applied since the snapshot.
        last_estimates: the newest published estimate of each device and pipeline, as bytes.
        damage: what could not be read.
    """

    manifest: RunManifest
    next_number: int
    records: int = 0
    last_estimates: dict[tuple[str, str], JournalRecord] = field(default_factory=dict)
    damage: list[SegmentDamage] = field(default_factory=list)


def resumable_run(folder: Path) -> str:
    """Return the id of the run that could be resumed.

    Raises:
        TickfixError: when there is none.
    """
    return newest_manifest(folder).run


def resume_run(folder: Path, replica: Executor, beat: Callable[[], None]) -> ResumedRun:
    """Bring a replica to where the journal's newest run stood.

    Args:
        beat: called as a sign of life.

    Raises:
        JournalError: when the run cannot be repeated from what is left of the journal.
        EngineError: when the journal's run had another seed or horizon.
    """
    resumed = ResumedRun(newest_manifest(folder), 1)
    started = False
    steps: list[ReplicaStep] = []
    for record in JournalReader(folder).records(ReadStart.REPLAYABLE, on_damage=resumed.damage.append):
        beat()
        resumed.next_number = record.number + 1
        resumed.records += 1
        if record.kind is RecordKind.SNAPSHOT:
            if not started:
                restore_snapshot(replica, record)
        elif record.kind is RecordKind.ESTIMATE:
            estimate = decode_estimate(record.payload)
            resumed.last_estimates[estimate.device, estimate.pipeline] = record
        elif record.kind is RecordKind.EVENT:
            steps.append(FeedEvent(record.number, decode_event(record.payload), record.payload))
        elif record.kind is RecordKind.DECISION:
            steps.append(decode_decision(record.payload))
        if len(steps) >= _STEPS_PER_BATCH:
            replica.apply(steps)
            steps = []
        started = True
    replica.apply(steps)
    return resumed


def apply_record(replica: Replica, record: JournalRecord) -> list[Estimate]:
    """Apply an event or a decision; return the estimates, in the order in which the journal has them."""
    if record.kind is RecordKind.EVENT:
        replica.event(record.number, decode_event(record.payload))
        return []
    if record.kind is not RecordKind.DECISION:
        return []
    output, _ = replica.apply_decision(decode_decision(record.payload))
    return output.emitted


def restore_snapshot(replica: Executor, record: JournalRecord) -> None:
    """Restore a replica from the record of a snapshot.

    Raises:
        EngineError: when it cannot be used.
    """
    try:
        replica.restore(record.payload)
    except ValueError as error:
        raise EngineError(f"the journal's snapshot (record {record.number}) cannot be used: {error}") from error


def resume_if_requested(options: ServeOptions, replica: Executor, heartbeat: WatchdogHeartbeat) -> ResumedRun | None:
    """Bring a replica to where the journal's newest run stood, if the order is to go on with it.

    Args:
        heartbeat: gets signs of life.

    Raises:
        EngineError, JournalError: when there is nothing to go on from.
    """
    if not options.resume:
        return None
    if options.journal is None:
        raise EngineError("--resume needs --journal DIR: the journal is what a run goes on from")
    resumed = resume_run(options.journal, replica, heartbeat.beat)
    for damage in resumed.damage:
        _LOGGER.warning("journal: %s", damage, extra={"code": "journal_damaged"})
    return resumed


def run_ids(resumed: ResumedRun | None) -> tuple[str, str]:
    """Return the run's id, and the one by which listeners tell its continuations apart."""
    if resumed is None:
        run = secrets.token_hex(6)
        return run, run
    run = resumed.manifest.run
    return run, f"{run}-{boot_number(resumed.manifest) + 1}"


def open_journal(
    options: ServeOptions, registry: Registry, run: str, resumed: ResumedRun | None, replica: Executor
) -> JournalWriter | None:
    """Open the journal, if the order has one; a run that goes on begins with a snapshot of where it stood.

    Raises:
        JournalError: when it cannot be written.
    """
    if options.journal is None:
        return None
    folder, settings = options.journal, options.config.section("journal", JournalSettings)
    manifest = new_manifest(options, registry, run, None if resumed is None else resumed.manifest)
    first = 1 if resumed is None else resumed.next_number
    snapshot = None if resumed is None else replica.snapshot()
    return retry_while_locked(lambda: JournalWriter(folder, manifest, settings, first_number=first, snapshot=snapshot))


def last_values(resumed: ResumedRun, site: str, primary: str, *, all_pipelines: bool) -> list[Publication]:
    """Return the last estimates published before the crash, byte for byte, for listeners that subscribe now."""
    publications = []
    for (device, pipeline), record in resumed.last_estimates.items():
        if all_pipelines or pipeline == primary:
            belief = decode_estimate(record.payload).belief
            publications.append(
                Publication(
                    "estimate", site, None if belief is None else belief.floor, device, pipeline, record.payload
                )
            )
    return publications
