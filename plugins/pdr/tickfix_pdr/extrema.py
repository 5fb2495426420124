"""Local extrema of the length of the acceleration, sample by sample and causally.

The length |a| does not depend on how the phone is held. Its slow mean (gravity) is taken off; two poles smooth it, or
none where the raw signal is wanted. An extremum is known one sample after it was passed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from tickfix.api import Samples

_STANDARD_GRAVITY: Final = 9.81
_GRAVITY_S: Final = 2.0
_FIRST_DT_S: Final = 0.02
_SHORTEST_DT_S: Final = 1e-3
_LONGEST_DT_S: Final = 0.2


@dataclass(frozen=True, slots=True)
class SignalState:
    """Where the signal is.

    Attributes:
        t_ns: the last sample's time, −1 before the first.
        gravity, low_1, low_2: the slow mean and the two poles, m/s².
        rising: which way it went last; a signal that begins has come from nowhere and counts as falling.
    """

    t_ns: int = -1
    gravity: float = _STANDARD_GRAVITY
    low_1: float = 0.0
    low_2: float = 0.0
    rising: bool = False


@dataclass(frozen=True, slots=True)
class Extremum:
    """A local extremum: when, how far above (below: negative) the slow mean in m/s², and which kind."""

    t_ns: int
    a: float
    peak: bool


def fold_signal(state: SignalState, accelerometer: Samples, low_pass_hz: float) -> tuple[SignalState, list[Extremum]]:
    """Fold samples into the signal; return the new state and the extrema passed.

    Args:
        state: before the samples.
        accelerometer: (n, 3) m/s².
        low_pass_hz: corner of each of the two poles; 0 leaves the signal raw.
    """
    t_ns, gravity, low_1, low_2, rising = state.t_ns, state.gravity, state.low_1, state.low_2, state.rising
    extrema: list[Extremum] = []
    lengths = ((accelerometer.values**2).sum(axis=1) ** 0.5).tolist()
    for now_ns, length in zip(accelerometer.t_ns.tolist(), lengths, strict=True):
        dt = _FIRST_DT_S if t_ns < 0 else min(max((now_ns - t_ns) * 1e-9, _SHORTEST_DT_S), _LONGEST_DT_S)
        gravity += (length - gravity) * dt / (_GRAVITY_S + dt)
        gain = 1.0 if low_pass_hz == 0.0 else 1.0 - math.exp(-2.0 * math.pi * low_pass_hz * dt)
        low_1 += gain * (length - gravity - low_1)
        before = low_2
        low_2 += gain * (low_1 - low_2)
        if low_2 != before and (low_2 > before) != rising:
            if t_ns >= 0:
                extrema.append(Extremum(t_ns, before, rising))
            rising = not rising
        t_ns = now_ns
    return SignalState(t_ns, gravity, low_1, low_2, rising), extrema
