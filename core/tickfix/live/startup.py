"""Bringing an engine up: site, pipelines, executor, ports and journal, from the start or from where a run stood."""

from __future__ import annotations

import gc
import logging
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

from tickfix.api import Run
from tickfix.client import Keys
from tickfix.config import build_pipelines
from tickfix.journal import JournalWriter
from tickfix.kernel import QUARANTINED, KernelSettings, Pipeline, StageFailure
from tickfix.live.engine import Engine, EventSource
from tickfix.live.engine_status import EngineStatus, static_status
from tickfix.live.follower import FollowSource, Leader
from tickfix.live.heartbeat import WatchdogHeartbeat
from tickfix.live.localization import LocatorThreads, ScanLocator, with_fingerprint_cache
from tickfix.live.observation import ObservedExecutor
from tickfix.live.protocol import EngineError, Executor
from tickfix.live.publisher import WriteAheadBuffer
from tickfix.live.recovery import last_values, open_journal, resume_if_requested, retry_while_locked, run_ids
from tickfix.live.replica import Replica
from tickfix.live.sensor_source import SensorSource
from tickfix.live.serve_options import LiveSettings, ServeOptions
from tickfix.live.worker import Worker
from tickfix.live.worker_pool import WorkerPool
from tickfix.observers import Observers
from tickfix.ports import Hub, PortAddresses, PortSettings
from tickfix.registry import Registry
from tickfix.replay.site_survey import site_context
from tickfix.site import load_site

_FULL_EVERY: Final = 1_000
"""Collections of the middle generation between full ones; by default 10."""

_LOGGER = logging.getLogger(__name__)


def require_serving_platform() -> None:
    """Check that this system has what an engine is built on: locks of files and forked processes.

    Raises:
        EngineError: naming what is missing.
    """
    missing = []
    try:
        import fcntl  # noqa: F401, PLC0415 - whether it is there is the question
    except ImportError:
        missing.append("fcntl")
    missing += [] if hasattr(os, "fork") else ["os.fork"]
    if missing:
        raise EngineError(
            f"tickfix serve needs {' and '.join(missing)}, which this system ({sys.platform}) lacks; "
            "serve on Linux or macOS, or in WSL on Windows. Every other command but `tickfix serve` works here"
        )


@contextmanager
def rare_full_collections() -> Iterator[None]:
    """Leave out of the garbage collector's sight what is there now, and let it look at all of the rest seldom.

    A full collection looks at every state of every device and stops the loop meanwhile. It is there for cycles that
    live long; a device that is gone leaves none, and short-lived ones are found as ever.
    """
    young, middle, full = gc.get_threshold()
    gc.collect()
    gc.freeze()
    gc.set_threshold(young, middle, _FULL_EVERY)
    try:
        yield
    finally:
        gc.set_threshold(young, middle, full)
        gc.unfreeze()


def build_executor(
    live: LiveSettings,
    pipelines: Sequence[Pipeline],
    settings: KernelSettings,
    heartbeat: WatchdogHeartbeat,
    observers: Observers | None = None,
) -> Executor:
    """Return who folds: workers, forked from this process, which must have no other thread yet; or this process.

    Args:
        heartbeat: gets signs of life, of each worker its own.
    """

    def replica(own: WatchdogHeartbeat) -> Replica:
        return Replica(
            with_fingerprint_cache(pipelines),
            settings,
            on_call=own.enter_stage,
            on_failure=_log_quarantine,
            report_fixes=observers is not None and observers.wants("tickfix_fixes"),
            report_faults=observers is not None and observers.wants("tickfix_faults"),
        )

    def work(n: int, channel: Connection, completions: Connection) -> None:
        own = heartbeat.for_worker(n)
        worker = Worker(replica(own), channel, completions, own, threads=live.locators, timeout_s=live.locate_timeout_s)
        with rare_full_collections():
            worker.serve()

    return WorkerPool(live.workers, work) if live.workers else replica(heartbeat)


def build_scan_locator(replica: Executor, live: LiveSettings, wake: Callable[[], None]) -> ScanLocator:
    """Return who locates scans beside the loop, in each process that folds; ``wake`` is called when one is done."""
    if isinstance(replica, WorkerPool):
        return replica.scan_locator(wake)
    assert isinstance(replica, Replica)  # noqa: S101 - one or the other
    return LocatorThreads(
        replica.kernel.fingerprint_requests, wake, threads=live.locators, timeout_s=live.locate_timeout_s
    )


def _log_quarantine(failure: StageFailure) -> None:
    """Log that a device was abandoned; failures of stages are counted, and are part of the estimates."""
    if failure.stage == QUARANTINED:
        _LOGGER.error(
            "a device had to be abandoned, please report this: %s",
            failure.detail,
            extra={"code": "device_quarantined"},
        )


