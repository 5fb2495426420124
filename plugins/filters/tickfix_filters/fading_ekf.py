"""Filter ``fading-ekf``.

WPO, the fading-factor extended Kalman filter of [wang2015] section 4; ``map-pf`` runs the same equations. State X = [N,
E, v_n, v_e], predicted at the instants of fixes, t after the last one; between fixes only the displacement and heading
of dead reckoning are accumulated. An observation is Z = [N_wifi, E_wifi, s_e, s_n, heading]. Rows that were not
measured are left out: displacement and heading without a compass, the heading at low speed. Σ_V̄, whose recursion is
not printed, is that of the strong tracking filter, [zhou1996] Zhou and Frank, "Strong tracking filtering of nonlinear
time-varying stochastic systems with coloured noise", Int. J. Control 65 (1996). M of eq. (20) has no inverse: λ is tr N
/ tr M over the two rows of the position, or tr(N·M⁺)/rank M over all. Of a fix that fails the δS test of eq. (22), the
equation says that λ is 1 and the text that only one that passes "will be input": both readings are offered. Only δS = 3
m is printed, no noise; a run of rejected fixes ends after a few, since fixes of σ > δS would otherwise leave dead
reckoning without corrections for good.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, TypeAlias

import numpy as np

from tickfix.api import (
    Belief,
    Fix,
    Floats,
    Ints,
    Motion,
    PredictUpdateFilter,
    Preset,
    Report,
    Rng,
    displacement,
    frozen,
    heading_of,
    parameter,
    wrap_rad,
)
from tickfix.toolkit.fix_errors import FloorHysteresis

FadingMethod: TypeAlias = Literal["trace", "pinv", "off"]
"""tr N / tr M of the place, tr(N·M⁺)/rank M of all rows, or 1."""


def residuals_covariance(V: Floats, measured: Ints, v: Floats, rows: Sequence[int], rho: float) -> tuple[Floats, Ints]:
    """Return Σ_V̄ (5, 5) with new residuals folded in, and which of its rows were ever seen (5,).

    Args:
        V, measured: the same before.
        v: (5,) residuals.
        rows: those of them that were measured.
        rho: ρ.
    """
    V, measured = V.copy(), measured.copy()
    for i in rows:
        for j in rows:
            known = measured[i] and measured[j]
            V[i, j] = (rho * V[i, j] + v[i] * v[j]) / (1.0 + rho) if known else v[i] * v[j]
    measured[rows] = 1
    return V, measured


def fading_factor(
    V: Floats, H: Floats, PhiPPhi: Floats, Q: Floats, R: Floats, rows: Sequence[int], method: FadingMethod
) -> float:
    """Return λ, eqs. (19)–(21).

    Args:
        V: (5, 5) Σ_V̄, this epoch's residuals included.
        H: (5, 4).
        PhiPPhi, Q: (4, 4), Φ P Φᵀ and the noise of the system.
        R: (5, 5), the noise of the observation.
        rows: those that were measured, for ``pinv``; ``trace`` looks at the place alone.
        method: one of :data:`FadingMethod`.
    """
    if method == "off":
        return 1.0
    r = np.array(list(rows) if method == "pinv" else [0, 1], dtype=np.int64)
    H = H[r]
    M = H @ PhiPPhi @ H.T  # eq. (20)
    N = V[np.ix_(r, r)] - H @ Q @ H.T - R[np.ix_(r, r)]  # eq. (21)
    if method == "trace":
        return max(1.0, float(np.trace(N) / np.trace(M))) if np.trace(M) > 0.0 else 1.0
    n = int(np.linalg.matrix_rank(M, hermitian=True))
    return max(1.0, float(np.trace(N @ np.linalg.pinv(M, hermitian=True))) / max(n, 1))


@dataclass(frozen=True)
class FadingParams:
    """Parameters of the fading-factor filter."""

    delta_s_m: Annotated[float, parameter("δS", unit="m", source="[wang2015] eq. (22), section 4.4", gt=0)] = 3.0
    reject_go_and_back: Annotated[
        bool, parameter("drop a fix that fails the δS test; otherwise it counts, with λ = 1", source="[wang2015] 4.3")
    ] = False
    max_rejected_fixes: Annotated[
        int, parameter("after this many consecutive rejected fixes the next one is used", ge=1, formerly="patience")
    ] = 5
    fading: Annotated[
        FadingMethod,
        parameter("λ: tr N / tr M of the place, tr(N·M⁺)/rank M, or 1", source="[wang2015] eq. (19)"),
    ] = "trace"
    forgetting_factor: Annotated[
        float, parameter("ρ of the residuals' covariance", source="[zhou1996]", ge=0, le=1, formerly="memory")
    ] = 0.95
    acceleration_mps2: Annotated[
        float, parameter("σ of W, north and east", unit="m/s²", source="[wang2015] eq. (9)", gt=0)
    ] = 0.5
    odometry_sigma_m: Annotated[
        float, parameter("σ of s_e and of s_n over 2 s; their variance grows with time", unit="m", gt=0)
    ] = 0.5
    heading_sigma_rad: Annotated[float, parameter("σ of the heading", unit="rad", gt=0)] = 0.3
    fix_sigma_m: Annotated[
        float, parameter("σ of N_wifi and of E_wifi; 0: the covariance of the fix", unit="m", ge=0)
    ] = 0.0
    min_heading_speed_mps: Annotated[
        float, parameter("slower than this the heading is left out", unit="m/s", gt=0, formerly="crawl_mps")
    ] = 0.3
    speed_sigma_mps: Annotated[float, parameter("σ of the first v_n and v_e", unit="m/s", ge=0)] = 1.0


def predict_state(X: Floats, P: Floats, t: float, params: FadingParams) -> tuple[Floats, Floats, Floats]:
    """Return X (4,), Φ P Φᵀ and Q (4, 4) after ``t`` seconds."""
    Phi = np.eye(4)
    Phi[[0, 1], [2, 3]] = t  # eq. (10)
    Gamma = np.array([[0.5 * t**2, 0.0], [0.0, 0.5 * t**2], [t, 0.0], [0.0, t]])  # eq. (11)
    return Phi @ X, Phi @ P @ Phi.T, params.acceleration_mps2**2 * Gamma @ Gamma.T  # eqs. (16), (17)


def observation_model(
    X: Floats, t: float, wifi: tuple[Floats, Floats], odometry: Floats, heading_rad: float | None, params: FadingParams
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return Z and h(X) (5,), H (5, 4) and R (5, 5), eqs. (12)–(13).

    Args:
        X: (4,) predicted.
        t: seconds since the last fix.
        wifi: N_wifi and E_wifi (2,), and their noise (2, 2).
        odometry: (2,) s_n and s_e.
        heading_rad: None without a heading; its row is then ignored.
        params: the noises.
    """
    _, _, v_n, v_e = X
    s_n, s_e = odometry
    Z = np.array([*wifi[0], s_e, s_n, heading_rad or 0.0])
    h = np.array([X[0], X[1], v_e * t, v_n * t, math.atan2(v_e, v_n)])
    H = np.zeros((5, 4))
    H[[0, 1], [0, 1]] = 1.0
    H[[2, 3], [3, 2]] = t
    H[4, 2:] = np.array([-v_e, v_n]) / max(v_n**2 + v_e**2, params.min_heading_speed_mps**2)
    R = np.zeros((5, 5))
    R[:2, :2] = wifi[1]
    R[[2, 3], [2, 3]] = 0.5 * t * params.odometry_sigma_m**2
    R[4, 4] = params.heading_sigma_rad**2
    return Z, h, H, R


