"""The kernel: all devices, no I/O, no clock, no thread.

A driver feeds it events as they arrive and runs it; what comes back are estimates. Where events come from and how
waiting is done is the driver's affair.
"""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from tickfix.api.errors import PluginError
from tickfix.api.events import Event, Fix, Scan, Truth
from tickfix.kernel.batch import step_batch, step_one
from tickfix.kernel.deduplication import MessageOutcome, SessionRegistry
from tickfix.kernel.device import Device, DeviceProgress
from tickfix.kernel.epoch import KernelOutput
from tickfix.kernel.snapshot import KernelSnapshot
from tickfix.kernel.stages import KernelSetup, Pipeline, Stage, StageCaller, StageFailure
from tickfix.kernel.tracker import FingerprintRequest


@dataclass(frozen=True, slots=True, kw_only=True)
class KernelSettings:
    """Settings of a run.

    Attributes:
        seed: of all random streams.
        horizon_s: how far behind the last closed tick an event may be measured and still be used.
        checkpoint_mb: memory for a device's checkpoints; less means refolding more, never other results.
        strict: a stage that fails raises, for tests.
        repack: pack and unpack every state at every tick: slow, for tests.
    """

    seed: int = 0
    horizon_s: float = 10.0
    checkpoint_mb: float = 8.0
    strict: bool = False
    repack: bool = False


_RESTORE_BATCH: Final = 32
"""Devices restored side by side: of more, what one step needs does not stay in the processor's cache until the next."""
QUARANTINED = "device quarantined"
"""Stands in the place of a stage where the kernel itself breaks on a device."""


