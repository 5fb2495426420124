"""The kernel: all devices, no I/O, no clock, no thread.

A driver feeds it events as they arrive and runs it; what comes back are estimates. Where events come from and how
waiting is done is the driver's affair.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from tickfix.api.events import Event, Fix, Truth
from tickfix.kernel.device import Device
from tickfix.kernel.epoch import Output
from tickfix.kernel.intake import Outcome
from tickfix.kernel.intake import Sequence as Numbers
from tickfix.kernel.stages import Caller, Failure, Pipeline


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


_SESSIONS = 16


class Kernel:
    """Folds events into estimates, for any number of devices and pipelines.

    Args:
        pipelines: in the order in which estimates of a tick are to come.
        starts: devices whose start is known.
        on_failure: told of every stage call that failed.
    """

    def __init__(
        self,
        pipelines: Sequence[Pipeline],
        settings: KernelSettings | None = None,
        *,
        starts: Mapping[str, Fix] = MappingProxyType({}),
        on_failure: Callable[[Failure], None] | None = None,
    ) -> None:
        """Begin with no device."""
        self._pipelines = tuple(pipelines)
        self._settings = KernelSettings() if settings is None else settings
        self._starts = starts
        self._on_failure = on_failure
        self._devices: dict[str, Device] = {}
        self._numbers: dict[str, dict[str, Numbers]] = {}
        self._call = Caller(self._failed, strict=self._settings.strict, repack=self._settings.repack)
        self.intake: Counter[str] = Counter()
        self.measurements: Counter[str] = Counter()
        self.failures: Counter[str] = Counter()

    def feed(self, event: Event) -> Outcome:
        """Take an event in; call :meth:`run` to fold what it makes due."""
        outcome = self._feed(event)
        self.intake[outcome.value] += 1
        return outcome

    def run(self, device: str, tick: int | None = None) -> Output:
        """Fold what is due for a device; ``tick`` closes ticks up to it whether or not the data has passed them."""
        return self._devices[device].run(tick) if device in self._devices else Output()

    def finish(self, device: str) -> Output:
        """Nothing more will come from this device: fold and settle everything, and forget it."""
        known = self._devices.pop(device, None)
        self._numbers.pop(device, None)
        return Output() if known is None else known.finish()

    @property
    def devices(self) -> tuple[str, ...]:
        """The devices followed now, in the order of their first event."""
        return tuple(self._devices)

    def _feed(self, event: Event) -> Outcome:
        if isinstance(event, Truth):
            return Outcome.ACCEPTED
        sessions = self._numbers.setdefault(event.device, {})
        if event.seq > 0:
            numbers = sessions.setdefault(event.session, Numbers())
            if len(sessions) > _SESSIONS:
                del sessions[next(iter(sessions))]
            if not numbers.is_new(event.seq):
                return Outcome.DUPLICATE
        device = self._devices.get(event.device)
        if device is None:
            device = self._devices[event.device] = Device(
                event.device,
                self._pipelines,
                self._call,
                self.measurements,
                seed=self._settings.seed,
                horizon_ns=round(self._settings.horizon_s * 1e9),
                checkpoint_bytes=round(self._settings.checkpoint_mb * 2**20),
                known=self._starts.get(event.device),
            )
        return device.feed(event)

    def _failed(self, failure: Failure) -> None:
        self.failures[str(failure)] += 1
        if self._on_failure is not None:
            self._on_failure(failure)
