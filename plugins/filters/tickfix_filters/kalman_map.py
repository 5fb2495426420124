"""Filter ``kalman-map``: the Kalman/map filter (KMF) of [sun2013] section 3.3, from fixes and the map alone.

State X = [x, y, v_x, v_y]. It is predicted at the instants of fixes, ΔT after the last one; the map's ``snap`` then
corrects the predicted place U, which makes the prediction nonlinear, and the fix corrects the outcome. Between fixes
the same prediction is the estimate, and no state changes. Without a map this is the paper's plain Kalman filter, eqs.
(9)–(11).

What the paper leaves open: the two accelerations of eq. (16) are printed as constants; they are read as independent,
with mean zero and this standard deviation. The first speed is zero with σ ``speed_sigma_mps``. By default R is what the
covariance of the fix, which the paper's fingerprint does not provide; the preset has the R = 6 m² printed. By default
the walker may also accelerate ten times as much: with the 0.05 m/s² printed, the filter walks straight on for seconds
where people turn (tested: it strays 7.9 m from a walk with turns and fixes of σ = 2 m).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np

from tickfix.api import (
    Belief,
    Fix,
    Floats,
    Motion,
    PredictUpdateFilter,
    Preset,
    Report,
    Rng,
    frozen,
    heading_of,
    parameter,
)
from tickfix.toolkit.fix_errors import FloorHysteresis

_H = np.eye(2, 4)  # eq. (17)


@dataclass(frozen=True)
class KalmanMapParams:
    """Parameters of ``kalman-map``."""

    acceleration_mps2: Annotated[
        float, parameter("σ of a_x and of a_y", unit="m/s²", source="[sun2013] eq. (16)", gt=0)
    ] = 0.5
    fix_variance_m2: Annotated[
        float, parameter("R per axis; 0: the covariance of the fix", unit="m²", source="[sun2013] eq. (17)", ge=0)
    ] = 0.0
    speed_sigma_mps: Annotated[float, parameter("σ of the first v_x and v_y", unit="m/s", ge=0)] = 1.0
    max_extrapolation_s: Annotated[
        float,
        parameter(
            "between fixes, the estimate is extrapolated for at most this long",
            unit="s",
            ge=0,
            formerly="extrapolated_s",
        ),
    ] = 10.0


@dataclass(frozen=True, slots=True)
class KalmanMapState:
    """X (4,) = [x, y, v_x, v_y] in m and m/s and its covariance P (4, 4) at the last fix; now it is ``now_ns``."""

    hysteresis: FloorHysteresis
    x: Floats
    p: Floats
    last_fix_ns: int
    now_ns: int


class KalmanMap(PredictUpdateFilter[KalmanMapParams, KalmanMapState]):
    """Kalman filter over position and velocity whose predictions the map corrects; motion is not used."""

    name = "kalman-map"
    source = "[sun2013] section 3.3, eqs. (9)–(17)"
    Params = KalmanMapParams
    State = KalmanMapState
    presets: ClassVar[Mapping[str, Preset]] = {
        "sun2013": Preset(source="[sun2013] section 4.3.2", values={"acceleration_mps2": 0.05, "fix_variance_m2": 6.0})
    }

    def begin(self, fix: Fix, rng: Rng) -> KalmanMapState:  # noqa: ARG002
        """Stand at the fix, about to walk anywhere."""
        P = np.zeros((4, 4))
        P[:2, :2] = self._R(fix)
        P[[2, 3], [2, 3]] = self.params.speed_sigma_mps**2
        return KalmanMapState(FloorHysteresis(fix.floor), frozen([*fix.xy, 0.0, 0.0]), frozen(P), fix.t_ns, fix.t_ns)

    def predict(self, state: KalmanMapState, motion: Motion, rng: Rng) -> KalmanMapState:  # noqa: ARG002
        """Let time pass."""
        return replace(state, now_ns=motion.t1_ns)

    def update(self, state: KalmanMapState, fix: Fix, rng: Rng) -> tuple[KalmanMapState, Report]:
        """Predict to the instant of the fix, correct by the map and then by the fix."""
        hysteresis = state.hysteresis.observe(fix.floor)
        if hysteresis.floor != state.hysteresis.floor:
            return replace(self.begin(fix, rng), now_ns=state.now_ns), Report(used=1, reasons=("changed floor",))
        if fix.floor != hysteresis.floor:
            return replace(state, hysteresis=hysteresis), Report(gated=1, reasons=("fix on another floor",))
        X, P = self._predicted(state, fix.t_ns)
        Z = fix.xy
        S = _H @ P @ _H.T + self._R(fix)
        K = np.linalg.solve(S, _H @ P).T  # eq. (11)
        innovation = Z - _H @ X
        I_KH = np.eye(4) - K @ _H
        # P = (I − K H) P, eq. (11), written so that rounding cannot cost its symmetry or sign.
        P = I_KH @ P @ I_KH.T + K @ self._R(fix) @ K.T
        X = X + K @ innovation  # eq. (15)
        report = Report(
            used=1,
            innovation_m=float(np.hypot(*innovation)),
            nis=float(innovation @ np.linalg.solve(S, innovation)),
        )
        last_fix_ns = max(state.last_fix_ns, fix.t_ns)
        return replace(
            state, hysteresis=hysteresis, x=frozen(X), p=frozen(0.5 * (P + P.T)), last_fix_ns=last_fix_ns
        ), report

    def estimate(self, state: KalmanMapState) -> Belief:
        """Return the prediction for the present."""
        X, P = self._predicted(state, state.now_ns, self.params.max_extrapolation_s)
        moving = bool(X[2:].any())
        return Belief(
            floor=state.hysteresis.floor,
            xy=X[:2],
            covariance=P[:2, :2],
            speed_mps=float(np.hypot(*X[2:])),
            heading_rad=heading_of(X[2:]) if moving else None,
        )

    def _predicted(self, state: KalmanMapState, t_ns: int, longest_s: float = np.inf) -> tuple[Floats, Floats]:
        """Return X' (4,) and P (4, 4) at ``t_ns``; a fix older than the last one counts as simultaneous with it."""
        dT = max(0, t_ns - state.last_fix_ns) * 1e-9
        if dT == 0.0:
            return state.x, state.p
        A = np.eye(4)
        A[[0, 1], [2, 3]] = dT
        G = np.array([[0.5 * dT**2, 0.0], [0.0, 0.5 * dT**2], [dT, 0.0], [0.0, dT]])  # eq. (16)
        P = A @ state.p @ A.T + self.params.acceleration_mps2**2 * G @ G.T  # eq. (10)
        X = state.x.copy()
        X[:2] += min(dT, longest_s) * X[2:]  # eqs. (10), (13)
        floor_map = self.context.maps.get(state.hysteresis.floor)
        if floor_map is not None:
            X[:2] = floor_map.snap(state.x[:2], X[:2])  # eqs. (12), (14)
        return X, 0.5 * (P + P.T)

    def _R(self, fix: Fix) -> Floats:  # noqa: N802 - the paper's symbol
        """Return the measurement noise R (2, 2), eq. (17)."""
        if self.params.fix_variance_m2 > 0.0:
            return self.params.fix_variance_m2 * np.eye(2)
        return fix.covariance
