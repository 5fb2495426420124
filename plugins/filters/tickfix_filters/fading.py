"""The fading-factor extended Kalman filter of [wang2015] section 4, for the filters that run it.

State X = [N, E, v_n, v_e]. It is predicted at the instants of fixes, t after the last one; in between, only the way and
the heading that dead reckoning tells are kept. An observation is Z = [N_wifi, E_wifi, s_e, s_n, heading]: the fix, the
way since the last fix (pseudo-odometry) and the heading. Rows that were not measured, or say nothing, are left out: way
and heading where there is no compass, the heading below a crawl, where the direction of v means nothing.

λ (eqs. 19–21) compares the residuals seen with those expected. Σ_V̄, whose recursion is not printed, is that of the
strong tracking filter, Σ_V̄ ← (ρ·Σ_V̄ + v·vᵀ)/(1 + ρ), [zhou1996] Zhou and Frank, "Strong tracking filtering of
nonlinear time-varying stochastic systems with coloured noise", Int. J. Control 65 (1996). M (5 × 5 of a 4-state
covariance) has no inverse: λ is tr N / tr M over the two rows of the place, or tr(N·M⁺)/n with n = rank M over all.

The test |S_WIFI − S_PDR| < δS of eq. (22) compares the ways between two fixes. Of one that fails the equation says that
λ is 1, the text that only one that passes "will be input": both readings are offered. As S is an increment, the fix
after a bad one fails too. None of the noises is printed, only δS = 3 m; a run of dropped fixes ends after a few, since
fixes of σ > δS would otherwise leave dead reckoning alone for good.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np

from tickfix.api import Floats, Ints, Motion, displacement, frozen, parameter, wrap_rad

_N_E = [1, 0]  # the floor's frame has x = E before y = N


@dataclass(frozen=True)
class FadingParams:
    """Parameters of the fading-factor filter."""

    delta_s_m: Annotated[float, parameter("δS", unit="m", source="[wang2015] eq. (22), section 4.4", gt=0)] = 3.0
    reject_go_and_back: Annotated[
        bool, parameter("drop a fix that fails the δS test; otherwise it counts, with λ = 1", source="[wang2015] 4.3")
    ] = False
    patience: Annotated[int, parameter("after so many fixes dropped in a row the next one counts", ge=1)] = 5
    fading: Annotated[
        Literal["trace", "pinv", "off"],
        parameter("λ: tr N / tr M of the place, tr(N·M⁺)/rank M, or 1", source="[wang2015] eq. (19)"),
    ] = "trace"
    memory: Annotated[float, parameter("ρ of the residuals' covariance", source="[zhou1996]", ge=0, le=1)] = 0.95
    acceleration_mps2: Annotated[
        float, parameter("σ of W, north and east", unit="m/s²", source="[wang2015] eq. (9)", gt=0)
    ] = 0.5
    odometry_sigma_m: Annotated[
        float, parameter("σ of s_e and of s_n over 2 s; their variance grows with time", unit="m", gt=0)
    ] = 0.5
    heading_sigma_rad: Annotated[float, parameter("σ of the heading", unit="rad", gt=0)] = 0.3
    fix_sigma_m: Annotated[float, parameter("σ of N_wifi and of E_wifi; 0: as the fix says", unit="m", ge=0)] = 0.0
    crawl_mps: Annotated[float, parameter("slower than this the heading is left out", unit="m/s", gt=0)] = 0.3
    speed_sigma_mps: Annotated[float, parameter("σ of the first v_n and v_e", unit="m/s", ge=0)] = 1.0


@dataclass(frozen=True, slots=True)
class Fading:
    """X (4,), its covariance P (4, 4), and what was measured since the last fix.

    Attributes:
        X, P: [N, E, v_n, v_e] in m and m/s, at the last fix.
        V: (5, 5), the residuals' covariance Σ_V̄; ``seen`` tells which of its rows were ever measured.
        wifi: (2,) N and E of the last fix.
        way: (2,) N and E walked since, metres.
        since_s: time since.
        heading_rad: the newest, None without compass.
        oriented: the heading of the way is known.
        dropped: fixes dropped in a row.
        fade: the last λ.
    """

    X: Floats
    P: Floats
    V: Floats
    seen: Ints
    wifi: Floats
    way: Floats
    since_s: float = 0.0
    heading_rad: float | None = None
    oriented: bool = True
    dropped: int = 0
    fade: float = 1.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a fix did: whether it was used, whether it failed the δS test, its residual (2,) and normalised square."""

    used: bool
    go_and_back: bool
    residual: Floats
    nis: float