_N_E = [1, 0]  # the floor's frame has x = E before y = N


@dataclass(frozen=True, slots=True)
class FadingState:
    """X (4,), its covariance P (4, 4), and what was measured since the last fix.

    Attributes:
        X, P: [N, E, v_n, v_e] in m and m/s, at the last fix.
        V: (5, 5), the residuals' covariance Σ_V̄; ``measured`` marks the rows that were ever measured.
        wifi: (2,) N and E of the last fix.
        odometry: (2,) N and E walked since, metres.
        since_fix_s: time since.
        heading_rad: the newest, None without compass.
        has_heading: the heading of the way is known.
        rejected_fixes: fixes dropped in a row.
        lam: the last λ.
    """

    X: Floats
    P: Floats
    V: Floats
    measured: Ints
    wifi: Floats
    odometry: Floats
    since_fix_s: float = 0.0
    heading_rad: float | None = None
    has_heading: bool = True
    rejected_fixes: int = 0
    lam: float = 1.0


@dataclass(frozen=True, slots=True)
class FixCorrection:
    """What a fix did: whether it was used, whether it failed the δS test, its residual (2,) and normalised square."""

    used: bool
    go_and_back: bool
    residual: Floats
    nis: float

    @property
    def report(self) -> Report:
        """The correction as a report of the filter."""
        return Report(
            used=int(self.used),
            gated=int(not self.used),
            innovation_m=float(np.hypot(*self.residual)),
            nis=self.nis if self.used else None,
            reasons=("go and back",) if self.go_and_back else (),
        )


