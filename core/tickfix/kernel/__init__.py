"""The deterministic heart: order, ticks, rewinding, folding. It imports :mod:`tickfix.api` only."""

from tickfix.kernel.device import Standing
from tickfix.kernel.epoch import Output
from tickfix.kernel.intake import Outcome
from tickfix.kernel.kernel import LOST, Kernel, KernelSettings
from tickfix.kernel.observing import Question
from tickfix.kernel.sessions import Sessions
from tickfix.kernel.snapshot import KernelSnapshot
from tickfix.kernel.stages import Failure, Pipeline, Stage

__all__ = [
    "LOST",
    "Failure",
    "Kernel",
    "KernelSettings",
    "KernelSnapshot",
    "Outcome",
    "Output",
    "Pipeline",
    "Question",
    "Sessions",
    "Stage",
    "Standing",
]
