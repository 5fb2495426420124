"""Filter ``kalman``: an extended Kalman filter that dead reckoning drives and fixes correct.

State m = [x, y, b, s, u, v]: position, the bias of the heading, the relative error of the step length, and what the
errors of fixes along x and y have in common with the last ones (:mod:`tickfix.toolkit.fix_errors`). With a tick's way d
at heading θ:

    x ← x + d(1 + s)·sin(θ + b)        y ← y + d(1 + s)·cos(θ + b)        fix = [x, y] + σ·[u, v] + white

Equations of the filter: [sun2013] eqs. (9)–(11), (16) and (17). An unlikely fix is not gated but down-weighted:
the innovation's covariance grows as that of Student's t would, so that no run of bad fixes can lock the filter out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from tickfix.api import Belief, Fix, Floats, Motion, PredictUpdateFilter, Report, Rng, frozen, parameter
from tickfix.toolkit.fix_errors import FixErrorParams, FloorHysteresis, sigma_per_axis_m


@dataclass(frozen=True)
class KalmanParams(FixErrorParams):
    """Parameters of ``kalman``."""

    diffusion_m: Annotated[
        float, parameter("way per square root of a second that no step explains", unit="m/√s", ge=0)
    ] = 0.1


@dataclass(frozen=True, slots=True)
class KalmanState:
    """Mean m (6,) and covariance P (6, 6) of [x, y, b, s, u, v] in m, m, rad, 1, 1, 1."""

    hysteresis: FloorHysteresis
    m: Floats
    p: Floats
    heading_rad: float | None = None
    speed_mps: float = 0.0
    has_moved: bool = False


class Kalman(PredictUpdateFilter[KalmanParams, KalmanState]):
    """Extended Kalman filter over position, heading bias, step scale and the memory of fixes' errors."""

    name = "kalman"
    source = "[sun2013] eqs. (9)–(11), (16)–(17); [bryson1968] for the errors' memory"
    Params = KalmanParams
    State = KalmanState

    def begin(self, fix: Fix, rng: Rng) -> KalmanState:  # noqa: ARG002
        """Start at the fix; the biases' uncertainty comes with the first motion."""
        sigma, error_correlation = sigma_per_axis_m(fix), self.params.error_correlation
        p = np.diag([sigma**2, sigma**2, 0.0, 0.0, error_correlation, error_correlation])
        p[[0, 1, 4, 5], [4, 5, 0, 1]] = (
            -sigma * error_correlation
        )  # the place is off by what the fix erred, the other way
        return KalmanState(FloorHysteresis(fix.floor), frozen([*fix.xy, 0.0, 0.0, 0.0, 0.0]), frozen(p))

    def predict(self, state: KalmanState, motion: Motion, rng: Rng) -> KalmanState:  # noqa: ARG002
        """Walk the motion; [sun2013] eqs. (9) and (16)."""
        x, y, b, s, u, v = state.m.tolist()
        p = state.p
        if not state.has_moved:
            p = np.array(p)
            p[2, 2], p[3, 3] = motion.heading_bias_sigma_rad**2, motion.distance_scale_sigma**2
        dt = (motion.t1_ns - motion.t0_ns) * 1e-9
        d = motion.distance_m * (1.0 + s)
        rho = math.exp(-dt / self.params.correlation_time_s)
        sin = cos = 0.0
        q_xx = q_yy = self.params.diffusion_m**2 * dt
        q_xy, heading = 0.0, None
        if motion.heading_rad is None:  # somewhere on a circle of radius d: mean zero, d²/2 per axis
            q_xx += 0.5 * (d**2 + motion.distance_sigma_m**2)
            q_yy = q_xx
        else:
            heading = motion.heading_rad + b
            sin, cos = math.sin(heading), math.cos(heading)
            along, across = motion.distance_sigma_m**2, (d * motion.heading_sigma_rad) ** 2
            q_xx = q_xx + along * (sin * sin) + across * (cos * cos)
            q_xy = along * (sin * cos) - across * (sin * cos)
            q_yy = q_yy + along * (cos * cos) + across * (sin * sin)
        q_bb, q_uu = motion.turn_bias_sigma_rad**2, (1.0 - rho**2) * self.params.error_correlation
        f = np.array(
            [
                [1.0, 0.0, d * cos, motion.distance_m * sin, 0.0, 0.0],
                [0.0, 1.0, -d * sin, motion.distance_m * cos, 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
                [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 0.0, 0.0, rho, 0.0],
                [0.0, 0.0, 0.0, 0.0, 0.0, rho],
            ]
        )
        q = np.array(
            [
                [q_xx, q_xy, 0.0, 0.0, 0.0, 0.0],
                [q_xy, q_yy, 0.0, 0.0, 0.0, 0.0],
                [0.0, 0.0, q_bb, 0.0, 0.0, 0.0],
                [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                [0.0, 0.0, 0.0, 0.0, q_uu, 0.0],
                [0.0, 0.0, 0.0, 0.0, 0.0, q_uu],
            ]
        )
        m = frozen([x + d * sin, y + d * cos, b, s, rho * u, rho * v])
        p = f @ p @ f.T + q  # eq. (16)
        return replace(state, m=m, p=_symmetric(p), heading_rad=heading, speed_mps=d / dt, has_moved=True)

    def update(self, state: KalmanState, fix: Fix, rng: Rng) -> tuple[KalmanState, Report]:
        """Correct by the fix; [sun2013] eqs. (10), (11) and (17)."""
        hysteresis = state.hysteresis.observe(fix.floor)
        if hysteresis.floor != state.hysteresis.floor:
            return self.begin(fix, rng), Report(used=1, reasons=("changed floor",))
        if fix.floor != hysteresis.floor:
            return replace(state, hysteresis=hysteresis), Report(gated=1, reasons=("fix on another floor",))
        sigma, nu = sigma_per_axis_m(fix), self.params.student_t_dof
        h = np.array([[1.0, 0.0, 0.0, 0.0, sigma, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0, sigma]])
        r = (1.0 - self.params.error_correlation) * sigma**2 * np.eye(2)
        y = fix.xy - h @ state.m
        s = h @ state.p @ h.T + r
        nis = float(y @ np.linalg.solve(s, y))
        scale = max(1.0, (nu + nis) / (nu + 2.0))
        s *= scale
        k = np.linalg.solve(s, h @ state.p).T  # eq. (11): K = P Hᵀ S⁻¹
        m = state.m + k @ y  # eq. (17)
        p = state.p - k @ s @ k.T  # eq. (10)
        log_likelihood = -0.5 * (nis / scale + math.log(np.linalg.det(2.0 * math.pi * s)))
        diagnostics = {"innovation_scale": scale, "log_likelihood": log_likelihood}
        report = Report(used=1, innovation_m=float(np.hypot(*y)), nis=nis, diagnostics=diagnostics)
        return replace(state, hysteresis=hysteresis, m=frozen(m), p=_symmetric(p)), report

    def estimate(self, state: KalmanState) -> Belief:
        """Return the mean and its covariance."""
        return Belief(
            floor=state.hysteresis.floor,
            xy=state.m[:2],
            covariance=state.p[:2, :2],
            speed_mps=state.speed_mps,
            heading_rad=state.heading_rad,
        )


def _symmetric(p: Floats) -> Floats:
    return frozen(0.5 * (p + p.T))