def initial_state(xy: Floats, covariance: Floats, params: FadingParams) -> FadingState:
    """Return the state at a fix (2,) with covariance (2, 2), floor frame."""
    P = np.zeros((4, 4))
    P[:2, :2] = _R_wifi(covariance, params)
    P[[2, 3], [2, 3]] = params.speed_sigma_mps**2
    place = frozen(xy[_N_E])
    return FadingState(
        X=frozen([*place, 0.0, 0.0]),
        P=frozen(P),
        V=frozen(np.zeros((5, 5))),
        measured=frozen(np.zeros(5), np.int64),
        wifi=place,
        odometry=frozen(np.zeros(2)),
    )


def accumulate_motion(state: FadingState, motion: Motion) -> FadingState:
    """Return the state with a tick's motion added to the way since the last fix."""
    since_fix_s = state.since_fix_s + (motion.t1_ns - motion.t0_ns) * 1e-9
    if motion.heading_rad is None:
        return replace(state, since_fix_s=since_fix_s, heading_rad=None, has_heading=False)
    odometry = state.odometry + displacement(motion.distance_m, motion.heading_rad)[_N_E]
    return replace(state, since_fix_s=since_fix_s, odometry=frozen(odometry), heading_rad=motion.heading_rad)


def extrapolate(state: FadingState, params: FadingParams) -> tuple[Floats, Floats]:
    """Return place (2,) and covariance (2, 2) now, floor frame: dead reckoned, or by the speed without a compass."""
    if state.since_fix_s == 0.0:
        return state.X[_N_E], state.P[:2, :2][_N_E][:, _N_E]
    if state.has_heading:
        place = state.X[:2] + state.odometry
        P = state.P[:2, :2] + 0.5 * state.since_fix_s * params.odometry_sigma_m**2 * np.eye(2)
    else:
        X, PhiPPhi, Q = predict_state(state.X, state.P, state.since_fix_s, params)
        place, P = X[:2], (PhiPPhi + Q)[:2, :2]
    return place[_N_E], P[_N_E][:, _N_E]


def velocity(state: FadingState) -> Floats:
    """Return the velocity (2,) at the last fix, floor frame."""
    return state.X[2:][_N_E]


def speed_and_heading(state: FadingState) -> tuple[float, float | None]:
    """Return speed in m/s and heading: the compass's, without one that of the velocity, None while standing."""
    v = velocity(state)
    heading = heading_of(v) if state.heading_rad is None and v.any() else state.heading_rad
    return float(np.hypot(*v)), heading


def correct_by_fix(
    state: FadingState, xy: Floats, covariance: Floats, params: FadingParams
) -> tuple[FadingState, FixCorrection]:
    """Return the state corrected by a fix (2,) with covariance (2, 2), floor frame, and by the motion before it."""
    t, wifi = state.since_fix_s, xy[_N_E]
    X, PhiPPhi, Q = predict_state(state.X, state.P, state.since_fix_s, params)
    noise = _R_wifi(covariance, params)
    Z, h, H, R = observation_model(X, t, (wifi, noise), state.odometry, state.heading_rad, params)
    v = Z - h
    v[4] = wrap_rad(float(v[4]))

    # Without the way walked there is nothing to hold the fixes' increments against.
    go_and_back = (
        state.has_heading and t > 0.0 and bool(np.hypot(*(wifi - state.wifi - state.odometry)) >= params.delta_s_m)
    )
    use = not (go_and_back and params.reject_go_and_back and state.rejected_fixes < params.max_rejected_fixes)
    rows = [0, 1] if use else []
    if state.has_heading and t > 0.0:
        rows += [2, 3]
        if float(X[2] ** 2 + X[3] ** 2) >= params.min_heading_speed_mps**2:
            rows += [4]
    V, measured = residuals_covariance(state.V, state.measured, v, rows, params.forgetting_factor)
    lam = 1.0 if go_and_back or not use else fading_factor(V, H, PhiPPhi, Q, R, rows, params.fading)
    P = lam * PhiPPhi + Q  # eqs. (17), (22)

    r = np.array(rows, dtype=np.int64)
    nis = 0.0
    if len(r):
        H, R, v = H[r], R[np.ix_(r, r)], v[r]
        S = H @ P @ H.T + R
        G = np.linalg.solve(S, H @ P).T  # eq. (15)
        X = X + G @ v  # eq. (14)
        # P = (I − G H) P, eq. (18), written so that rounding cannot cost its symmetry or sign.
        left = np.eye(4) - G @ H
        nis = float(v[:2] @ np.linalg.solve(S[:2, :2], v[:2])) if use else 0.0
        P = left @ P @ left.T + G @ R @ G.T
    corrected = replace(
        state,
        X=frozen(X),
        P=frozen(0.5 * (P + P.T)),
        V=frozen(V),
        measured=frozen(measured, np.int64),
        wifi=frozen(wifi),
        odometry=frozen(np.zeros(2)),
        since_fix_s=0.0,
        has_heading=True,
        rejected_fixes=0 if use else state.rejected_fixes + 1,
        lam=lam,
    )
    return corrected, FixCorrection(use, go_and_back, (Z - h)[:2], nis)


