"""What the loop and its executors exchange.

Steps, their results, encoded estimates and counters, the requests to worker processes, and the errors of an engine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Protocol, TypeAlias

import msgspec

from tickfix.api import Estimate, Event, Scan, TickfixError
from tickfix.kernel import DeviceProgress, MessageOutcome
from tickfix.live.localization import LocalizationResult
from tickfix.wire import encode_estimate, encode_event
from tickfix.wire.engine_messages import Decision, encode_decision


class EngineError(TickfixError):
    """An engine that cannot begin or go on."""

    kind: ClassVar[str] = "engine"


class WorkerError(EngineError):
    """A worker process of an engine is gone, and with it what it had folded; the journal has all of it.

    Attributes:
        signal: that ended it, 0 if none did.
    """

    kind: ClassVar[str] = "engine_worker"

    def __init__(self, text: str, signal: int = 0) -> None:
        """Keep the text, and the signal."""
        super().__init__(text)
        self.signal = signal


class OverrunError(EngineError):
    """An engine fell behind whose overrun policy is ``fail``."""

    kind: ClassVar[str] = "engine_overrun"


class EncodedEstimate(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """An estimate that was encoded where it was made.

    Attributes:
        body: the estimate's bytes, as they are journaled and published.
        device, pipeline, tick, t_ns, revision, innovation_m, nis: the estimate's.
        floor, xy: of its belief, (x, y) in metres; None as long as there is none.
    """

    body: bytes
    device: str
    pipeline: str
    tick: int
    t_ns: int
    revision: int
    floor: str | None
    xy: tuple[float, float] | None
    innovation_m: float | None
    nis: float | None

    @classmethod
    def of(cls, estimate: Estimate) -> EncodedEstimate:
        """Encode an estimate."""
        belief = estimate.belief
        floor = xy = None
        if belief is not None:
            x_m, y_m = belief.xy.tolist()
            floor, xy = belief.floor, (x_m, y_m)
        return cls(
            encode_estimate(estimate),
            estimate.device,
            estimate.pipeline,
            estimate.tick,
            estimate.t_ns,
            estimate.revision,
            floor,
            xy,
            estimate.innovation_m,
            estimate.nis,
        )


@dataclass(frozen=True, slots=True)
class FeedEvent:
    """An event enters, as the record of this number; ``body`` are its canonical bytes, where they are known."""

    number: int
    event: Event
    body: bytes | None = None


ReplicaStep: TypeAlias = FeedEvent | Decision


class ReplicaStepResult(msgspec.Struct, frozen=True, array_like=True):
    """What came of a step.

    Attributes:
        outcome: of the event, or of the scan that a decision let in; None where there is none, or it waits.
        estimates: estimates in the order in which they are journaled: what late events revised, what closed a tick, and
            what was smoothed.
        must_journal: whether the journal must have the decision: there are estimates, or ticks were settled.
        progress: how far the device has come; None for one that is not followed.
        fixes: encoded fixes of ticks that settled; empty unless a plugin observes them.
        faults: calls of stages that failed, as stage, error and detail; empty unless a plugin observes them.
    """

    outcome: MessageOutcome | None = None
    estimates: tuple[EncodedEstimate, ...] = ()
    must_journal: bool = False
    progress: DeviceProgress | None = None
    fixes: tuple[bytes, ...] = ()
    faults: tuple[tuple[str, str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class ReplicaCounters:
    """Counters: devices followed, measurements by what became of them, messages missing, failures by stage."""

    devices: int
    measurements: Mapping[str, int]
    missing: int
    failures: Mapping[str, int]


class Executor(Protocol):
    """Applies events and decisions, in their order; devices have nothing to do with each other."""

    @property
    def primary(self) -> str:
        """The pipeline that is published; empty means that none was chosen."""

    @property
    def waiting(self) -> Mapping[int, Scan]:
        """Scans that no decision has spoken of yet, by the number of their record."""

    def apply(self, steps: Sequence[ReplicaStep]) -> list[ReplicaStepResult]:
        """Apply the steps in order and return the result of each."""

    def is_duplicate(self, event: Event) -> bool:
        """Tell whether the event would be a duplicate by its number; changes nothing."""

    def progress_by_device(self) -> Mapping[str, DeviceProgress]:
        """Return how far each device has come."""

    def counters(self) -> ReplicaCounters:
        """Return the counters as they are now."""

    def snapshot(self) -> bytes:
        """Return all of it as bytes; every device must have been run since it was fed."""

    def restore(self, data: bytes) -> None:
        """Become what the bytes say.

        Raises:
            ValueError: when they are no snapshot, or one of a run with other settings.
        """


class EncodedEvent(msgspec.Struct, frozen=True, array_like=True, tag=0):
    """An event enters, as canonical bytes."""

    number: int
    body: bytes


class EncodedDecision(msgspec.Struct, frozen=True, array_like=True, tag=1):
    """A decision, as its bytes."""

    body: bytes


class ForgetDevice(msgspec.Struct, frozen=True, array_like=True, tag=2):
    """A device that was finished is remembered no more; nothing comes of it."""

    device: str


WorkerStep: TypeAlias = EncodedEvent | EncodedDecision | ForgetDevice


class ApplySteps(msgspec.Struct, frozen=True, array_like=True, tag=0):
    """Apply these in order; the answer is a list with the result of each, except of :class:`ForgetDevice`."""

    entries: list[WorkerStep]


class LocateScan(msgspec.Struct, frozen=True, array_like=True, tag=1):
    """Locate the scan that waits under this number, beside the work; a notice tells when it is done."""

    number: int


class GetCounters(msgspec.Struct, frozen=True, array_like=True, tag=2):
    """The answer is a :class:`WorkerCounters`."""


class TakeSnapshot(msgspec.Struct, frozen=True, array_like=True, tag=3):
    """The answer is a :class:`WorkerSnapshot`."""


class RestoreSnapshot(msgspec.Struct, frozen=True, array_like=True, tag=4):
    """Restore this snapshot; the answer is a :class:`RestoreResult`."""

    snapshot: bytes


class Shutdown(msgspec.Struct, frozen=True, array_like=True, tag=5):
    """Nothing more will be asked: end."""


WorkerRequest: TypeAlias = ApplySteps | LocateScan | GetCounters | TakeSnapshot | RestoreSnapshot | Shutdown


class WorkerCounters(msgspec.Struct, frozen=True, array_like=True):
    """The counters of a worker."""

    measurements: dict[str, int]
    missing: int
    failures: dict[str, int]


class WorkerSnapshot(msgspec.Struct, frozen=True, array_like=True):
    """A worker's devices, each by name with its packed snapshot, and its kernel's snapshot without them.

    Or else why there is none.
    """

    devices: list[tuple[str, bytes]]
    kernel: bytes
    error: str = ""


class RestoreResult(msgspec.Struct, frozen=True, array_like=True):
    """How far each device has come; or why the snapshot cannot be used."""

    progress_by_device: dict[str, DeviceProgress]
    error: str = ""


def encode_step(step: ReplicaStep) -> WorkerStep:
    """Return what a worker is sent of a step."""
    if isinstance(step, FeedEvent):
        return EncodedEvent(step.number, encode_event(step.event) if step.body is None else step.body)
    return EncodedDecision(encode_decision(step))


_ENCODER: Final = msgspec.msgpack.Encoder()
REQUEST_DECODER: Final[msgspec.msgpack.Decoder[WorkerRequest]] = msgspec.msgpack.Decoder(WorkerRequest)
RESULTS_DECODER: Final = msgspec.msgpack.Decoder(list[ReplicaStepResult])
COUNTERS_DECODER: Final = msgspec.msgpack.Decoder(WorkerCounters)
SNAPSHOT_DECODER: Final = msgspec.msgpack.Decoder(WorkerSnapshot)
RESTORE_DECODER: Final = msgspec.msgpack.Decoder(RestoreResult)
COMPLETIONS_DECODER: Final = msgspec.msgpack.Decoder(list[LocalizationResult])


def encode_message(message: Any) -> bytes:
    """Return the bytes of a message, or of a list of them."""
    return _ENCODER.encode(message)
