"""Bringing an engine up: site, pipelines, ports and journal, from the start or from where a run stood."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

import tickfix
from tickfix.api.errors import PortError
from tickfix.client import Keys
from tickfix.config import Config, build
from tickfix.drivers.live.beacon import Beacon
from tickfix.drivers.live.collecting import rare_full_collections
from tickfix.drivers.live.crew.crew import Crew
from tickfix.drivers.live.crew.worker import Worker
from tickfix.drivers.live.engine import Engine
from tickfix.drivers.live.errors import EngineError
from tickfix.drivers.live.folding import Folding
from tickfix.drivers.live.following import Follower, Leader
from tickfix.drivers.live.ledger import Ledger
from tickfix.drivers.live.locating import Locator, remembering
from tickfix.drivers.live.replica import Replica
from tickfix.drivers.live.resuming import Resumed, manifest_of, resume
from tickfix.drivers.live.scans import Locating
from tickfix.drivers.live.settings import LiveSettings
from tickfix.drivers.live.status import Reporting, Status
from tickfix.drivers.surveying import context_of
from tickfix.journal import JournalLocked, JournalSettings, JournalWriter, Manifest
from tickfix.kernel import LOST, Failure, KernelSettings, Pipeline
from tickfix.kernel.probe import numeric_probe
from tickfix.plugins import Registry
from tickfix.ports import Addresses, Hub, PortSettings, Said
from tickfix.site.folder import load as load_site
from tickfix.wire import decode_estimate

_PATIENCE_S: Final = 3.0

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """What to serve.

    Attributes:
        site: folder of the site.
        config: pipelines, and the tables ``[live]``, ``[ports]`` and ``[journal]``.
        journal: folder; None keeps no journal.
        resume: go on with the journal's newest run.
        follow: address of another engine's follow port; then its events and decisions are folded, and no sensors.
        follow_key: own key for that port, as a file with ``engine.pub`` beside it; None where none is asked for.
        disabled: keys and labels of stages that must not run; pipelines that need one are left out.
    """

    site: Path
    config: Config
    journal: Path | None = None
    resume: bool = False
    follow: str = ""
    follow_key: Path | None = None
    disabled: Mapping[str, str] = field(default_factory=dict)


class Runnable(Reporting, Protocol):
    """An engine: one that takes sensors in, or one that follows another."""

    def adopt(self) -> None:
        """Take over what the replica was restored with."""

    def serve(self) -> None:
        """Run until told to stop."""

    def stop(self) -> None:
        """Stop after this round; from any thread."""


def serve(
    order: Order,
    registry: Registry,
    beacon: Beacon,
    *,
    began: Callable[[str, Addresses], None],
    tell: Callable[[str], None],
    ending: Callable[[Runnable], None] = lambda _: None,
    control: Callable[[Runnable], None] = lambda _: None,
) -> None:
    """Serve until told to stop.

    Args:
        beacon: gets signs of life.
        began: told the run and the addresses once the ports are open.
        tell: told, in a sentence, what an operator must know.
        ending: told the engine when it has ended in order.
        control: told the engine before it begins, so that a signal can stop it.

    Raises:
        TickfixError: when site, configuration, ports or journal do not allow it.
    """
    site = load_site(order.site)
    pipelines, left_out = _allowed(build(order.config.pipelines, context_of(site), site.models), order.disabled)
    names = [pipeline.name for pipeline in pipelines]
    live = order.config.section("live", LiveSettings)
    if live.primary and live.primary not in names and live.primary not in left_out:
        raise EngineError(f"live.primary: found {live.primary!r}, expected one of {', '.join(names)}")
    beacon.introduce(pipelines)
    replica = _folding(live, pipelines, order.config.kernel, beacon, tell)
    resumed = _resumed(order, replica, beacon, tell)
    run, shown = _names(resumed)
    notes = [f"pipeline {name} is left out: {why}" for name, why in left_out.items()]
    status = Status(_about(order.config, registry, shown, site.name, names, left_out, notes))
    ports = order.config.section("ports", PortSettings)
    hub = Hub(ports, run=shown, site=site.name, describe=status.describe)
    addresses = _patiently(hub.start)
    writer: JournalWriter | None = None

    def after_round(engine: Runnable) -> None:
        beacon.alive()
        status.look(engine)

    try:
        writer = _written(order, registry, run, resumed, replica)
        status.hub = hub
        ledger = Ledger(writer, hub)
        engine: Runnable
        if order.follow:
            if isinstance(replica, Crew):
                replica.locating(hub.wake)  # nothing is located for a follower, but it hears when a worker is gone
            followed = Leader(order.follow, _keys(order.follow_key))
            engine = Follower(
                followed, replica, hub, ledger, live, site=site.name, names=names, after_round=after_round, tell=tell
            )
        else:
            locating = _locating(replica, live, hub.wake)
            engine = Engine(
                replica, locating, hub, ledger, live, site=site.name, names=names, after_round=after_round, tell=tell
            )
        engine.adopt()
        status.look(engine)
        if resumed is not None:
            hub.publish(_last_words(resumed, site.name, engine.report()["primary"], everyone=live.publish == "all"))
        control(engine)
        began(shown, addresses)
        beacon.serving()
        with rare_full_collections():
            engine.serve()
        ending(engine)
    finally:
        hub.stop()
        if writer is not None:
            writer.close()
        if isinstance(replica, Crew):
            replica.close()


def _folding(
    live: LiveSettings,
    pipelines: Sequence[Pipeline],
    settings: KernelSettings,
    beacon: Beacon,
    tell: Callable[[str], None],
) -> Folding:
    """Return who folds: workers, forked from this process, which must have no other thread yet; or this process."""

    def replica(own: Beacon) -> Replica:
        return Replica(remembering(pipelines), settings, on_call=own.calling, on_failure=_teller(tell))

    def work(n: int, line: Connection, notices: Connection) -> None:
        own = beacon.of_worker(n)
        worker = Worker(replica(own), line, notices, own, threads=live.locators, timeout_s=live.locate_timeout_s)
        with rare_full_collections():
            worker.serve()

    return Crew(live.workers, work) if live.workers else replica(beacon)


def _locating(replica: Folding, live: LiveSettings, wake: Callable[[], None]) -> Locating:
    if isinstance(replica, Crew):
        return replica.locating(wake)
    assert isinstance(replica, Replica)  # noqa: S101 - one or the other
    return Locator(replica.kernel.questions, wake, threads=live.locators, timeout_s=live.locate_timeout_s)


def _resumed(order: Order, replica: Folding, beacon: Beacon, tell: Callable[[str], None]) -> Resumed | None:
    if not order.resume:
        return None
    if order.journal is None:
        raise EngineError("--resume needs --journal DIR: the journal is what a run goes on from")
    resumed = resume(order.journal, replica, beacon.alive)
    for damage in resumed.damage:
        tell(f"journal: {damage}")
    return resumed


def _teller(tell: Callable[[str], None]) -> Callable[[Failure], None]:
    """Return what tells of a device that was lost; failures of stages are counted, and told with each estimate."""

    def told(failure: Failure) -> None:
        if failure.stage == LOST:
            tell(f"a device had to be abandoned, please report this: {failure.detail}")

    return told


def _keys(own: Path | None) -> Keys | None:
    return None if own is None else Keys.read(own, own.parent / "engine.pub")


def _names(resumed: Resumed | None) -> tuple[str, str]:
    """Return the run's id, and the one by which listeners tell its continuations apart."""
    if resumed is None:
        run = secrets.token_hex(6)
        return run, run
    run, boot = resumed.manifest.run, int(resumed.manifest.notes.get("boot", "1")) + 1
    return run, f"{run}-{boot}"