def _R_wifi(covariance: Floats, params: FadingParams) -> Floats:  # noqa: N802 - the paper's symbol
    """Return the noise (2, 2) of N_wifi, E_wifi for a fix's covariance in the floor's frame."""
    if params.fix_sigma_m > 0.0:
        return params.fix_sigma_m**2 * np.eye(2)
    return covariance[_N_E][:, _N_E]


@dataclass(frozen=True)
class FadingEkfParams(FadingParams):
    """Parameters of ``fading-ekf``."""


@dataclass(frozen=True, slots=True)
class FadingEkfState:
    """The filter's state and the floor it is on."""

    hysteresis: FloorHysteresis
    ekf: FadingState


class FadingEkf(PredictUpdateFilter[FadingEkfParams, FadingEkfState]):
    """Fixes, pseudo-odometry and heading in an extended Kalman filter that trusts the past less when it erred."""

    name = "fading-ekf"
    source = "[wang2015] section 4, eqs. (8)–(22); [zhou1996] for the residuals' covariance"
    Params = FadingEkfParams
    State = FadingEkfState
    presets: ClassVar[Mapping[str, Preset]] = {
        "wang2015": Preset(
            source="[wang2015] section 4, eq. (22) as printed",
            values={"delta_s_m": 3.0, "reject_go_and_back": False, "fading": "trace"},
        ),
        "wang2015-reject": Preset(
            source="[wang2015] section 4.3, the text after eq. (22)",
            values={"delta_s_m": 3.0, "reject_go_and_back": True, "fading": "trace"},
        ),
    }

    def begin(self, fix: Fix, rng: Rng) -> FadingEkfState:  # noqa: ARG002
        """Stand at the fix."""
        return FadingEkfState(FloorHysteresis(fix.floor), initial_state(fix.xy, fix.covariance, self.params))

    def predict(self, state: FadingEkfState, motion: Motion, rng: Rng) -> FadingEkfState:  # noqa: ARG002
        """Carry the motion until the next fix."""
        return replace(state, ekf=accumulate_motion(state.ekf, motion))

    def update(self, state: FadingEkfState, fix: Fix, rng: Rng) -> tuple[FadingEkfState, Report]:
        """Predict to this instant and correct."""
        hysteresis = state.hysteresis.observe(fix.floor)
        if hysteresis.floor != state.hysteresis.floor:
            return self.begin(fix, rng), Report(used=1, reasons=("changed floor",))
        if fix.floor != hysteresis.floor:
            return replace(state, hysteresis=hysteresis), Report(gated=1, reasons=("fix on another floor",))
        ekf, correction = correct_by_fix(state.ekf, fix.xy, fix.covariance, self.params)
        return FadingEkfState(hysteresis, ekf), correction.report

    def estimate(self, state: FadingEkfState) -> Belief:
        """Return the position, dead reckoned since the last fix."""
        xy, covariance = extrapolate(state.ekf, self.params)
        speed_mps, heading_rad = speed_and_heading(state.ekf)
        return Belief(
            floor=state.hysteresis.floor, xy=xy, covariance=covariance, speed_mps=speed_mps, heading_rad=heading_rad
        )
