"""The deterministic heart: order, ticks, rewinding, folding. It imports :mod:`tickfix.api` only."""

from tickfix.kernel.deduplication import MessageOutcome, SessionRegistry
from tickfix.kernel.device import DeviceProgress
from tickfix.kernel.epoch import KernelOutput
from tickfix.kernel.kernel import QUARANTINED, Kernel, KernelSettings
from tickfix.kernel.snapshot import KernelSnapshot
from tickfix.kernel.stages import Pipeline, Stage, StageFailure
from tickfix.kernel.tracker import FingerprintRequest

__all__ = [
    "QUARANTINED",
    "DeviceProgress",
    "FingerprintRequest",
    "Kernel",
    "KernelOutput",
    "KernelSettings",
    "KernelSnapshot",
    "MessageOutcome",
    "Pipeline",
    "SessionRegistry",
    "Stage",
    "StageFailure",
]
