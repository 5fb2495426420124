"""Filter ``kalman-reckoning``: a Kalman filter behind dead reckoning, the comparison of [jiang2015] section 8.3.1.

The places that dead reckoning adds up to, [jiang2015] eq. (13), are observed by a Kalman filter with the state
X = [x, y, v_x, v_y], [sun2013] eqs. (9)–(11) and (16)–(17). It smooths the track and adds no information: what
dead reckoning has accumulated stays. [jiang2015] prints no model and no value; all are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from tickfix.api import (
    Belief,
    Context,
    Fix,
    Floats,
    Motion,
    NoParams,
    PredictUpdateFilter,
    Report,
    Rng,
    TrainedModel,
    frozen,
    heading_of,
    parameter,
)
from tickfix_filters.dead_reckoning import DeadReckoning, DeadReckoningState

_H = np.eye(2, 4)  # [sun2013] eq. (17)


@dataclass(frozen=True)
class KalmanReckoningParams:
    """Parameters of ``kalman-reckoning``."""

    acceleration_mps2: Annotated[
        float, parameter("σ of a_x and of a_y", unit="m/s²", source="[sun2013] eq. (16)", gt=0)
    ] = 0.5
    position_sigma_m: Annotated[
        float, parameter("σ of a reckoned place, per axis", unit="m", gt=0, formerly="place_sigma_m")
    ] = 0.5
    speed_sigma_mps: Annotated[float, parameter("σ of the first v_x and v_y", unit="m/s", ge=0)] = 1.0


@dataclass(frozen=True, slots=True)
class SmoothedReckoningState:
    """X (4,) = [x, y, v_x, v_y] in m and m/s and its covariance P (4, 4), behind what was reckoned."""

    reckoned: DeadReckoningState
    x: Floats
    p: Floats


class KalmanReckoning(PredictUpdateFilter[KalmanReckoningParams, SmoothedReckoningState]):
    """Smooths what motion adds up to; fixes after the first are not used, so errors accumulate."""

    name = "kalman-reckoning"
    source = "[jiang2015] section 8.3.1, Table 4; [sun2013] eqs. (9)–(11), (16)–(17)"
    Params = KalmanReckoningParams
    State = SmoothedReckoningState

    def __init__(self, params: KalmanReckoningParams, context: Context, trained: TrainedModel | None = None) -> None:
        """Take dead reckoning along."""
        super().__init__(params, context, trained)
        self._reckoning = DeadReckoning(NoParams(), context)

    def begin(self, fix: Fix, rng: Rng) -> SmoothedReckoningState:
        """Stand at the fix, about to walk anywhere."""
        P = np.diag([self.params.position_sigma_m**2] * 2 + [self.params.speed_sigma_mps**2] * 2)
        return SmoothedReckoningState(self._reckoning.begin(fix, rng), frozen([*fix.xy, 0.0, 0.0]), frozen(P))

    def predict(self, state: SmoothedReckoningState, motion: Motion, rng: Rng) -> SmoothedReckoningState:
        """Add the motion up and observe the place it leads to."""
        reckoned = self._reckoning.predict(state.reckoned, motion, rng)
        T = (motion.t1_ns - motion.t0_ns) * 1e-9
        A = np.eye(4)
        A[[0, 1], [2, 3]] = T
        G = np.array([[0.5 * T**2, 0.0], [0.0, 0.5 * T**2], [T, 0.0], [0.0, T]])  # eq. (16)
        X = A @ state.x
        P = A @ state.p @ A.T + self.params.acceleration_mps2**2 * G @ G.T  # eq. (10)
        R = self.params.position_sigma_m**2 * np.eye(2)
        K = np.linalg.solve(_H @ P @ _H.T + R, _H @ P).T  # eq. (11)
        I_KH = np.eye(4) - K @ _H
        # P = (I − K H) P, written so that rounding cannot cost its symmetry or sign.
        P = I_KH @ P @ I_KH.T + K @ R @ K.T
        return SmoothedReckoningState(reckoned, frozen(X + K @ (reckoned.xy - _H @ X)), frozen(0.5 * (P + P.T)))

    def update(self, state: SmoothedReckoningState, fix: Fix, rng: Rng) -> tuple[SmoothedReckoningState, Report]:
        """Leave the state as it is; report the distance to the fix only."""
        return state, self._reckoning.update(state.reckoned, fix, rng)[1]

    def estimate(self, state: SmoothedReckoningState) -> Belief:
        """Return the smoothed position; its covariance is that of the reckoning plus that of the smoothing."""
        moving = bool(state.x[2:].any())
        return Belief(
            floor=state.reckoned.floor,
            xy=state.x[:2],
            covariance=self._reckoning.estimate(state.reckoned).covariance + state.p[:2, :2],
            speed_mps=float(np.hypot(*state.x[2:])),
            heading_rad=heading_of(state.x[2:]) if moving else None,
        )
