"""Replaying recordings whose batches are of any length."""

from __future__ import annotations

import numpy as np

from tickfix import config
from tickfix.api import TICK_NS, Context, Fix, MotionSamples, Recording, Samples
from tickfix.registry import discover
from tickfix.replay.driver import ReplayResult, replay_recording

T0, SECOND, MINUTES = 1_000_000_000, 1_000_000_000, 25


def replayed(batches: list[MotionSamples]) -> ReplayResult:
    chosen = config.parse_config('[pipelines.p]\npdr = "steps"\nfilter = "dead-reckoning"', "test", discover())
    start = Fix(t_ns=T0, floor="F", xy=np.zeros(2), covariance=np.eye(2))
    recording = Recording(name="walk", floor="F", events=tuple(batches))
    return replay_recording(recording, config.build_pipelines(chosen.pipelines, Context(), {}), start=start)


def test_a_walk_in_one_batch_is_the_walk_in_seconds() -> None:
    t_ns = np.arange(T0, T0 + MINUTES * 60 * SECOND, SECOND // 10)
    shaking = 9.81 + 3.0 * np.sin(2 * np.pi * 1.8 * (t_ns - T0) * 1e-9)
    values = np.stack([np.zeros(len(t_ns)), np.zeros(len(t_ns)), shaking], axis=1)
    whole = MotionSamples(sensors={"accelerometer": Samples(t_ns, values)}, device="d")
    seconds = [
        MotionSamples(sensors={"accelerometer": Samples(t_ns[n : n + 10], values[n : n + 10])}, device="d")
        for n in range(0, len(t_ns), 10)
    ]
    at_once, bit_by_bit = replayed([whole]), replayed(seconds)
    for found in (at_once, bit_by_bit):
        assert {what: n for what, n in found.measurements.items() if n} == {"accepted": len(t_ns)}
    assert len(at_once.settled["p"]) == -(-int(t_ns[-1]) // TICK_NS) - T0 // TICK_NS + 1
    for one, other in zip(at_once.settled["p"], bit_by_bit.settled["p"], strict=True):
        assert one.belief is not None
        assert other.belief is not None
        assert one.belief.xy.tobytes() == other.belief.xy.tobytes()