def begin(xy: Floats, covariance: Floats, params: FadingParams) -> Fading:
    """Return the state at a fix (2,) with covariance (2, 2), floor frame."""
    P = np.zeros((4, 4))
    P[:2, :2] = _R_wifi(covariance, params)
    P[[2, 3], [2, 3]] = params.speed_sigma_mps**2
    place = frozen(xy[_N_E])
    return Fading(
        X=frozen([*place, 0.0, 0.0]),
        P=frozen(P),
        V=frozen(np.zeros((5, 5))),
        seen=frozen(np.zeros(5), np.int64),
        wifi=place,
        way=frozen(np.zeros(2)),
    )


def carry(state: Fading, motion: Motion) -> Fading:
    """Return the state with a tick's motion added to the way since the last fix."""
    since_s = state.since_s + (motion.t1_ns - motion.t0_ns) * 1e-9
    if motion.heading_rad is None:
        return replace(state, since_s=since_s, heading_rad=None, oriented=False)
    way = state.way + displacement(motion.distance_m, motion.heading_rad)[_N_E]
    return replace(state, since_s=since_s, way=frozen(way), heading_rad=motion.heading_rad)


def extrapolated(state: Fading, params: FadingParams) -> tuple[Floats, Floats]:
    """Return place (2,) and covariance (2, 2) now, floor frame: dead reckoned, or by the speed without a compass."""
    if state.since_s == 0.0:
        return state.X[_N_E], state.P[:2, :2][_N_E][:, _N_E]
    if state.oriented:
        place = state.X[:2] + state.way
        P = state.P[:2, :2] + 0.5 * state.since_s * params.odometry_sigma_m**2 * np.eye(2)
    else:
        X, predicted, Q = _predicted(state, params)
        place, P = X[:2], (predicted + Q)[:2, :2]
    return place[_N_E], P[_N_E][:, _N_E]


def velocity(state: Fading) -> Floats:
    """Return the velocity (2,) at the last fix, floor frame."""
    return state.X[2:][_N_E]


def correct(state: Fading, xy: Floats, covariance: Floats, params: FadingParams) -> tuple[Fading, Outcome]:
    """Return the state corrected by a fix (2,) with covariance (2, 2), floor frame, and by the motion before it."""
    t, wifi = state.since_s, xy[_N_E]
    X, PhiPPhi, Q = _predicted(state, params)
    Z, h, H, R = _observation(state, X, wifi, _R_wifi(covariance, params), params)
    v = Z - h
    v[4] = wrap_rad(float(v[4]))

    # Without the way walked there is nothing to hold the fixes' increments against.
    go_and_back = state.oriented and t > 0.0 and bool(np.hypot(*(wifi - state.wifi - state.way)) >= params.delta_s_m)
    use = not (go_and_back and params.reject_go_and_back and state.dropped < params.patience)
    rows = [0, 1] if use else []
    if state.oriented and t > 0.0:
        rows += [2, 3]
        if float(X[2] ** 2 + X[3] ** 2) >= params.crawl_mps**2:
            rows += [4]
    V, seen = _residuals(state, v, rows, params.memory)
    fade = 1.0 if go_and_back or not use else _fade(V, H, PhiPPhi, Q, R, rows, params.fading)
    P = fade * PhiPPhi + Q  # eqs. (17), (22)

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
        seen=frozen(seen, np.int64),
        wifi=frozen(wifi),
        way=frozen(np.zeros(2)),
        since_s=0.0,
        oriented=True,
        dropped=0 if use else state.dropped + 1,
        fade=fade,
    )
    return corrected, Outcome(use, go_and_back, (Z - h)[:2], nis)


