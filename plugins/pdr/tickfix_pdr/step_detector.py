"""Finding steps in the length of the acceleration, sample by sample and causally.

The length |a| does not depend on how the phone is held. Less its slow mean (gravity) and smoothed by two poles, it
rises and falls once a step. A step is a peak followed by a valley, both by hysteresis rather than by a window, so that
it is reported as soon as it is certain. The way it spans gives the step's length: [weinberg2002] Weinberg, "Using the
ADXL202 in pedometer and personal navigation applications", Analog Devices AN-602.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from tickfix.api import Samples

_STANDARD_GRAVITY: Final = 9.81
_GRAVITY_S: Final = 2.0
_SHORTEST_DT_S: Final = 1e-3
_LONGEST_DT_S: Final = 0.2


@dataclass(frozen=True, slots=True)
class GaitState:
    """Where in a step the signal is.

    Attributes:
        t_ns: the last sample's time, −1 before the first.
        gravity, low_1, low_2: the slow mean and the two poles, m/s².
        falling: a peak was passed and its valley is awaited.
        peak, peak_ns, valley: extremes of the step under way, m/s².
        last_peak_ns: peak of the last step, −1 before the first.
    """

    t_ns: int = -1
    gravity: float = _STANDARD_GRAVITY
    low_1: float = 0.0
    low_2: float = 0.0
    falling: bool = False
    peak: float = -math.inf
    peak_ns: int = -1
    valley: float = math.inf
    last_peak_ns: int = -1


@dataclass(frozen=True, slots=True)
class Step:
    """A step: when its peak was, and how far the signal fell from there, m/s²."""

    peak_ns: int
    amplitude: float


def detect_steps(
    state: GaitState, accelerometer: Samples, *, low_pass_hz: float, threshold: float, shortest_s: float
) -> tuple[GaitState, list[Step]]:
    """Fold samples into the gait; return the new state and the steps completed.

    Args:
        state: before the samples.
        accelerometer: (n, 3) m/s².
        low_pass_hz: corner of each of the two poles.
        threshold: a peak stands out by at least this, m/s²; a step falls by more than twice as much.
        shortest_s: peaks closer than this belong to one step.
    """
    t_ns, gravity, low_1, low_2 = state.t_ns, state.gravity, state.low_1, state.low_2
    falling, peak, peak_ns, valley, last_ns = (
        state.falling,
        state.peak,
        state.peak_ns,
        state.valley,
        state.last_peak_ns,
    )
    steps: list[Step] = []
    lengths = ((accelerometer.values**2).sum(axis=1) ** 0.5).tolist()
    for now_ns, length in zip(accelerometer.t_ns.tolist(), lengths, strict=True):
        dt = 0.02 if t_ns < 0 else min(max((now_ns - t_ns) * 1e-9, _SHORTEST_DT_S), _LONGEST_DT_S)
        t_ns = now_ns
        gravity += (length - gravity) * dt / (_GRAVITY_S + dt)
        gain = 1.0 - math.exp(-2.0 * math.pi * low_pass_hz * dt)
        low_1 += gain * (length - gravity - low_1)
        low_2 += gain * (low_1 - low_2)
        if not falling:
            if low_2 > peak:
                peak, peak_ns = low_2, now_ns
            elif low_2 < peak - threshold:
                if peak > threshold and (last_ns < 0 or (peak_ns - last_ns) * 1e-9 >= shortest_s):
                    falling, valley = True, low_2
                else:
                    peak, peak_ns = low_2, now_ns  # too small or too soon: follow the signal down
        elif low_2 < valley:
            valley = low_2
        elif low_2 > valley + threshold or low_2 > 0.0:
            if peak - valley > 2.0 * threshold:
                steps.append(Step(peak_ns, peak - valley))
                last_ns = peak_ns
            falling, peak, peak_ns = False, low_2, now_ns
    return GaitState(t_ns, gravity, low_1, low_2, falling, peak, peak_ns, valley, last_ns), steps
