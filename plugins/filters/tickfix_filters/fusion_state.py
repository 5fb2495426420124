"""What ``fusion-pf`` carries from tick to tick."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final

from tickfix.api import Floats, Motion
from tickfix_filters.floors import OnFloor


@dataclass(frozen=True, slots=True)
class BiasPrior:
    """What motion said of its own biases: standard deviations, and whether there is a compass."""

    heading_rad: float
    scale: float
    compass: bool


@dataclass(frozen=True, slots=True)
class Unseen:
    """How unsure a walk since the last fix is, where particles that are weighed by it do not spread.

    Attributes:
        walked_m: since then; with ``bias``, the relative error that a walk keeps, how far it may have led astray.
        white_m2: variance of the ticks' ways.
    """

    walked_m: float = 0.0
    bias: float = 0.0
    white_m2: float = 0.0

    def after(self, motion: Motion) -> Unseen:
        """Return it after a tick."""
        white_m2 = motion.distance_sigma_m**2 + (motion.distance_m * min(motion.heading_sigma_rad, 1.0)) ** 2
        bias = math.hypot(motion.distance_scale_sigma, min(motion.heading_bias_sigma_rad, 1.0))
        return Unseen(self.walked_m + motion.distance_m, bias, self.white_m2 + white_m2)

    @property
    def variance_m2(self) -> float:
        """Per axis."""
        return 0.5 * (self.white_m2 + (self.bias * self.walked_m) ** 2)


@dataclass(frozen=True, slots=True)
class Particles:
    """N particles.

    Attributes:
        on: the floor all are on.
        xy: (N, 2) metres.
        bias_rad, scale: (N,) of the heading, and of the length of steps.
        error: (N, 2) of the last fix in multiples of its σ, if the particle is right.
        log_weights: (N,).
        surprise: running mean of the squared distance between fixes and particles' mean, in σ² per axis; about one when
            all is well.
        astray: (2,) metres, running mean of the way from the particles' mean to the fixes.
        trust: at most one, how far the last fix says that a survey came here.
        motion: what motion said of its own biases, None before the first.
        unseen: what weighing by the motion result hides.
    """

    on: OnFloor
    xy: Floats
    bias_rad: Floats
    scale: Floats
    error: Floats
    log_weights: Floats
    fixed_ns: int
    astray: Floats
    heading_rad: float | None = None
    speed_mps: float = 0.0
    surprise: float = 1.0
    trust: float = 1.0
    motion: BiasPrior | None = None
    unseen: Unseen = Unseen()


_TOGETHER: Final = 16384  # particles in a batch: their arrays stay in the processor's cache


def batches(states: Sequence[Particles]) -> Iterator[slice]:
    """Cut the states of many devices into runs that can be computed together: as many particles each, and not too many.

    How they are cut changes no bits.
    """
    begin = 0
    for n, run in groupby(states, lambda state: len(state.xy)):
        end = begin + len(list(run))
        at_once = max(1, _TOGETHER // n)
        for first in range(begin, end, at_once):
            yield slice(first, min(first + at_once, end))
        begin = end
