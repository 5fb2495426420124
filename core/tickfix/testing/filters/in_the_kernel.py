"""A filter in the real kernel."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from tickfix.api import TICK_NS, Estimate, Fix, Motion, MotionSamples, Stateless, motion_samples
from tickfix.kernel import Kernel, KernelSettings, Pipeline, Stage
from tickfix.testing import world
from tickfix.testing.calls import require, told
from tickfix.testing.filters.walking import WalkedFilter


class FilterInTheKernel(WalkedFilter):
    """Checks of the whole of it."""

    def test_the_kernel_settles_the_same_track_when_fixes_come_late(self) -> None:
        """The whole of it in the real kernel, every state packed and unpacked, every failure raised."""
        tracks = []
        for delay in (0, 17):
            kernel = Kernel([self._pipeline()], KernelSettings(strict=True, repack=True))
            arrivals: list[tuple[int, Fix | MotionSamples]] = []
            for tick in world.walk(100):
                times = [tick.motion.t1_ns - 100_000_000, tick.motion.t1_ns]
                arrivals.append((tick.number, motion_samples(times, accelerometer=np.ones((2, 3)), device="d")))
                late = tick.number + delay * (tick.number % 20 == 0)
                arrivals += [(late, dataclasses.replace(o.fix, device="d")) for o in tick.observations if o.fix]
            settled: list[Estimate] = []
            with told("running in the kernel"):
                for _, event in sorted(arrivals, key=lambda pair: pair[0]):
                    kernel.feed(event)
                    settled += kernel.run("d").settled
                settled += kernel.finish("d").settled
            tracks.append([e.belief.xy.tobytes() if e.belief is not None else b"" for e in settled])
        require(any(tracks[0]), "the kernel's track has no belief at all, though there were fixes")
        require(tracks[0] == tracks[1], "late fixes settled to another track: step depends on more than its arguments")

    def _pipeline(self) -> Pipeline:
        kind, name = self.algorithm.kind, self.algorithm.name
        return Pipeline("mine", Stage(kind, name, name, self.make()), Stage("pdr", "world", "world", _WorldPdr()))


class _WorldPdr:
    """Plays the motion of the world's walk, whatever the samples."""

    State = Stateless

    def __init__(self) -> None:
        self._motions: Sequence[Motion] = [tick.motion for tick in world.walk(200)]

    def start(self) -> Stateless:
        """Return the empty state."""
        return Stateless()

    def step(self, state: Stateless, samples: MotionSamples) -> tuple[Stateless, Motion]:
        """Look up the tick."""
        n = (samples.t1_ns - world.T0_NS) // TICK_NS - 1
        known = 0 <= n < len(self._motions)
        return state, self._motions[n] if known else Motion.unknown(samples.t0_ns, samples.t1_ns)
