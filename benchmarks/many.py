"""What a tick of a filter costs when many devices are folded together: people in a simulated office with walls.

    python benchmarks/many.py [PIPELINE …]

Prints for batches of several sizes the processor time per device and tick of the filter alone, a step and an estimate,
without the kernel around it: the median over the ticks. Every device walks one of the demo's walks from another moment
on, so that a batch is as mixed as it is live. Nobody starts within the measured time.
"""

from __future__ import annotations

import os
import platform
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from tickfix import config
from tickfix.api import Belief, Motion, Observation, Prior, Recording, Report, Rng
from tickfix.kernel import Pipeline
from tickfix.kernel.determinism import RandomStreams
from tickfix.registry import discover
from tickfix.replay.driver import replay_recording
from tickfix.replay.site_survey import site_context, survey_and_train
from tickfix.simulation import simulate_demo

SIZES = (1, 5, 25, 100)
STEPS = 2000
WARM = 50

Tick = tuple[Motion, Sequence[Observation]]


class Listening:
    """A filter that also writes down what it was given, by the time of the tick."""

    def __init__(self, algorithm: Any) -> None:
        """Listen to ``algorithm``."""
        self.algorithm, self.State = algorithm, algorithm.State
        self.ticks: dict[int, Tick] = {}

    def start(self, prior: Prior, rng: Rng) -> Any:
        """Start it."""
        return self.algorithm.start(prior, rng)

    def step(self, state: Any, motion: Motion, observations: Sequence[Observation], rng: Rng) -> tuple[Any, Report]:
        """Write it down."""
        self.ticks[motion.t1_ns] = (motion, observations)
        return self.algorithm.step(state, motion, observations, rng)  # type: ignore[no-any-return]

    def estimate(self, state: Any) -> Belief:
        """Ask it."""
        return self.algorithm.estimate(state)  # type: ignore[no-any-return]


def heard(recording: Recording, pipeline: Pipeline) -> list[Tick]:
    """Return what the pipeline's filter is given on a walk, tick by tick."""
    listening = Listening(pipeline.filter.algorithm)
    replay_recording(recording, [replace(pipeline, filter=replace(pipeline.filter, algorithm=listening))])
    return [listening.ticks[t_ns] for t_ns in sorted(listening.ticks)]


def device_tick_us(algorithm: Any, walks: Sequence[Sequence[Tick]], devices: int) -> Mapping[str, float]:
    """Return the time per device and tick in µs of ``step`` and of ``estimate``, for so many devices together."""
    streams = [RandomStreams(0, str(d)) for d in range(devices)]
    at = [7 * d for d in range(devices)]
    states = [first_state(algorithm, walks[d % len(walks)], streams[d]) for d in range(devices)]
    taken: dict[str, list[float]] = {"step": [], "estimate": []}
    for k in range(max(60, STEPS // devices) + WARM):
        ticks = [walks[d % len(walks)][(at[d] + k) % len(walks[d % len(walks)])] for d in range(devices)]
        rngs = [stream.at(0, k, "filter") for stream in streams]
        begun = time.process_time_ns()
        if hasattr(algorithm, "step_many"):
            motions, observations = [m for m, _ in ticks], [o for _, o in ticks]
            states = [state for state, _ in algorithm.step_many(states, motions, observations, rngs)]
            stepped = time.process_time_ns()
            algorithm.estimate_many(states)
        else:
            states = [algorithm.step(s, *tick, rng)[0] for s, tick, rng in zip(states, ticks, rngs, strict=True)]
            stepped = time.process_time_ns()
            for state in states:
                algorithm.estimate(state)
        ended = time.process_time_ns()
        if k >= WARM:
            taken["step"].append((stepped - begun) / devices / 1e3)
            taken["estimate"].append((ended - stepped) / devices / 1e3)
    # A mean over the ticks, since ticks differ; of blocks of them, so that a disturbed one does not count.
    return {name: statistics.median(np.mean(part) for part in np.array_split(us, 10)) for name, us in taken.items()}


def first_state(algorithm: Any, walk: Sequence[Tick], streams: RandomStreams) -> Any:
    """Return the state at the first fix of a walk."""
    fix = next(o.fix for _, observations in walk for o in observations if o.fix is not None)
    return algorithm.start(Prior(t_ns=fix.t_ns, fix=fix), streams.at(0, 0, "start"))


def main() -> None:
    """Measure and print."""
    chosen = config.load_config(None, discover())
    world = simulate_demo(seed=0)
    recordings = [walk.recording for walk in world.survey]
    site = survey_and_train(recordings, world.building.floors, chosen.pipelines, name="demo").site
    names = sys.argv[1:] or ["fusion", "kalman"]
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    print(f"one thread, {machine}, numpy {np.__version__}; µs of one device's tick")
    for wanted in chosen.pipelines:
        if wanted.name in names:
            pipeline = config.build_pipelines([wanted], site_context(site), site.models)[0]
            walks = [heard(walk.recording, pipeline) for walk in world.walks]
            for devices in SIZES:
                us = device_tick_us(pipeline.filter.algorithm, walks, devices)
                told = ", ".join(f"{name} {value:4.0f}" for name, value in us.items())
                print(f"  {wanted.name:8s} {devices:4d} together: {sum(us.values()):5.0f} µs a tick ({told})")


if __name__ == "__main__":
    main()
