"""Filter ``alpha-beta``: position and velocity, corrected by a fixed share of what each fix surprises with.

RecordingFile: [benedict1962] Benedict and Bordner, "Synthesis of an optimal set of radar track-while-scan smoothing
equations", IRE Transactions on Automatic Control 7 (1962).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from tickfix.api import TICK_NS, Belief, Fix, Floats, Motion, PredictUpdateFilter, Report, Rng, parameter


@dataclass(frozen=True)
class AlphaBetaParams:
    """Parameters of ``alpha-beta``."""

    alpha: Annotated[float, parameter("share of the innovation that moves the position", gt=0, lt=1)] = 0.5
    drift_m: Annotated[float, parameter("by which the position strays per second", unit="m", gt=0)] = 1.0


@dataclass(frozen=True, slots=True)
class Moving:
    """Position (2,) in m, velocity (2,) in m/s, variance per axis in m², and when the last fix was."""

    floor: str
    x: Floats
    v: Floats
    variance: float
    fixed_ns: int


class AlphaBeta(PredictUpdateFilter[AlphaBetaParams, Moving]):
    """Smooths fixes under constant velocity; motion sensors are not used."""

    name = "alpha-beta"
    source = "[benedict1962]"
    Params = AlphaBetaParams
    State = Moving

    def begin(self, fix: Fix, rng: Rng) -> Moving:  # noqa: ARG002 - this filter draws nothing
        """Stand at the first fix."""
        return Moving(fix.floor, fix.xy, np.zeros(2), float(np.trace(fix.covariance)) / 2, fix.t_ns)

    def predict(self, state: Moving, motion: Motion, rng: Rng) -> Moving:  # noqa: ARG002
        """Go on as before: x ← x + v·Δt."""
        dt = (motion.t1_ns - motion.t0_ns) * 1e-9
        return replace(state, x=state.x + state.v * dt, variance=state.variance + self.params.drift_m**2 * dt)

    def update(self, state: Moving, fix: Fix, rng: Rng) -> tuple[Moving, Report]:
        """Correct by the innovation r: x ← x + α·r, v ← v + β·r/T with β = α²/(2 − α)."""
        if fix.floor != state.floor:
            return self.begin(fix, rng), Report(used=1, reasons=("changed floor",))
        alpha = self.params.alpha
        beta = alpha**2 / (2 - alpha)
        t = max(fix.t_ns - state.fixed_ns, TICK_NS) * 1e-9
        r = fix.xy - state.x
        variance = (1 - alpha) ** 2 * state.variance + alpha**2 * float(np.trace(fix.covariance)) / 2
        corrected = Moving(state.floor, state.x + alpha * r, state.v + beta / t * r, variance, fix.t_ns)
        return corrected, Report(used=1, innovation_m=float(np.hypot(*r)))

    def estimate(self, state: Moving) -> Belief:
        """Say where that is."""
        return Belief(
            floor=state.floor,
            xy=state.x,
            covariance=state.variance * np.eye(2),
            speed_mps=float(np.hypot(*state.v)),
        )
