"""What every dead-reckoning algorithm must keep."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import combinations
from typing import Any

import numpy as np

from tickfix.api import TICK_NS, Motion, MotionSamples, Samples, frozen, pack, unpack
from tickfix.testing import world
from tickfix.testing.contract import StateContract, pure_call, require, require_step_pair
from tickfix.testing.stage_batches import check_stage_step_many, sample_inputs

_DAY_TICKS = 432_000


class PdrContract(StateContract):
    """Checks of a dead-reckoning algorithm: ``class TestMine(PdrContract): algorithm = Mine``.

    Set in the subclass, where it does not fit:
        scale: the distance of a walk at 1.2 m/s is right within this factor either way; None: it measures no distance.
    """

    scale: float | None = 2.5

    def states(self) -> Iterator[Any]:
        """Yield the states of a walk."""
        for state, _ in self._fold(world.samples(k) for k in range(1, 150)):
            yield state

    def test_motion_covers_the_tick_and_is_finite(self) -> None:
        """From the samples' t0 to their t1, distances and uncertainties ≥ 0, headings within ±π."""
        self._survives(world.samples(k) for k in range(1, 200))

    def test_any_sensors_may_be_absent(self) -> None:
        """Phones differ: every subset of the sensors, and none at all."""
        for n in range(len(world.SENSORS) + 1):
            for sensors in combinations(world.SENSORS, n):
                self._survives(world.samples(k, sensors) for k in range(1, 40))

    def test_sensors_may_come_and_go(self) -> None:
        """In any tick another subset."""
        subsets = [s for n in range(5) for s in combinations(world.SENSORS, n)]
        self._survives(world.samples(k, subsets[7 * k % len(subsets)]) for k in range(1, 120))

    def test_ticks_may_be_empty_for_minutes(self) -> None:
        """Sensors that were switched off and on again."""
        self._survives(world.samples(k, world.SENSORS if k < 30 or k > 400 else ()) for k in range(1, 450))

    def test_a_tick_may_hold_one_sample_or_hundreds(self) -> None:
        """From 5 to 1000 Hz."""
        for rate_hz in (5, 20, 100, 1000):
            self._survives(world.samples(k, rate_hz=rate_hz) for k in range(1, 30))

    def test_it_survives_wild_values(self) -> None:
        """A dropped phone, a magnet, a broken sensor: finite, but anything."""
        rng = world.rng(11)

        def wild() -> Iterator[MotionSamples]:
            for k in range(1, 60):
                good = world.samples(k)
                scale = (1.0, 0.0, 1e6)[k // 3 % 3]
                sensors = {
                    name: Samples(s.t_ns, frozen(scale * s.values * rng.normal(1.0, 0.3, s.values.shape)))
                    for name, s in good.sensors.items()
                }
                yield MotionSamples(sensors=sensors, t0_ns=good.t0_ns, t1_ns=good.t1_ns)

        self._survives(wild())

    def test_distances_add_up(self) -> None:
        """``travelled_m`` is the sum of the distances since the epoch began."""
        total = 0.0
        for _, motion in self._fold(world.samples(k) for k in range(1, 150)):
            total += motion.distance_m
            message = (
                f"travelled_m = {motion.travelled_m:.3f}, but the distances sum to {total:.3f} m. Carry it in the state"
            )
            require(abs(motion.travelled_m - total) < 1e-6 * (1.0 + total), message)

    def test_a_walk_has_about_its_length(self) -> None:
        """A synthetic gait is no person, so that only gross errors show."""
        if self.scale is None:
            return
        travelled = [motion.travelled_m for _, motion in self._fold(world.samples(k) for k in range(1, 301))][-1]
        true_m = world.SPEED_MPS * 60
        message = f"a walk of {true_m:.0f} m came out {travelled:.0f} m long"
        require(true_m / self.scale <= travelled <= true_m * self.scale, message)

    def test_a_phone_at_rest_goes_nowhere(self) -> None:
        """After ten seconds on a table there are no steps."""
        motions = [m for _, m in self._fold(world.samples(k, walking=False) for k in range(1, 101))]
        way_m = sum(m.distance_m for m in motions[50:])
        require(way_m < 0.1, f"a phone on a table walked {way_m:.2f} m in ten seconds")

    def test_when_it_happened_does_not_matter(self) -> None:
        """A device's clock starts anywhere: the same samples at another time are the same motion."""
        here = [m for _, m in self._fold(world.samples(k) for k in range(1, 80))]
        for t0_ns in (0, world.T0_NS + _DAY_TICKS * TICK_NS):
            there = [m for _, m in self._fold(world.samples(k, t0_ns=t0_ns) for k in range(1, 80))]
            for a, b in zip(here, there, strict=True):
                same = math.isclose(a.distance_m, b.distance_m, abs_tol=1e-6) and a.steps == b.steps
                require(
                    same, f"with the clock at {t0_ns} ns the motion is another one. Subtract times before using floats"
                )

    def test_a_step_is_a_function_of_its_arguments(self) -> None:
        """The same state and samples give the same bits, again and in another instance."""
        one, two = self.make(), self.make()
        state = self._start(one)
        for k in range(1, 60):
            samples, before = world.samples(k), pack(state)
            first, again, other = (self._step(a, state, samples) for a in (one, one, two))
            same = pack(first[0]) == pack(again[0]) == pack(other[0]) and first[1] == again[1] == other[1]
            require(same, "step gave two results for the same arguments. Keep nothing outside of the state")
            require(pack(state) == before, "step changed the state it was given. Return a new state")
            state = first[0]

    def test_an_unpacked_state_goes_on_like_the_one_packed(self) -> None:
        """A restarted process continues bit for bit."""
        algorithm = self.make()
        state = self._start(algorithm)
        for k in range(1, 60):
            again = unpack(pack(state), self.algorithm.State)
            kept, unpacked = (self._step(algorithm, s, world.samples(k)) for s in (state, again))
            same = pack(kept[0]) == pack(unpacked[0]) and kept[1] == unpacked[1]
            require(same, "an unpacked state goes on differently: does State hold all that step uses?")
            state = kept[0]

    def test_it_runs_for_thousands_of_ticks(self) -> None:
        """Nothing may creep out of bounds."""
        self._survives(world.samples(k) for k in range(1, 3000))

    def test_many_devices_at_once_are_stepped_as_each_alone(self) -> None:
        """Only for a pdr with ``step_many``: the grouping of devices changes no bits."""
        if hasattr(self.algorithm, "step_many"):
            check_stage_step_many(self.make(), sample_inputs(40), Motion)

    def _survives(self, ticks: Iterable[MotionSamples]) -> None:
        for samples, (_, motion) in self._with_samples(ticks):
            _check_motion(motion, samples)

    def _with_samples(self, ticks: Iterable[MotionSamples]) -> Iterator[tuple[MotionSamples, tuple[Any, Motion]]]:
        algorithm = self.make()
        state = self._start(algorithm)
        for samples in ticks:
            state, motion = self._step(algorithm, state, samples)
            yield samples, (state, motion)

    def _fold(self, ticks: Iterable[MotionSamples]) -> Iterator[tuple[Any, Motion]]:
        for _, pair in self._with_samples(ticks):
            yield pair

    @staticmethod
    def _start(algorithm: Any) -> Any:
        with pure_call("start"):
            return algorithm.start()

    @staticmethod
    def _step(algorithm: Any, state: Any, samples: MotionSamples) -> tuple[Any, Motion]:
        with pure_call(f"step with {', '.join(samples.sensors) or 'no sensors'}"):
            returned = algorithm.step(state, samples)
        return require_step_pair(returned, Motion)


def _check_motion(motion: Motion, samples: MotionSamples) -> None:
    covers = (motion.t0_ns, motion.t1_ns) == (samples.t0_ns, samples.t1_ns)
    require(covers, f"motion covers ({motion.t0_ns}, {motion.t1_ns}], the tick is ({samples.t0_ns}, {samples.t1_ns}]")
    for name in _NOT_NEGATIVE:
        value = getattr(motion, name)
        require(np.isfinite(value) and value >= 0, f"motion has {name} = {value}, expected a finite number ≥ 0")
    require(np.isfinite(motion.turn_rad), f"motion has turn_rad = {motion.turn_rad}")
    heading = motion.heading_rad
    within = heading is None or abs(heading) <= math.pi + 1e-9
    require(within, f"motion has heading_rad = {heading}, expected one within ±π, or None. Use wrap_rad")


_NOT_NEGATIVE = (
    "distance_m",
    "distance_sigma_m",
    "distance_scale_sigma",
    "heading_sigma_rad",
    "heading_bias_sigma_rad",
    "turn_sigma_rad",
    "turn_bias_sigma_rad",
    "steps",
    "travelled_m",
)
