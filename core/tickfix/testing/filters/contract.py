"""What every filter must keep."""

from __future__ import annotations

import math

import numpy as np

from tickfix.api import Context, Observation, Prior
from tickfix.testing import world
from tickfix.testing.calls import pure, require
from tickfix.testing.filters.in_the_kernel import FilterInTheKernel
from tickfix.testing.filters.purity import PureFilter
from tickfix.testing.filters.survival import SurvivingFilter


class FilterContract(PureFilter, SurvivingFilter, FilterInTheKernel):
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
            with pure("start with a prior that has no fix"):
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
        for _, belief, tick in self._fold(world.walk(60), self._few_in_a_building()):
            self._check_belief(belief, f"with maps, after tick {tick.number}")

    def test_reports_count_each_observation_at_most_once(self) -> None:
        """``used`` tells that the belief was corrected, ``gated`` that an observation was refused."""
        algorithm = self.make()
        for state, tick in self._pairs(algorithm, 60):
            _, report = self._step(algorithm, state, tick)
            found = f"{report.used} used and {report.gated} gated of {len(tick.observations)} observations"
            right = report.used >= 0 and report.gated >= 0 and report.used + report.gated <= len(tick.observations)
            require(right, f"step reported {found}")