def _predicted(state: Fading, params: FadingParams) -> tuple[Floats, Floats, Floats]:
    """Return X (4,), Φ P Φᵀ and Q (4, 4) at this instant."""
    t = state.since_s
    Phi = np.eye(4)
    Phi[[0, 1], [2, 3]] = t  # eq. (10)
    Gamma = np.array([[0.5 * t**2, 0.0], [0.0, 0.5 * t**2], [t, 0.0], [0.0, t]])  # eq. (11)
    return Phi @ state.X, Phi @ state.P @ Phi.T, params.acceleration_mps2**2 * Gamma @ Gamma.T  # eqs. (16), (17)


def _observation(
    state: Fading, X: Floats, wifi: Floats, R_wifi: Floats, params: FadingParams
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return Z and h(X) (5,), H (5, 4) and R (5, 5), eqs. (12)–(13)."""
    t, (_, _, v_n, v_e) = state.since_s, X
    s_n, s_e = state.way
    Z = np.array([*wifi, s_e, s_n, state.heading_rad or 0.0])
    h = np.array([X[0], X[1], v_e * t, v_n * t, math.atan2(v_e, v_n)])
    H = np.zeros((5, 4))
    H[[0, 1], [0, 1]] = 1.0
    H[[2, 3], [3, 2]] = t
    H[4, 2:] = np.array([-v_e, v_n]) / max(v_n**2 + v_e**2, params.crawl_mps**2)
    R = np.zeros((5, 5))
    R[:2, :2] = R_wifi
    R[[2, 3], [2, 3]] = 0.5 * t * params.odometry_sigma_m**2
    R[4, 4] = params.heading_sigma_rad**2
    return Z, h, H, R


def _residuals(state: Fading, v: Floats, rows: list[int], rho: float) -> tuple[Floats, Ints]:
    """Return Σ_V̄ (5, 5) with the residuals v of ``rows`` folded in, and which rows were ever seen."""
    V, seen = state.V.copy(), state.seen.copy()
    for i in rows:
        for j in rows:
            known = seen[i] and seen[j]
            V[i, j] = (rho * V[i, j] + v[i] * v[j]) / (1.0 + rho) if known else v[i] * v[j]
    seen[rows] = 1
    return V, seen


def _fade(V: Floats, H: Floats, PhiPPhi: Floats, Q: Floats, R: Floats, rows: list[int], how: str) -> float:
    """Return λ, eqs. (19)–(21)."""
    if how == "off":
        return 1.0
    r = np.array(rows if how == "pinv" else [0, 1], dtype=np.int64)
    H = H[r]
    M = H @ PhiPPhi @ H.T  # eq. (20)
    N = V[np.ix_(r, r)] - H @ Q @ H.T - R[np.ix_(r, r)]  # eq. (21)
    if how == "trace":
        return max(1.0, float(np.trace(N) / np.trace(M))) if np.trace(M) > 0.0 else 1.0
    n = int(np.linalg.matrix_rank(M, hermitian=True))
    return max(1.0, float(np.trace(N @ np.linalg.pinv(M, hermitian=True))) / max(n, 1))


def _R_wifi(covariance: Floats, params: FadingParams) -> Floats:  # noqa: N802 - the paper's symbol
    """Return the noise (2, 2) of N_wifi, E_wifi for a fix's covariance in the floor's frame."""
    if params.fix_sigma_m > 0.0:
        return params.fix_sigma_m**2 * np.eye(2)
    return covariance[_N_E][:, _N_E]
