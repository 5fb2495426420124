"""A filter on walks through the kit's world, each of its calls checked."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from tickfix.api import Belief, Fix, Prior, Report
from tickfix.testing import world
from tickfix.testing.calls import ContractError, pair_of, pure, require, told
from tickfix.testing.contract import StateContract
from tickfix.testing.world import Tick


class WalkedFilter(StateContract):
    """What the checks of a filter have in common."""

    def states(self) -> Iterator[Any]:
        """Yield the states of a walk."""
        for state, _, _ in self._fold(world.walk(150)):
            yield state

    def _fold(
        self, ticks: Iterable[Tick], algorithm: Any = None, *, start: Fix | None = None
    ) -> Iterator[tuple[Any, Belief, Tick]]:
        """Yield state, belief and tick of a walk from a known start."""
        algorithm = self.make() if algorithm is None else algorithm
        state = self._start(algorithm, world.first_fix() if start is None else start)
        for tick in ticks:
            state, _ = self._step(algorithm, state, tick)
            yield state, self._estimate(algorithm, state), tick

    def _pairs(self, algorithm: Any, count: int) -> Iterator[tuple[Any, Tick]]:
        """Yield the state before each tick of a walk, and the tick."""
        state = self._start(algorithm, world.first_fix())
        for tick in world.walk(count):
            yield state, tick
            state, _ = self._step(algorithm, state, tick)

    def _few_in_a_building(self) -> Any:
        """Build the algorithm with maps, which are slow here, and few particles if it has any."""
        few = {"particles": 50} if "particles" in {f.name for f in dataclasses.fields(self.algorithm.Params)} else {}
        with told("building with maps"):
            params = self.algorithm.Params(**{**self.params, **few})
            return self.algorithm(params, world.context(maps=world.plain_maps()), self.trained)

    @staticmethod
    def _start(algorithm: Any, fix: Fix) -> Any:
        with pure("start at a fix"):
            state = algorithm.start(Prior(t_ns=world.T0_NS, fix=fix), world.rng(0))
        require(state is not None, "start returned None though it was given a fix. Return the state at that place")
        return state

    @staticmethod
    def _step(algorithm: Any, state: Any, tick: Tick) -> tuple[Any, Report]:
        with pure(f"step at tick {tick.number}"):
            returned = algorithm.step(state, tick.motion, tick.observations, world.rng(tick.number))
        return pair_of(returned, Report)

    @staticmethod
    def _estimate(algorithm: Any, state: Any) -> Belief:
        with pure("estimate"):
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
