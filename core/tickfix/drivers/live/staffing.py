"""Who does the work of an engine: its own process, or a crew of workers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection

from tickfix.drivers.live.collecting import rare_full_collections
from tickfix.drivers.live.crew.crew import Crew
from tickfix.drivers.live.crew.worker import Worker
from tickfix.drivers.live.folding import Folding
from tickfix.drivers.live.locating import Locator
from tickfix.drivers.live.loop.scans import Locating
from tickfix.drivers.live.remembering import remembering
from tickfix.drivers.live.replica import Replica
from tickfix.drivers.live.settings import LiveSettings
from tickfix.drivers.live.watchdog.beacon import Beacon
from tickfix.kernel import LOST, Failure, KernelSettings, Pipeline


def folding_by(
    live: LiveSettings,
    pipelines: Sequence[Pipeline],
    settings: KernelSettings,
    beacon: Beacon,
    tell: Callable[[str], None],
) -> Folding:
    """Return who folds: workers, forked from this process, which must have no other thread yet; or this process.

    Args:
        beacon: gets signs of life, of each worker its own.
        tell: told, in a sentence, of a device that was lost.
    """

    def replica(own: Beacon) -> Replica:
        return Replica(remembering(pipelines), settings, on_call=own.calling, on_failure=_teller(tell))

    def work(n: int, line: Connection, notices: Connection) -> None:
        own = beacon.of_worker(n)
        worker = Worker(replica(own), line, notices, own, threads=live.locators, timeout_s=live.locate_timeout_s)
        with rare_full_collections():
            worker.serve()

    return Crew(live.workers, work) if live.workers else replica(beacon)


def locating_by(replica: Folding, live: LiveSettings, wake: Callable[[], None]) -> Locating:
    """Return who locates scans beside the loop, in each process that folds; ``wake`` is called when one is done."""
    if isinstance(replica, Crew):
        return replica.locating(wake)
    assert isinstance(replica, Replica)  # noqa: S101 - one or the other
    return Locator(replica.kernel.questions, wake, threads=live.locators, timeout_s=live.locate_timeout_s)


def _teller(tell: Callable[[str], None]) -> Callable[[Failure], None]:
    """Return what tells of a device that was lost; failures of stages are counted, and told with each estimate."""

    def told(failure: Failure) -> None:
        if failure.stage == LOST:
            tell(f"a device had to be abandoned, please report this: {failure.detail}")

    return told
