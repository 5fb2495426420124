"""What every filter must keep: the contract itself, purity, robustness, and the same settled track in the real
kernel when fixes come late."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from tickfix.api import (
    TICK_NS,
    Belief,
    Context,
    Estimate,
    Fix,
    Motion,
    MotionSamples,
    Observation,
    Prior,
    Report,
    Stateless,
    motion_samples,
    pack,
    unpack,
)
from tickfix.kernel import Kernel, KernelSettings, Pipeline, Stage
from tickfix.testing import world
from tickfix.testing.contract import (
    ContractError,
    StateContract,
    as_contract_error,
    pure_call,
    require,
    require_step_pair,
)
from tickfix.testing.filter_batches import check_step_many
from tickfix.testing.world import WalkTick


class FilterChecks(StateContract):
    """What the checks of a filter have in common."""

    def states(self) -> Iterator[Any]:
        """Yield the states of a walk."""
        for state, _, _ in self._fold(world.walk(150)):
            yield state

    def _fold(
        self, ticks: Iterable[WalkTick], algorithm: Any = None, *, start: Fix | None = None
    ) -> Iterator[tuple[Any, Belief, WalkTick]]:
        """Yield state, belief and tick of a walk from a known start."""
        algorithm = self.make() if algorithm is None else algorithm
        state = self._start(algorithm, world.first_fix() if start is None else start)
        for tick in ticks:
            state, _ = self._step(algorithm, state, tick)
            yield state, self._estimate(algorithm, state), tick

    def _pairs(self, algorithm: Any, count: int) -> Iterator[tuple[Any, WalkTick]]:
        """Yield the state before each tick of a walk, and the tick."""
        state = self._start(algorithm, world.first_fix())
        for tick in world.walk(count):
            yield state, tick
            state, _ = self._step(algorithm, state, tick)

    def _make_with_maps(self) -> Any:
        """Build the algorithm with maps, which are slow here, and few particles if it has any."""
        few = {"particles": 50} if "particles" in {f.name for f in dataclasses.fields(self.algorithm.Params)} else {}
        with as_contract_error("building with maps"):
            params = self.algorithm.Params(**{**self.params, **few})
            return self.algorithm(params, world.context(maps=world.reference_maps()), self.trained)

    @staticmethod
    def _start(algorithm: Any, fix: Fix) -> Any:
        with pure_call("start at a fix"):
            state = algorithm.start(Prior(t_ns=world.T0_NS, fix=fix), world.rng(0))
        require(state is not None, "start returned None though it was given a fix. Return the state at that place")
        return state

    @staticmethod
    def _step(algorithm: Any, state: Any, tick: WalkTick) -> tuple[Any, Report]:
        with pure_call(f"step at tick {tick.number}"):
            returned = algorithm.step(state, tick.motion, tick.observations, world.rng(tick.number))
        return require_step_pair(returned, Report)

    @staticmethod
    def _estimate(algorithm: Any, state: Any) -> Belief:
        with pure_call("estimate"):
            belief = algorithm.estimate(state)
        if not isinstance(belief, Belief):
            raise ContractError(f"estimate returned {type(belief).__name__}, expected Belief")
        return belief

    @staticmethod
    def _check_belief(belief: Belief, when: str) -> None:
        numbers = [*belief.xy.tolist(), *belief.covariance.ravel().tolist()]
        numbers += [n for n in (belief.speed_mps, belief.heading_rad) if n is not None]
        numbers += [p for _, p in belief.floor_probabilities] + [c.weight for c in belief.mixture]
        require(np.isfinite(numbers).all(), f"{when}, the belief is not finite: {belief}")
        for covariance in (belief.covariance, *(c.covariance for c in belief.mixture)):
            symmetric = np.allclose(covariance, covariance.T, rtol=1e-9, atol=1e-12)
            require(symmetric, f"{when}, the covariance is not symmetric: {covariance.tolist()}. Return (P + Pᵀ)/2")
            least = float(np.linalg.eigvalsh(covariance).min())
            enough = least >= -1e-9 * max(1.0, float(np.abs(covariance).max()))
            message = f"{when}, the covariance has a negative eigenvalue, {least:.3g}. Use Joseph's form in the update"
            require(enough, message)
        require(isinstance(belief.floor, str) and belief.floor, f"{when}, the belief names no floor")
        if belief.floor_probabilities:
            total = math.fsum(p for _, p in belief.floor_probabilities)
            require(abs(total - 1.0) < 1e-6, f"{when}, the floors' probabilities sum to {total:.6f}, expected 1")


class FilterPurityChecks(FilterChecks):
    """Checks that a filter keeps nothing outside of its states."""

    def test_a_step_is_a_function_of_its_arguments(self) -> None:
        """The kernel goes back and folds again: the same arguments must give the same bits."""
        algorithm = self.make()
        for state, tick in self._pairs(algorithm, 60):
            first, second = (pack(self._step(algorithm, state, tick)[0]) for _ in range(2))
            require(first == second, "step gave two results for the same arguments. Keep nothing outside of the state")

    def test_two_tracks_do_not_disturb_each_other(self) -> None:
        """One instance follows all devices, in turn."""
        one_by_one = [pack(state) for state, _, _ in self._fold(world.walk(60), self.make())]
        shared = self.make()
        other = self._fold(world.walk(60, shift=(3.0, 1.0)), shared)
        shared_states = [pack(mine[0]) for mine, _ in zip(self._fold(world.walk(60), shared), other, strict=True)]
        require(
            one_by_one == shared_states,
            "a track changed when another one was followed too. Keep nothing on self between calls",
        )

    def test_old_states_stay_as_they_were(self) -> None:
        """A step that writes into the arrays of its state changes the past to which the kernel goes back."""
        algorithm = self.make()
        for state, tick in self._pairs(algorithm, 60):
            before = pack(state)
            self._step(algorithm, state, tick)
            require(pack(state) == before, "step changed the state it was given. Write into a copy, return a new state")
            self._estimate(algorithm, state)
            require(pack(state) == before, "estimate changed the state it was given")

    def test_estimate_says_the_same_twice(self) -> None:
        """``estimate`` is a pure function of the state: it draws nothing and learns nothing."""
        algorithm = self.make()
        for state, _ in self._pairs(algorithm, 30):
            first, second = (self._estimate(algorithm, state) for _ in range(2))
            same = (
                first.xy.tobytes() == second.xy.tobytes() and first.covariance.tobytes() == second.covariance.tobytes()
            )
            require(same, "estimate said two things of one state")

    def test_an_unpacked_state_goes_on_like_the_one_packed(self) -> None:
        """A restarted process continues bit for bit."""
        algorithm = self.make()
        for state, tick in self._pairs(algorithm, 60):
            again = unpack(pack(state), self.algorithm.State)
            kept, unpacked = (pack(self._step(algorithm, s, tick)[0]) for s in (state, again))
            require(kept == unpacked, "an unpacked state goes on differently: does State hold all that step uses?")

    def test_randomness_comes_from_the_rng_alone(self) -> None:
        """Two instances with the same streams agree; the clock, other generators and ids are out of bounds."""
        one, two = ([pack(s) for s, _, _ in self._fold(world.walk(60), self.make())] for _ in range(2))
        require(one == two, "two instances with the same random streams disagree. Draw from the rng given only")

    def test_many_devices_at_once_are_each_as_if_alone(self) -> None:
        """Only for a filter with ``step_many``: the grouping of devices changes no bits."""
        offered = [name for name in ("step_many", "estimate_many") if hasattr(self.algorithm, name)]
        if not offered:
            return
        require(len(offered) == 2, f"the class has {offered[0]} alone. Write both step_many and estimate_many")
        check_step_many(self.make(), ticks=40)
        check_step_many(self._make_with_maps(), ticks=12)


class FilterRobustnessChecks(FilterChecks):
    """Checks that the belief stays one, whatever comes."""

    def test_it_survives_ticks_without_motion(self) -> None:
        """Sensors may deliver nothing for minutes: then motion is unknown."""
        self._survives(
            dataclasses.replace(tick, motion=Motion.unknown(tick.motion.t0_ns, tick.motion.t1_ns))
            for tick in world.walk(100)
        )

    def test_it_survives_motion_without_heading(self) -> None:
        """A phone without compass measures only how it turned."""
        self._survives(world.walk(100, compass=False))

    def test_it_survives_headings_that_come_and_go(self) -> None:
        """The compass may be switched on in the middle of a walk, and off again."""
        with_compass, without = world.walk(100), world.walk(100, compass=False)
        pairs = zip(with_compass, without, strict=True)
        self._survives(a if a.number // 7 % 2 else b for a, b in pairs)

    def test_it_survives_standing_still(self) -> None:
        """A phone on a table: no way, no doubt about it, and fixes that agree."""
        still = [
            dataclasses.replace(
                tick,
                motion=Motion(t0_ns=tick.motion.t0_ns, t1_ns=tick.motion.t1_ns, heading_rad=0.0, stationary=True),
                observations=tuple(world.observation([6.0, 2.0], o.t_ns) for o in tick.observations),
            )
            for tick in world.walk(200)
        ]
        self._survives(still)

    def test_it_survives_observations_without_a_fix(self) -> None:
        """A scan may hear nothing known; the observation then has no fix, and no likelihood either."""
        self._survives(
            dataclasses.replace(tick, observations=(Observation(t_ns=tick.motion.t1_ns, source="world"),))
            for tick in world.walk(60)
        )

    def test_it_survives_fixes_on_another_floor(self) -> None:
        """One may be wrong; many mean that the person took the stairs."""

        def fixes() -> Iterator[WalkTick]:
            for tick in world.walk(120):
                floor = "F2" if tick.number in (20, 25) or tick.number > 60 else "F1"
                yield dataclasses.replace(
                    tick, observations=(world.observation(tick.xy, tick.motion.t1_ns, floor),) * (tick.number % 5 == 0)
                )

        for belief in self._survives(fixes()):
            require(belief.floor in world.floors(), f"believes to be on floor {belief.floor!r}, which nobody named")

    def test_it_survives_a_fix_far_away(self) -> None:
        """A wrong fix kilometres off must not make NaN of the belief, nor what comes after it."""

        def fixes() -> Iterator[WalkTick]:
            for tick in world.walk(80):
                far = (world.observation([3e3, -4e3], tick.motion.t1_ns),)
                yield dataclasses.replace(tick, observations=far) if tick.number in (20, 21, 50) else tick

        self._survives(fixes())

    def test_it_survives_fixes_that_are_nearly_certain_or_nearly_worthless(self) -> None:
        """Covariances from square millimetres to square kilometres."""

        def fixes() -> Iterator[WalkTick]:
            for tick in world.walk(60):
                sigma_m = 1e-3 if tick.number % 2 else 1e3
                yield dataclasses.replace(
                    tick, observations=(world.observation(tick.xy, tick.motion.t1_ns, sigma_m=sigma_m),)
                )

        self._survives(fixes())

    def test_it_survives_several_observations_in_one_tick(self) -> None:
        """Scans may arrive in heaps."""
        self._survives(
            dataclasses.replace(
                tick, observations=tuple(world.observation(tick.xy + n, tick.motion.t1_ns) for n in range(3))
            )
            for tick in world.walk(40)
        )

    def test_it_survives_a_wild_motion(self) -> None:
        """A broken sensor may report a hundred metres in a tick, or an unbounded uncertainty."""

        def motions() -> Iterator[WalkTick]:
            for tick in world.walk(60):
                wild = dataclasses.replace(tick.motion, distance_m=100.0, distance_sigma_m=100.0, turn_rad=40.0)
                yield dataclasses.replace(tick, motion=wild) if tick.number % 20 == 5 else tick

        self._survives(motions())

    def test_it_survives_a_very_short_tick(self) -> None:
        """The time between two ticks must not be divided by carelessly."""
        algorithm = self.make()
        state = self._start(algorithm, world.first_fix())
        for n in range(20):
            t_ns = world.T0_NS + n
            tick = WalkTick(n + 1, Motion(t0_ns=t_ns, t1_ns=t_ns + 1, heading_rad=0.0), (), np.zeros(2))
            state, _ = self._step(algorithm, state, tick)
            self._check_belief(self._estimate(algorithm, state), "after ticks of a nanosecond")

    def test_it_runs_for_thousands_of_ticks(self) -> None:
        """Nothing may creep: not the covariance out of symmetry, nor weights into nothing."""
        algorithm = self.make()
        for state, tick in self._pairs(algorithm, 3000):
            if tick.number % 500 == 0:
                self._check_belief(self._estimate(algorithm, state), f"after {tick.number} ticks")
                size = len(pack(state))
                require(size < 50e6, f"a state of {size / 1e6:.0f} MB: the kernel keeps dozens of them")

    def _survives(self, ticks: Iterable[WalkTick]) -> list[Belief]:
        beliefs = []
        for _, belief, tick in self._fold(ticks):
            self._check_belief(belief, f"after tick {tick.number}")
            beliefs.append(belief)
        return beliefs


class FilterKernelChecks(FilterChecks):
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
            with as_contract_error("running in the kernel"):
                for _, event in sorted(arrivals, key=lambda pair: pair[0]):
                    kernel.feed(event)
                    settled += kernel.run("d").settled
                settled += kernel.finish("d").settled
            tracks.append([e.belief.xy.tobytes() if e.belief is not None else b"" for e in settled])
        require(any(tracks[0]), "the kernel's track has no belief at all, though there were fixes")
        require(tracks[0] == tracks[1], "late fixes settled to another track: step depends on more than its arguments")

    def _pipeline(self) -> Pipeline:
        kind, name = self.algorithm.kind, self.algorithm.name
        return Pipeline("mine", Stage(kind, name, name, self.make()), Stage("pdr", "world", "world", _ReplayedMotion()))


class _ReplayedMotion:
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


class FilterContract(FilterPurityChecks, FilterRobustnessChecks, FilterKernelChecks):
    """Checks of a filter: ``class TestMine(FilterContract): algorithm = Mine``.

    Set in the subclass, where they do not fit:
        follows_m: the belief stays so near to the truth on a walk with a fix of σ = 2 m every two seconds.
        shift_tolerance_m: the same walk elsewhere gives the same belief there, but for this; None for a filter that
            does nothing without a radio map.
    """

    follows_m: float = 10.0
    shift_tolerance_m: float | None = 0.05

    def test_it_begins_at_a_fix(self) -> None:
        """A known start, or the first fix of a fingerprint, is where the track begins."""
        fix = world.first_fix((2.0, 1.0))
        algorithm = self.make()
        state = self._start(algorithm, fix)
        belief = self._estimate(algorithm, state)
        off_m = math.dist(belief.xy, fix.xy)
        require(belief.floor == fix.floor, f"started at a fix on {fix.floor!r}, believes to be on {belief.floor!r}")
        require(off_m < 3.0, f"started at a fix (σ = 1 m), believes to be {off_m:.1f} m away from it")

    def test_it_begins_or_waits_when_nothing_is_known(self) -> None:
        """``start`` is asked with neither place nor observation first, then with observations that may have no fix."""
        algorithm = self.make()
        observed = Observation(t_ns=world.T0_NS, source="world")
        for prior in (Prior(t_ns=world.T0_NS), Prior(t_ns=world.T0_NS, observation=observed)):
            with pure_call("start with a prior that has no fix"):
                state = algorithm.start(prior, world.rng(0))
            if state is not None:
                self._estimate(algorithm, state)

    def test_beliefs_are_finite_and_their_covariances_are_covariances(self) -> None:
        """Symmetric and positive semi-definite at every tick, before and after fixes."""
        for _, belief, tick in self._fold(world.walk(150)):
            self._check_belief(belief, f"after tick {tick.number}")

    def test_it_follows_a_clean_walk(self) -> None:
        """With true motion and honest fixes, the belief stays near the truth."""
        errors = [math.dist(belief.xy, tick.xy) for _, belief, tick in self._fold(world.walk(300))]
        message = f"strays {max(errors):.1f} m from a walk with true motion and fixes of σ = 2 m every two seconds; "
        require(max(errors) <= self.follows_m, message + f"allowed are follows_m = {self.follows_m:g}")

    def test_uncertainty_grows_while_nothing_is_observed(self) -> None:
        """A belief that stays sure without any fix promises what it cannot hold."""
        beliefs = [belief for _, belief, _ in self._fold(world.walk(200, fixes=False))]
        first, last = (float(np.trace(belief.covariance)) for belief in (beliefs[0], beliefs[-1]))
        found = f"after 40 s of walking without a fix the variance went from {first:.2f} to {last:.2f} m²"
        require(last > first, f"{found}. Add the noise of motion in predict")

    def test_the_same_walk_elsewhere_gives_the_same_belief_there(self) -> None:
        """Without map and radio map, no place is special: not the origin either."""
        tolerance_m = self.shift_tolerance_m
        if tolerance_m is None:
            return
        shift = np.array([64.0, -32.0])
        one, two = (self.make(Context(floors=world.floors())) for _ in range(2))
        moved = self._fold(world.walk(150, shift=shift.tolist()), two, start=world.first_fix(shift.tolist()))
        for (_, here, tick), (_, there, _) in zip(self._fold(world.walk(150), one), moved, strict=True):
            off_m = math.dist(here.xy + shift, there.xy)
            found = f"a walk moved by (64, −32) m gives at tick {tick.number} a belief that is {off_m:.2f} m off"
            require(off_m <= tolerance_m, f"{found}. Is a coordinate compared with a constant?")

    def test_it_walks_in_a_building_with_walls(self) -> None:
        """With maps in its context it must work as well; whether it uses them is its own affair."""
        for _, belief, tick in self._fold(world.walk(60), self._make_with_maps()):
            self._check_belief(belief, f"with maps, after tick {tick.number}")

    def test_reports_count_each_observation_at_most_once(self) -> None:
        """``used`` counts observations that corrected the belief, ``gated`` those that were rejected."""
        algorithm = self.make()
        for state, tick in self._pairs(algorithm, 60):
            _, report = self._step(algorithm, state, tick)
            found = f"{report.used} used and {report.gated} gated of {len(tick.observations)} observations"
            right = report.used >= 0 and report.gated >= 0 and report.used + report.gated <= len(tick.observations)
            require(right, f"step reported {found}")


__all__ = ["FilterContract"]