@contextmanager
def _reported_end(observers: Observers, run: Run, observed: ObservedExecutor) -> Iterator[None]:
    """Hand observers what is left, and tell them how the run ended."""
    try:
        yield
    except BaseException as error:
        observers.run_ended(run, f"{type(error).__name__}: {error}")
        raise
    observed.flush()
    observers.run_ended(run)


def serve(  # noqa: PLR0915 - the wiring, in the order in which it happens
    options: ServeOptions,
    registry: Registry,
    heartbeat: WatchdogHeartbeat,
    *,
    on_started: Callable[[str, PortAddresses], None],
    on_ended: Callable[[Engine], None] = lambda _: None,
    control: Callable[[Engine], None] = lambda _: None,
) -> None:
    """Serve until stopped by a signal or over the control port.

    Args:
        heartbeat: gets signs of life.
        on_started: called with the run and the addresses once the ports are open.
        on_ended: called with the engine when it has ended in order.
        control: called with the engine before it begins, so that a signal can stop it.

    Raises:
        TickfixError: when site, configuration, ports or journal do not allow it.
    """
    site = load_site(options.site)
    pipelines, left_out = _enabled_pipelines(
        build_pipelines(options.config.pipelines, site_context(site), site.models), options.disabled
    )
    names = [pipeline.name for pipeline in pipelines]
    live = options.config.section("live", LiveSettings)
    if live.primary and live.primary not in names and live.primary not in left_out:
        raise EngineError(f"live.primary: found {live.primary!r}, expected one of {', '.join(names)}")
    heartbeat.register_stages(pipelines)
    replica = build_executor(live, pipelines, options.config.kernel, heartbeat, registry.observers)
    resumed = resume_if_requested(options, replica, heartbeat)
    run, shown = run_ids(resumed)
    notes = [f"pipeline {name} is left out: {why}" for name, why in left_out.items()]
    status = EngineStatus(static_status(options.config, registry, shown, site.name, names, left_out, notes))
    ports = options.config.section("ports", PortSettings)
    hub = Hub(ports, run=shown, site=site.name, describe=status.describe, sources=registry.sources)
    addresses = retry_while_locked(hub.start)
    writer: JournalWriter | None = None

    observers = registry.observers
    observed_run = Run(id=shown, mode="follow" if options.follow else "live", site=site.name, pipelines=tuple(names))
    observed = ObservedExecutor(replica, observers, observed_run)

    def after_round() -> None:
        heartbeat.beat()
        if not engine.journal_full:  # what waits for room in the journal was not published either
            observed.flush()

    try:
        writer = open_journal(options, registry, run, resumed, replica)
        status.hub = hub
        write_ahead = WriteAheadBuffer(writer, hub)
        source: EventSource
        if options.follow:
            if isinstance(replica, WorkerPool):
                replica.scan_locator(hub.wake)  # locates nothing here, but learns when a worker dies
            source = FollowSource(Leader(options.follow, _follow_keys(options.follow_key)), hub)
        else:
            source = SensorSource(hub, build_scan_locator(replica, live, hub.wake), live)
        engine = Engine(
            source,
            observed if observers else replica,
            hub,
            write_ahead,
            live,
            site=site.name,
            names=names,
            status=status,
            beat=after_round,
            on_overrun=observed.overrun,
        )
        engine.recover()
        if resumed is not None:
            hub.publish(last_values(resumed, site.name, engine.primary, all_pipelines=live.publish == "all"))
        control(engine)
        on_started(shown, addresses)
        heartbeat.mark_serving()
        observers.run_started(observed_run)
        with rare_full_collections(), _reported_end(observers, observed_run, observed):
            engine.serve()
        on_ended(engine)
    finally:
        hub.stop()
        if writer is not None:
            writer.close()
        if isinstance(replica, WorkerPool):
            replica.close()


def _follow_keys(own: Path | None) -> Keys | None:
    return None if own is None else Keys.read(own, own.parent / "engine.pub")


def _enabled_pipelines(
    pipelines: Sequence[Pipeline], disabled: Mapping[str, str]
) -> tuple[tuple[Pipeline, ...], dict[str, str]]:
    left_out: dict[str, str] = {}
    for pipeline in pipelines:
        for stage in pipeline.stages:
            if stage.key in disabled:
                left_out[pipeline.name] = f"{stage.label} {disabled[stage.key]}"
    kept = tuple(pipeline for pipeline in pipelines if pipeline.name not in left_out)
    if not kept:
        raise EngineError(f"no pipeline is left: {'; '.join(f'{name}: {why}' for name, why in left_out.items())}")
    return kept, left_out
