"""Hands what a live engine computes to the observers of plugins, once per round and after its commit.

The engine does not know of it: its executor is wrapped, and :meth:`ObservedExecutor.flush` is called after each round.
Nothing is wrapped where no plugin observes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tickfix.api import Event, Fix, Overrun, Run, Scan, StageFault
from tickfix.kernel import DeviceProgress
from tickfix.live.protocol import EncodedEstimate, Executor, ReplicaCounters, ReplicaStep, ReplicaStepResult
from tickfix.observers import Observers
from tickfix.wire import decode_estimate, decode_event


class ObservedExecutor:
    """An executor that keeps what its steps say for the observers.

    Args:
        executor: does the work; a replica, or a pool of workers.
        observers: at least one of them observes something.
        run: the run that their hooks are called with.
    """

    def __init__(self, executor: Executor, observers: Observers, run: Run) -> None:
        """Begin with nothing to report."""
        self._executor = executor
        self._observers = observers
        self._run = run
        self._wants_estimates = observers.wants("tickfix_estimates") or observers.wants("tickfix_epochs_started")
        self._estimates: list[EncodedEstimate] = []
        self._fixes: list[bytes] = []
        self._faults: list[StageFault] = []
        self._overruns: list[Overrun] = []

    @property
    def primary(self) -> str:
        """The pipeline that is published; empty means that none was chosen."""
        return self._executor.primary

    @property
    def waiting(self) -> Mapping[int, Scan]:
        """Scans that no decision has spoken of yet, by the number of their record."""
        return self._executor.waiting

    def apply(self, steps: Sequence[ReplicaStep]) -> list[ReplicaStepResult]:
        """Do the steps, and keep what they say until :meth:`flush`."""
        results = self._executor.apply(steps)
        for result in results:
            if self._wants_estimates:
                self._estimates += result.estimates
            self._fixes += result.fixes
            self._faults += [
                StageFault(stage=stage, error=error, detail=detail) for stage, error, detail in result.faults
            ]
        return results

    def overrun(self, *, active: bool, lag_s: float, devices: int) -> None:
        """Keep that the engine fell behind, or caught up."""
        self._overruns.append(Overrun(active=active, lag_s=lag_s, devices=devices))

    def flush(self) -> None:
        """Call the hooks with what was kept since the last call, in the thread of the engine."""
        estimates, self._estimates = self._estimates, []
        fixes, self._fixes = self._fixes, []
        faults, self._faults = self._faults, []
        overruns, self._overruns = self._overruns, []
        self._observers.estimates(self._run, [decode_estimate(encoded.body) for encoded in estimates])
        events = map(decode_event, fixes)
        self._observers.fixes(self._run, [event for event in events if isinstance(event, Fix)])
        self._observers.faults(self._run, faults)
        self._observers.overruns(self._run, overruns)

    def is_duplicate(self, event: Event) -> bool:
        """Tell whether the event would be a duplicate by its number, without taking note of it."""
        return self._executor.is_duplicate(event)

    def progress_by_device(self) -> Mapping[str, DeviceProgress]:
        """Return how far each device has come."""
        return self._executor.progress_by_device()

    def counters(self) -> ReplicaCounters:
        """Return the counters as they are now."""
        return self._executor.counters()

    def snapshot(self) -> bytes:
        """Return all of the executor as bytes."""
        return self._executor.snapshot()

    def restore(self, data: bytes) -> None:
        """Become what the bytes say.

        Raises:
            ValueError: when they are no snapshot, or one of a run with other settings.
        """
        self._executor.restore(data)