def _written(
    order: Order, registry: Registry, run: str, resumed: Resumed | None, replica: Folding
) -> JournalWriter | None:
    """Open the journal; a run that goes on begins with a snapshot of where it stood."""
    if order.journal is None:
        return None
    folder, settings = order.journal, order.config.section("journal", JournalSettings)
    manifest = _manifest(order, registry, run, None if resumed is None else resumed.manifest)
    first = 1 if resumed is None else resumed.next_number
    snapshot = None if resumed is None else replica.snapshot()
    return _patiently(lambda: JournalWriter(folder, manifest, settings, first_number=first, snapshot=snapshot))


def resumable(folder: Path) -> str:
    """Return the id of the run that could be resumed.

    Raises:
        TickfixError: when there is none.
    """
    return manifest_of(folder).run


def _patiently(attempt: Callable[[], T]) -> T:
    """Try for a while: the process that held ports and journal may be dying just now."""
    until = time.monotonic() + _PATIENCE_S
    while True:
        try:
            return attempt()
        except (PortError, JournalLocked):
            if time.monotonic() > until:
                raise
            time.sleep(0.05)


def _allowed(pipelines: Sequence[Pipeline], disabled: Mapping[str, str]) -> tuple[tuple[Pipeline, ...], dict[str, str]]:
    left_out: dict[str, str] = {}
    for pipeline in pipelines:
        for stage in (pipeline.pdr, pipeline.fingerprint, pipeline.filter):
            if stage is not None and stage.key in disabled:
                left_out[pipeline.name] = f"{stage.label} {disabled[stage.key]}"
    kept = tuple(pipeline for pipeline in pipelines if pipeline.name not in left_out)
    if not kept:
        raise EngineError(f"no pipeline is left: {'; '.join(f'{name}: {why}' for name, why in left_out.items())}")
    return kept, left_out


