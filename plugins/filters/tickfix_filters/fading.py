"""The fading-factor extended Kalman filter of [wang2015] section 4, for the filters that run it.

State X = [N, E, v_n, v_e]. It is predicted at the instants of fixes, t after the last one; in between, only the way and
the heading that dead reckoning tells are kept. An observation is Z = [N_wifi, E_wifi, s_e, s_n, heading]: the fix, the
way since the last fix (pseudo-odometry) and the heading. Rows that were not measured, or say nothing, are left out: way
and heading where there is no compass, the heading below a crawl, where the direction of v means nothing.

The equations of motion and observation are in :mod:`tickfix_filters.fading_model`, λ of eqs. (19)–(21) in
:mod:`tickfix_filters.fading_factor`; here they are put together.

The test |S_WIFI − S_PDR| < δS of eq. (22) compares the ways between two fixes. Of one that fails the equation says that
λ is 1, the text that only one that passes "will be input": both readings are offered. As S is an increment, the fix
after a bad one fails too. None of the noises is printed, only δS = 3 m; a run of dropped fixes ends after a few, since
fixes of σ > δS would otherwise leave dead reckoning alone for good.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tickfix.api import Floats, Ints, Motion, Report, displacement, frozen, heading_of, wrap_rad
from tickfix_filters.fading_factor import fading_factor, residuals_covariance
from tickfix_filters.fading_model import observation, predicted
from tickfix_filters.fading_params import FadingParams

_N_E = [1, 0]  # the floor's frame has x = E before y = N


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

    @property
    def report(self) -> Report:
        """What a filter tells of it."""
        return Report(
            used=int(self.used),
            gated=int(not self.used),
            innovation_m=float(np.hypot(*self.residual)),
            gate=self.nis if self.used else None,
            reasons=("go and back",) if self.go_and_back else (),
        )


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
        X, PhiPPhi, Q = predicted(state.X, state.P, state.since_s, params)
        place, P = X[:2], (PhiPPhi + Q)[:2, :2]
    return place[_N_E], P[_N_E][:, _N_E]


def velocity(state: Fading) -> Floats:
    """Return the velocity (2,) at the last fix, floor frame."""
    return state.X[2:][_N_E]


def course(state: Fading) -> tuple[float, float | None]:
    """Return speed in m/s and heading: the compass's, without one that of the velocity, None while standing."""
    v = velocity(state)
    heading = heading_of(v) if state.heading_rad is None and v.any() else state.heading_rad
    return float(np.hypot(*v)), heading


def correct(state: Fading, xy: Floats, covariance: Floats, params: FadingParams) -> tuple[Fading, Outcome]:
    """Return the state corrected by a fix (2,) with covariance (2, 2), floor frame, and by the motion before it."""
    t, wifi = state.since_s, xy[_N_E]
    X, PhiPPhi, Q = predicted(state.X, state.P, state.since_s, params)
    noise = _R_wifi(covariance, params)
    Z, h, H, R = observation(X, t, (wifi, noise), state.way, state.heading_rad, params)
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
    V, seen = residuals_covariance(state.V, state.seen, v, rows, params.memory)
    fade = 1.0 if go_and_back or not use else fading_factor(V, H, PhiPPhi, Q, R, rows, params.fading)
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


def _R_wifi(covariance: Floats, params: FadingParams) -> Floats:  # noqa: N802 - the paper's symbol
    """Return the noise (2, 2) of N_wifi, E_wifi for a fix's covariance in the floor's frame."""
    if params.fix_sigma_m > 0.0:
        return params.fix_sigma_m**2 * np.eye(2)
    return covariance[_N_E][:, _N_E]
