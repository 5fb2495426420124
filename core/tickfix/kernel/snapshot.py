"""What a kernel is, at an instant, as values that can be packed: enough to go on to the same bytes.

Of each fold only the oldest checkpoint is kept: what came after it is folded again from the timeline, which is a pure
function of both. So a snapshot stays small, and knows nothing of how a fold thins its checkpoints.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from tickfix.api.arrays import Floats, Ints
from tickfix.api.events import Fix, Scan
from tickfix.api.packing import pack, unpack
from tickfix.api.values import Belief


@dataclass(frozen=True, slots=True, eq=False)
class StreamSnapshot:
    """One sensor's samples within the kept intervals: times (n,), rows (n, c)."""

    stream: str
    t_ns: Ints
    rows: Floats


@dataclass(frozen=True, slots=True, eq=False)
class HeldSnapshot:
    """A measurement that waits for others to confirm its time; ``votes`` unless the clock went on since it came."""

    t_ns: int
    stream: str
    row: tuple[float, ...]
    scan: Scan | None
    fix: Fix | None
    ahead: bool
    votes: bool


@dataclass(frozen=True, slots=True, eq=False)
class ClockSnapshot:
    """What a device's clock has shown."""

    latest_ns: int | None
    last_ns: tuple[tuple[str, int], ...]
    held: tuple[HeldSnapshot, ...]


@dataclass(frozen=True, slots=True, eq=False)
class TimelineSnapshot:
    """What was measured and may be folded again; ``changed`` are the earliest changed ticks: motion, scans, fixes."""

    first: int | None
    closed: int | None
    since: int | None
    streams: tuple[StreamSnapshot, ...]
    scans: tuple[Scan, ...]
    fixes: tuple[Fix, ...]
    clock: ClockSnapshot
    changed: tuple[int | None, int | None, int | None]


@dataclass(frozen=True, slots=True, eq=False)
class WaitingSnapshot:
    """A scan whose fix describes an instant to come, and the fingerprint's state before it, packed."""

    scan: Scan
    state: bytes


@dataclass(frozen=True, slots=True, eq=False)
class FoldSnapshot:
    """A fold's oldest checkpoint: the state after ``tick``, packed; None before the stage has begun.

    Attributes:
        key: of the stage, or of the pipeline whose belief it is.
        tick: the checkpoint's.
        state: the stage's.
        waiting: of a fingerprint.
        belief, motion_ns, used_ns: of a pipeline.
    """

    key: str
    tick: int
    state: bytes | None
    waiting: tuple[WaitingSnapshot, ...] = ()
    belief: Belief | None = None
    motion_ns: int | None = None
    used_ns: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class EpochSnapshot:
    """One epoch of a device's clock."""

    timeline: TimelineSnapshot
    began: int | None
    published: int | None
    settled: int | None
    revisions: tuple[tuple[int, int], ...]
    folds: tuple[FoldSnapshot, ...]


@dataclass(frozen=True, slots=True, eq=False)
class DeviceSnapshot:
    """A device: the number of its epoch, and what is in it."""

    device: str
    number: int
    epoch: EpochSnapshot


@dataclass(frozen=True, slots=True, eq=False)
class SessionSnapshot:
    """The message numbers seen in one session: the highest, as bits those missing below it, and the highest that took
    the clock further.
    """

    device: str
    session: str
    highest: int
    gaps: bytes
    reached: int


@dataclass(frozen=True, slots=True, eq=False)
class KernelSnapshot:
    """All of a kernel.

    Attributes:
        seed, horizon_s: settings that what follows depends on.
        devices: in their order.
        sessions: in their order, device by device.
        closed_devices: devices that were forgotten, with the number of their next epoch.
        intake, measurements, failures: counters.
    """

    seed: int
    horizon_s: float
    devices: tuple[DeviceSnapshot, ...] = ()
    sessions: tuple[SessionSnapshot, ...] = ()
    closed_devices: tuple[tuple[str, int], ...] = ()
    intake: tuple[tuple[str, int], ...] = field(default=())
    measurements: tuple[tuple[str, int], ...] = field(default=())
    failures: tuple[tuple[str, int], ...] = field(default=())

    def packed(self) -> bytes:
        """Return the bytes of the snapshot."""
        return pack(self)

    @staticmethod
    def unpacked(data: bytes) -> KernelSnapshot:
        """Return the snapshot whose bytes these are.

        Raises:
            ValueError: when they are none.
        """
        return unpack(data, KernelSnapshot)