def _about(
    config: Config,
    registry: Registry,
    run: str,
    site: str,
    names: Sequence[str],
    left_out: Mapping[str, str],
    notes: Sequence[str],
) -> dict[str, Any]:
    pipelines = []
    for choice in config.pipelines:
        stages = {c.offer.kind: c.offer.label for c in choice.choices}
        state = f"left out: {left_out[choice.name]}" if choice.name in left_out else "running"
        if choice.name in names or choice.name in left_out:
            pipelines.append({"name": choice.name, "state": state} | stages)
    return {
        "run": run,
        "site": site,
        "version": tickfix.__version__,
        "pipelines": pipelines,
        "plugins": [
            {"kind": o.kind, "name": o.name, "distribution": o.distribution, "version": o.version}
            for o in registry.offers
        ],
        "configuration": config.text,
        "notes": list(notes),
    }


def _manifest(order: Order, registry: Registry, run: str, before: Manifest | None) -> Manifest:
    boot = 1 if before is None else int(before.notes.get("boot", "1")) + 1
    libraries = {name: version(name) for name in ("numpy", "scipy", "shapely", "pyzmq", "msgspec", "mcap")}
    return Manifest(
        run=run,
        tickfix_version=tickfix.__version__,
        config=order.config.text,
        seed=order.config.kernel.seed,
        probe=numeric_probe(),
        wall_start_ns=time.time_ns() if before is None else before.wall_start_ns,
        plugins=libraries | {offer.distribution: offer.version for offer in registry.offers if offer.distribution},
        notes={
            "site": str(order.site.resolve()),
            "boot": str(boot),
            "pipelines": ",".join(p.name for p in order.config.pipelines),
            "disabled": "\n".join(f"{key}\t{why}" for key, why in sorted(order.disabled.items())),
        },
    )


def _last_words(resumed: Resumed, site: str, primary: str, *, everyone: bool) -> list[Said]:
    """What was said last before the crash: the same bytes again, for those who come now."""
    said = []
    for (device, pipeline), record in resumed.last.items():
        if everyone or pipeline == primary:
            belief = decode_estimate(record.payload).belief
            said.append(
                Said("estimate", site, None if belief is None else belief.floor, device, pipeline, record.payload)
            )
    return said
