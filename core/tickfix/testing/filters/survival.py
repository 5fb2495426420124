"""What may come to a filter from phones, scans and people, and must not break it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np

from tickfix.api import Belief, Motion, Observation, pack
from tickfix.testing import world
from tickfix.testing.calls import require
from tickfix.testing.filters.walking import WalkedFilter
from tickfix.testing.world import Tick


class SurvivingFilter(WalkedFilter):
    """Checks that the belief stays one, whatever comes."""

    def test_it_survives_ticks_without_motion(self) -> None:
        """Sensors may be silent for minutes: then motion says that nobody knows."""
        self._survives(
            dataclasses.replace(tick, motion=Motion.unknown(tick.motion.t0_ns, tick.motion.t1_ns))
            for tick in world.walk(100)
        )

    def test_it_survives_motion_without_heading(self) -> None:
        """A phone without compass tells only how it turned."""
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

        def fixes() -> Iterator[Tick]:
            for tick in world.walk(120):
                floor = "F2" if tick.number in (20, 25) or tick.number > 60 else "F1"
                yield dataclasses.replace(
                    tick, observations=(world.observation(tick.xy, tick.motion.t1_ns, floor),) * (tick.number % 5 == 0)
                )

        for belief in self._survives(fixes()):
            require(belief.floor in world.floors(), f"believes to be on floor {belief.floor!r}, which nobody named")

    def test_it_survives_a_fix_far_away(self) -> None:
        """A wrong fix kilometres off must not make NaN of the belief, nor what comes after it."""

        def fixes() -> Iterator[Tick]:
            for tick in world.walk(80):
                far = (world.observation([3e3, -4e3], tick.motion.t1_ns),)
                yield dataclasses.replace(tick, observations=far) if tick.number in (20, 21, 50) else tick

        self._survives(fixes())

    def test_it_survives_fixes_that_are_nearly_certain_or_nearly_worthless(self) -> None:
        """Covariances from square millimetres to square kilometres."""

        def fixes() -> Iterator[Tick]:
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
        """A broken sensor may say a hundred metres in a tick, or that anything is possible."""

        def motions() -> Iterator[Tick]:
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
            tick = Tick(n + 1, Motion(t0_ns=t_ns, t1_ns=t_ns + 1, heading_rad=0.0), (), np.zeros(2))
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

    def _survives(self, ticks: Iterable[Tick]) -> list[Belief]:
        beliefs = []
        for _, belief, tick in self._fold(ticks):
            self._check_belief(belief, f"after tick {tick.number}")
            beliefs.append(belief)
        return beliefs
