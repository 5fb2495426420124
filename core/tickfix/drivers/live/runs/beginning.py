"""A run: what it is called, what its journal says of it, and how it goes on after an engine has ended."""

from __future__ import annotations

import secrets
from collections.abc import Callable

from tickfix.drivers.live.errors import EngineError
from tickfix.drivers.live.folding import Folding
from tickfix.drivers.live.order import Order
from tickfix.drivers.live.patience import patiently
from tickfix.drivers.live.runs.manifests import boot_of, manifest_for
from tickfix.drivers.live.runs.resuming import Resumed, resume
from tickfix.drivers.live.watchdog.beacon import Beacon
from tickfix.journal import JournalSettings, JournalWriter
from tickfix.plugins import Registry
from tickfix.ports import Said
from tickfix.wire import decode_estimate


def resume_as_ordered(order: Order, replica: Folding, beacon: Beacon, tell: Callable[[str], None]) -> Resumed | None:
    """Bring a replica to where the journal's newest run stood, if the order is to go on with it.

    Args:
        beacon: gets signs of life.
        tell: told what of the journal is damaged.

    Raises:
        EngineError, JournalError: when there is nothing to go on from.
    """
    if not order.resume:
        return None
    if order.journal is None:
        raise EngineError("--resume needs --journal DIR: the journal is what a run goes on from")
    resumed = resume(order.journal, replica, beacon.alive)
    for damage in resumed.damage:
        tell(f"journal: {damage}")
    return resumed


def names_of(resumed: Resumed | None) -> tuple[str, str]:
    """Return the run's id, and the one by which listeners tell its continuations apart."""
    if resumed is None:
        run = secrets.token_hex(6)
        return run, run
    run = resumed.manifest.run
    return run, f"{run}-{boot_of(resumed.manifest) + 1}"


def open_journal(
    order: Order, registry: Registry, run: str, resumed: Resumed | None, replica: Folding
) -> JournalWriter | None:
    """Open the journal, if the order has one; a run that goes on begins with a snapshot of where it stood.

    Raises:
        JournalError: when it cannot be written.
    """
    if order.journal is None:
        return None
    folder, settings = order.journal, order.config.section("journal", JournalSettings)
    manifest = manifest_for(order, registry, run, None if resumed is None else resumed.manifest)
    first = 1 if resumed is None else resumed.next_number
    snapshot = None if resumed is None else replica.snapshot()
    return patiently(lambda: JournalWriter(folder, manifest, settings, first_number=first, snapshot=snapshot))


def last_words(resumed: Resumed, site: str, primary: str, *, everyone: bool) -> list[Said]:
    """What was said last before the crash: the same bytes again, for those who come now."""
    said = []
    for (device, pipeline), record in resumed.last.items():
        if everyone or pipeline == primary:
            belief = decode_estimate(record.payload).belief
            said.append(
                Said("estimate", site, None if belief is None else belief.floor, device, pipeline, record.payload)
            )
    return said
