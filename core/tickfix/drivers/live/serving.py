"""Bringing an engine up: site, pipelines, ports and journal, from the start or from where a run stood."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

from tickfix.client import Keys
from tickfix.config import build
from tickfix.drivers.live.collecting import rare_full_collections
from tickfix.drivers.live.crew.crew import Crew
from tickfix.drivers.live.errors import EngineError
from tickfix.drivers.live.following import Follower, Leader
from tickfix.drivers.live.ledger import Ledger
from tickfix.drivers.live.loop.engine import Engine
from tickfix.drivers.live.order import Order
from tickfix.drivers.live.patience import patiently
from tickfix.drivers.live.runs.beginning import last_words, names_of, open_journal, resume_as_ordered
from tickfix.drivers.live.settings import LiveSettings
from tickfix.drivers.live.staffing import folding_by, locating_by
from tickfix.drivers.live.status import Reporting, Status, about
from tickfix.drivers.live.watchdog.beacon import Beacon
from tickfix.drivers.surveying import context_of
from tickfix.journal import JournalWriter
from tickfix.kernel import Pipeline
from tickfix.plugins import Registry
from tickfix.ports import Addresses, Hub, PortSettings
from tickfix.site.folder import load as load_site


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
    replica = folding_by(live, pipelines, order.config.kernel, beacon, tell)
    resumed = resume_as_ordered(order, replica, beacon, tell)
    run, shown = names_of(resumed)
    notes = [f"pipeline {name} is left out: {why}" for name, why in left_out.items()]
    status = Status(about(order.config, registry, shown, site.name, names, left_out, notes))
    ports = order.config.section("ports", PortSettings)
    hub = Hub(ports, run=shown, site=site.name, describe=status.describe)
    addresses = patiently(hub.start)
    writer: JournalWriter | None = None

    def after_round(engine: Runnable) -> None:
        beacon.alive()
        status.look(engine)

    try:
        writer = open_journal(order, registry, run, resumed, replica)
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
            locating = locating_by(replica, live, hub.wake)
            engine = Engine(
                replica, locating, hub, ledger, live, site=site.name, names=names, after_round=after_round, tell=tell
            )
        engine.adopt()
        status.look(engine)
        if resumed is not None:
            hub.publish(last_words(resumed, site.name, engine.report()["primary"], everyone=live.publish == "all"))
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


def _keys(own: Path | None) -> Keys | None:
    return None if own is None else Keys.read(own, own.parent / "engine.pub")


def _allowed(pipelines: Sequence[Pipeline], disabled: Mapping[str, str]) -> tuple[tuple[Pipeline, ...], dict[str, str]]:
    left_out: dict[str, str] = {}
    for pipeline in pipelines:
        for stage in pipeline.stages:
            if stage.key in disabled:
                left_out[pipeline.name] = f"{stage.label} {disabled[stage.key]}"
    kept = tuple(pipeline for pipeline in pipelines if pipeline.name not in left_out)
    if not kept:
        raise EngineError(f"no pipeline is left: {'; '.join(f'{name}: {why}' for name, why in left_out.items())}")
    return kept, left_out
