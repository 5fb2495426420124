"""A kernel that does what events and decisions say: the same live, after a crash, in a replay and in a follower."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import msgspec

from tickfix.api import Event, Scan
from tickfix.api.packing import pack, unpack
from tickfix.kernel import (
    DeviceProgress,
    Kernel,
    KernelOutput,
    KernelSettings,
    KernelSnapshot,
    MessageOutcome,
    Pipeline,
    Stage,
    StageFailure,
)
from tickfix.live.protocol import EncodedEstimate, FeedEvent, ReplicaCounters, ReplicaStep, ReplicaStepResult
from tickfix.wire import decode_event, encode_event
from tickfix.wire.engine_messages import AdmitScan, Decision, DropScan, FinishDevice, RunDevice, SelectPrimary


@dataclass(frozen=True, slots=True)
class ReplicaSnapshot:
    """All of a replica.

    Attributes:
        kernel: its kernel's snapshot, packed.
        waiting: scans that no decision has spoken of yet: number and event, encoded.
        primary: the pipeline that is published; empty means the first.
    """

    kernel: bytes
    waiting: tuple[tuple[int, bytes], ...]
    primary: str


class Replica:
    """Applies events and decisions, in their order, to a kernel of its own.

    A scan only waits when it comes: a ``AdmitScan`` decision lets it in, once it has been located beside the loop.
    """

    def __init__(
        self,
        pipelines: Sequence[Pipeline],
        settings: KernelSettings,
        *,
        on_call: Callable[[Stage | None], None] | None = None,
        on_failure: Callable[[StageFailure], None] | None = None,
        report_fixes: bool = False,
        report_faults: bool = False,
    ) -> None:
        """Begin with nothing.

        Args:
            on_call: called with every stage before it is called, and with None after.
            on_failure: called with every stage call that failed.
            report_fixes, report_faults: results of steps hold the fixes of settled ticks, and the calls that failed.
        """
        self._report_fixes = report_fixes
        self._faults: list[tuple[str, str, str]] = []

        def record_failure(failure: StageFailure) -> None:
            self._faults.append((failure.stage, failure.what, failure.detail))
            if on_failure is not None:
                on_failure(failure)

        self.kernel = Kernel(
            pipelines, settings, on_call=on_call, on_failure=record_failure if report_faults else on_failure
        )
        self._waiting: dict[int, Scan] = {}
        self.primary = ""

    def apply(self, steps: Iterable[ReplicaStep]) -> list[ReplicaStepResult]:
        """Apply the steps in order and return the result of each; consecutive runs are computed as a batch."""
        results: list[ReplicaStepResult] = []
        runs: list[RunDevice] = []
        devices: set[str] = set()
        for step in steps:
            if isinstance(step, RunDevice) and step.device not in devices and (not runs or runs[0].most == step.most):
                runs.append(step)
                devices.add(step.device)
                continue
            results += self._run_batch(runs)
            runs, devices = [], set()
            if isinstance(step, RunDevice):
                runs.append(step)
                devices.add(step.device)
            elif isinstance(step, FeedEvent):
                outcome = self.event(step.number, step.event)
                results.append(ReplicaStepResult(outcome, progress=self.kernel.progress(step.event.device)))
            else:
                results.append(self._decision_result(step))
        results += self._run_batch(runs)
        if self._faults and results:
            results[-1] = msgspec.structs.replace(results[-1], faults=tuple(self._faults))
            self._faults.clear()
        return results

    def event(self, number: int, event: Event) -> MessageOutcome | None:
        """Take in the event of record ``number``; None means that it waits for a decision."""
        if isinstance(event, Scan):
            self._waiting[number] = event
            return None
        return self.kernel.feed(event)

    def apply_decision(self, decision: Decision) -> tuple[KernelOutput, MessageOutcome | None]:
        """Carry out a decision; return the kernel's output, and the outcome of the scan concerned, if any."""
        if isinstance(decision, RunDevice):
            return self.kernel.run(decision.device, decision.tick, decision.most), None
        if isinstance(decision, AdmitScan):
            scan = self._waiting.pop(decision.number, None)
            return KernelOutput(), None if scan is None else self.kernel.feed(scan)
        if isinstance(decision, FinishDevice):
            return self.kernel.finish(decision.device), None
        if isinstance(decision, DropScan):
            self._waiting.pop(decision.number, None)
        elif isinstance(decision, SelectPrimary):
            self.primary = decision.pipeline
        return KernelOutput(), None

    def is_duplicate(self, event: Event) -> bool:
        """Tell whether the event would be a duplicate by its number; changes nothing."""
        return self.kernel.is_duplicate(event)

    def progress_by_device(self) -> dict[str, DeviceProgress]:
        """Return how far each device has come."""
        progress_by_device = {device: self.kernel.progress(device) for device in self.kernel.devices}
        return {device: progress for device, progress in progress_by_device.items() if progress is not None}

    def counters(self) -> ReplicaCounters:
        """Return the counters as they are now."""
        kernel = self.kernel
        return ReplicaCounters(len(kernel.devices), dict(kernel.measurements), kernel.missing, dict(kernel.failures))

    @property
    def waiting(self) -> Mapping[int, Scan]:
        """Scans that no decision has spoken of yet, by the number of their record."""
        return self._waiting

    def snapshot(self) -> bytes:
        """Return all of it as bytes; every device must have been run since it was fed."""
        waiting = tuple((number, encode_event(scan)) for number, scan in self._waiting.items())
        return pack(ReplicaSnapshot(self.kernel.snapshot().packed(), waiting, self.primary))

    def restore(self, data: bytes) -> None:
        """Become what the bytes say.

        Raises:
            ValueError: when they are no snapshot, or one of a run with other settings.
        """
        kept = unpack(data, ReplicaSnapshot)
        self.kernel.restore(KernelSnapshot.unpacked(kept.kernel))
        self.primary = kept.primary
        for number, encoded in kept.waiting:
            event = decode_event(encoded)
            if isinstance(event, Scan):
                self._waiting[number] = event

    def _run_batch(self, runs: Sequence[RunDevice]) -> list[ReplicaStepResult]:
        if not runs:
            return []
        outputs = self.kernel.run_many([(run.device, run.tick) for run in runs], runs[0].most)
        return [self._step_result(run.device, output) for run, output in zip(runs, outputs, strict=True)]

    def _decision_result(self, decision: Decision) -> ReplicaStepResult:
        scan = self._waiting.get(decision.number) if isinstance(decision, AdmitScan) else None
        output, outcome = self.apply_decision(decision)
        device = decision.device if isinstance(decision, FinishDevice) else "" if scan is None else scan.device
        return self._step_result(device, output, outcome)

    def _step_result(
        self, device: str, output: KernelOutput, outcome: MessageOutcome | None = None
    ) -> ReplicaStepResult:
        estimates = tuple(EncodedEstimate.of(estimate) for estimate in output.emitted)
        fixes: tuple[bytes, ...] = ()
        if self._report_fixes:
            fixes = tuple(encode_event(seen.fix) for _, seen in output.observations if seen.fix is not None)
        must_journal = bool(estimates or output.settled)
        return ReplicaStepResult(outcome, estimates, must_journal, self.kernel.progress(device), fixes)
