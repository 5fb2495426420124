"""Filter ``kalman``: an extended Kalman filter that dead reckoning drives and fixes correct.

State m = [x, y, b, s]: position, the bias of the heading and the relative error of the step length; both biases belong
to the walk and are learnt from its fixes. With a tick's way d at heading θ:

    x ← x + d(1 + s)·sin(θ + b)        y ← y + d(1 + s)·cos(θ + b)

Equations of the filter: [sun2013] eqs. (9)–(11). A fix that is unlikely is not gated but believed less: its covariance
grows as that of Student's t with ν degrees of freedom would, so that no run of bad fixes can lock the filter out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from tickfix.api import Belief, Fix, Floats, Motion, PredictUpdateFilter, Report, Rng, frozen, parameter
from tickfix_filters.floors import OnFloor
from tickfix_filters.noise import independent_covariance

_H = np.eye(2, 4)


@dataclass(frozen=True)
class KalmanParams:
    """Parameters of ``kalman``."""

    diffusion_m: Annotated[
        float, parameter("way per square root of a second that no step explains", unit="m/√s", ge=0)
    ] = 0.1
    correlation_s: Annotated[float, parameter("time over which errors of fixes are alike", unit="s", ge=0)] = 6.0
    freedom: Annotated[float, parameter("degrees of freedom ν of the errors of fixes; large: Gaussian", gt=0)] = 4.0


@dataclass(frozen=True, slots=True)
class Gaussian:
    """Mean m (4,) and covariance P (4, 4) of [x, y, b, s] in m, m, rad, 1."""

    on: OnFloor
    m: Floats
    p: Floats
    heading_rad: float | None = None
    speed_mps: float = 0.0
    fixed_ns: int | None = None
    walked: bool = False


class Kalman(PredictUpdateFilter[KalmanParams, Gaussian]):
    """Extended Kalman filter over position, heading bias and step scale."""

    name = "kalman"
    source = "[sun2013] eqs. (9)–(11), (16)–(17)"
    Params = KalmanParams
    State = Gaussian

    def begin(self, fix: Fix, rng: Rng) -> Gaussian:  # noqa: ARG002
        """Start at the fix; the biases' uncertainty comes with the first motion."""
        p = np.zeros((4, 4))
        p[:2, :2] = fix.covariance
        return Gaussian(OnFloor(fix.floor), frozen([*fix.xy, 0.0, 0.0]), frozen(p), fixed_ns=fix.t_ns)

    def predict(self, state: Gaussian, motion: Motion, rng: Rng) -> Gaussian:  # noqa: ARG002
        """Walk the motion; [sun2013] eqs. (9) and (16)."""
        m, p = state.m, np.array(state.p)
        if not state.walked:
            p[2, 2], p[3, 3] = motion.heading_bias_sigma_rad**2, motion.distance_scale_sigma**2
        dt = (motion.t1_ns - motion.t0_ns) * 1e-9
        d = motion.distance_m * (1.0 + m[3])
        q = np.zeros((4, 4))
        q[:2, :2] = self.params.diffusion_m**2 * dt * np.eye(2)
        q[2, 2] = motion.turn_bias_sigma_rad**2
        if motion.heading_rad is None:  # somewhere on a circle of radius d: mean zero, d²/2 per axis
            q[:2, :2] += 0.5 * (d**2 + motion.distance_sigma_m**2) * np.eye(2)
            f, heading = np.eye(4), None
        else:
            heading = motion.heading_rad + float(m[2])
            u = np.array([math.sin(heading), math.cos(heading)])
            v = np.array([u[1], -u[0]])
            f = np.eye(4)
            f[:2, 2], f[:2, 3] = d * v, motion.distance_m * u
            q[:2, :2] += motion.distance_sigma_m**2 * np.outer(u, u)
            q[:2, :2] += (d * motion.heading_sigma_rad) ** 2 * np.outer(v, v)
            m = m + np.array([*(d * u), 0.0, 0.0])
        p = f @ p @ f.T + q  # eq. (16)
        return replace(
            state, m=frozen(m), p=frozen(0.5 * (p + p.T)), heading_rad=heading, speed_mps=d / dt, walked=True
        )

    def update(self, state: Gaussian, fix: Fix, rng: Rng) -> tuple[Gaussian, Report]:
        """Correct by the fix; [sun2013] eqs. (10), (11) and (17)."""
        on = state.on.observe(fix.floor)
        if on.floor != state.on.floor:
            return self.begin(fix, rng), Report(used=1, reasons=("changed floor",))
        if fix.floor != on.floor:
            return replace(state, on=on), Report(gated=1, reasons=("fix on another floor",))
        r = independent_covariance(fix, state.fixed_ns, self.params.correlation_s)
        y = fix.xy - state.m[:2]
        s = state.p[:2, :2] + r
        nis = float(y @ np.linalg.solve(s, y))
        s = s + max(0.0, (self.params.freedom + nis) / (self.params.freedom + 2.0) - 1.0) * r
        k = np.linalg.solve(s, state.p[:2]).T  # eq. (11): K = P Hᵀ S⁻¹
        m = state.m + k @ y  # eq. (17)
        a = np.eye(4) - k @ _H
        r_used = s - state.p[:2, :2]
        p = a @ state.p @ a.T + k @ r_used @ k.T  # eq. (10) in Joseph's form, which stays positive
        report = Report(used=1, innovation_m=float(np.hypot(*y)), gate=nis)
        return replace(state, on=on, m=frozen(m), p=frozen(0.5 * (p + p.T)), fixed_ns=fix.t_ns), report

    def estimate(self, state: Gaussian) -> Belief:
        """Say the mean and its covariance."""
        return Belief(
            floor=state.on.floor,
            xy=state.m[:2],
            covariance=state.p[:2, :2],
            speed_mps=state.speed_mps,
            heading_rad=state.heading_rad,
        )