class Kernel:
    """Folds events into estimates, for any number of devices and pipelines.

    Args:
        pipelines: in the order in which estimates of a tick are to come.
        starts: devices whose start is known.
        on_failure: told of every stage call that failed.
        on_call: told of every stage before it is called, and None when it has come back.
    """

    def __init__(
        self,
        pipelines: Sequence[Pipeline],
        settings: KernelSettings | None = None,
        *,
        starts: Mapping[str, Fix] = MappingProxyType({}),
        on_failure: Callable[[StageFailure], None] | None = None,
        on_call: Callable[[Stage | None], None] | None = None,
    ) -> None:
        """Begin with no device.

        Raises:
            PluginError: when a filter that smooths has an invalid ``lag_s``.
        """
        self._settings = KernelSettings() if settings is None else settings
        self._starts = starts
        self._on_failure = on_failure
        self._devices: dict[str, Device] = {}
        self._sessions = SessionRegistry()
        self._call = StageCaller(
            self._report_failure, on_call=on_call, strict=self._settings.strict, repack=self._settings.repack
        )
        self.intake: Counter[str] = Counter()
        self.measurements: Counter[str] = Counter()
        self._setup = KernelSetup(
            pipelines=tuple(pipelines),
            call=self._call,
            measurements=self.measurements,
            seed=self._settings.seed,
            horizon_ns=round(self._settings.horizon_s * 1e9),
            checkpoint_bytes=round(self._settings.checkpoint_mb * 2**20),
        )
        self.failures: Counter[str] = Counter()

    def feed(self, event: Event) -> MessageOutcome:
        """Take an event in; call :meth:`run` to fold what it makes due."""
        try:
            outcome = self._feed(event)
        except Exception as error:  # noqa: BLE001 - see _quarantine
            self._quarantine(event.device, error)
            outcome = MessageOutcome.MALFORMED
        self.intake[outcome.value] += 1
        return outcome

    def is_duplicate(self, event: Event) -> bool:
        """Tell whether the event would be a duplicate by its number, without taking note of it."""
        return self._sessions.is_duplicate(event)

    def progress(self, device: str) -> DeviceProgress | None:
        """Return how far a device has come, None for one that is not followed."""
        known = self._devices.get(device)
        return None if known is None else known.progress

    def run(self, device: str, tick: int | None = None, max_ticks: int | None = None) -> KernelOutput:
        """Fold what is due for a device; ``tick`` closes ticks up to it whether or not the data has passed them.

        At most ``max_ticks`` ticks are closed, unless it is None; :class:`DeviceProgress` shows whether more are due.
        """
        return self.run_many([(device, tick)], max_ticks)[0]

    def run_many(self, runs: Sequence[tuple[str, int | None]], max_ticks: int | None = None) -> list[KernelOutput]:
        """Run several devices, each named once: the same to the bit as one after the other, and cheaper.

        Filters that can step many devices at once do.
        """
        known = [(n, device, tick) for n, (device, tick) in enumerate(runs) if device in self._devices]
        outputs = [KernelOutput() for _ in runs]
        done = step_batch([self._devices[device].run(tick, max_ticks) for _, device, tick in known], self._call)
        for (n, device, _), output in zip(known, done, strict=True):
            if isinstance(output, Exception):
                self._quarantine(device, output)
            else:
                outputs[n] = output
        return outputs

    def abandon(self, device: str) -> None:
        """Forget a device that cannot be folded any more, without output; if it comes back, it restarts."""
        known = self._devices.pop(device, None)
        if known is not None:
            self._sessions.close(device, known.number + 1)

    def finish(self, device: str) -> KernelOutput:
        """Nothing more is expected from this device: fold and settle everything, and forget its past.

        The message numbers of its last two sessions are remembered, and should it come back, a new epoch begins: no
        tick is said twice.
        """
        known = self._devices.pop(device, None)
        if known is None:
            return KernelOutput()
        self._sessions.close(device, known.number + 1)
        try:
            return step_one(known.finish(), self._call)
        except Exception as error:  # noqa: BLE001 - see _quarantine
            self._quarantine(device, error)
            return KernelOutput()

    def forget(self, device: str) -> None:
        """Remember nothing of a device that was finished: should it come back, it is a new one."""
        self._sessions.forget(device)

    def fingerprint_requests(self, scan: Scan) -> list[FingerprintRequest]:
        """Return what the fingerprints will be asked once ``scan`` is fed.

        A driver may compute the answers elsewhere beforehand.
        """
        device = self._devices.get(scan.device) or self._begin(scan.device, 0)
        return device.fingerprint_requests(scan)

    def snapshot(self) -> KernelSnapshot:
        """Return the kernel as a value; every device must have been run since it was fed."""
        return KernelSnapshot(
            seed=self._settings.seed,
            horizon_s=self._settings.horizon_s,
            devices=tuple(device.snapshot() for device in self._devices.values()),
            sessions=self._sessions.snapshot(),
            closed_devices=tuple(self._sessions.closed_devices.items()),
            intake=tuple(sorted(self.intake.items())),
            measurements=tuple(sorted(self.measurements.items())),
            failures=tuple(sorted(self.failures.items())),
        )

    def restore(self, kept: KernelSnapshot) -> None:
        """Become what ``kept`` says; pipelines may be others than then, those that are new begin where they can.

        Devices are folded again side by side, as :meth:`run_many` does.

        Raises:
            ValueError: when seed or horizon are others than then: what follows would be too.
        """
        for name in ("seed", "horizon_s"):
            then, now = getattr(kept, name), getattr(self._settings, name)
            if then != now:
                raise ValueError(f"{name}: found {now}, the snapshot was taken with {then}")
        for begin in range(0, len(kept.devices), _RESTORE_BATCH):
            coroutines = []
            for found in kept.devices[begin : begin + _RESTORE_BATCH]:
                device = self._devices[found.device] = self._begin(found.device, found.number)
                coroutines.append(device.restore(found))
            for done in step_batch(coroutines, self._call):
                if isinstance(done, Exception):
                    raise done
        self._sessions.restore(kept.sessions, kept.closed_devices)
        for counter, counts in (
            (self.intake, kept.intake),
            (self.measurements, kept.measurements),
            (self.failures, kept.failures),
        ):
            counter.clear()  # what was folded again is not counted again
            counter.update(dict(counts))

    @property
    def devices(self) -> tuple[str, ...]:
        """The devices followed now, in the order of their first event."""
        return tuple(self._devices)

    @property
    def missing(self) -> int:
        """How many messages of the devices followed now were passed over by later ones and have not come."""
        return self._sessions.missing_count(self._devices)

    def _feed(self, event: Event) -> MessageOutcome:
        if isinstance(event, Truth):
            return MessageOutcome.ACCEPTED
        is_new, numbers = self._sessions.enter(event)
        if not is_new:
            return MessageOutcome.DUPLICATE
        device = self._devices.get(event.device)
        if device is None:
            device = self._devices[event.device] = self._begin(event.device, self._sessions.begin(event.device))
        if numbers is None:
            return device.feed(event)
        before = device.reached
        outcome = device.feed(event, out_of_order=event.seq < numbers.reached)
        if device.reached != before and event.seq <= numbers.highest:
            numbers.reached = max(numbers.reached, event.seq)
        return outcome

    def _quarantine(self, device: str, error: Exception) -> None:
        """Abandon a device that the kernel breaks on, here and in every repetition alike.

        No such device is known. Should there be one, then the others shall not have to go with it.
        """
        if self._settings.strict or isinstance(error, PluginError):
            raise error
        self.abandon(device)
        self._report_failure(
            StageFailure(QUARANTINED, type(error).__name__, "".join(traceback.format_exception(error)))
        )

    def _begin(self, device: str, number: int) -> Device:
        return Device(self._setup, device, known=None if number else self._starts.get(device), number=number)

    def _report_failure(self, failure: StageFailure) -> None:
        self.failures[str(failure)] += 1
        if self._on_failure is not None:
            self._on_failure(failure)
