"""What the phone of the person who walks measures: the samples of a tick."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tickfix.api import TICK_NS, MotionSamples, Samples, frozen
from tickfix.testing.world.walks import T0_NS, place

SENSORS: Final = ("accelerometer", "gyroscope", "magnetometer", "rotation_vector")
_RATE_HZ: Final = 50


def samples(
    tick: int, sensors: Sequence[str] = SENSORS, *, walking: bool = True, rate_hz: int = _RATE_HZ, t0_ns: int = T0_NS
) -> MotionSamples:
    """Return the samples of a tick: a phone held flat, pointing where the person walks, nearly two steps a second."""
    end_ns = t0_ns + tick * TICK_NS
    n = max(1, rate_hz * TICK_NS // 1_000_000_000)
    t_ns = frozen(end_ns - TICK_NS + (np.arange(1, n + 1) * TICK_NS) // n, np.int64)
    t_s = (t_ns - t0_ns) * 1e-9
    heading = np.array([place(t)[1] for t in t_s.tolist()]) if walking else np.zeros(n)
    zero, one = np.zeros(n), np.ones(n)
    bounce = 2.5 * np.sin(2 * np.pi * 1.9 * t_s) if walking else zero
    values = {
        "accelerometer": np.column_stack([zero, zero, 9.81 + bounce]),
        "gyroscope": np.column_stack([zero, zero, zero]),
        "magnetometer": np.column_stack([-20.0 * np.sin(heading), 20.0 * np.cos(heading), -45.0 * one]),
        "rotation_vector": np.column_stack([zero, zero, -np.sin(heading / 2), np.cos(heading / 2)]),
    }
    return MotionSamples(
        sensors={name: Samples(t_ns, frozen(values[name])) for name in sensors}, t0_ns=end_ns - TICK_NS, t1_ns=end_ns
    )
