"""The dynamic and the observation equation of [wang2015] sections 4.1 and 4.2.

State X = [N, E, v_n, v_e]; an observation is Z = [N_wifi, E_wifi, s_e, s_n, heading].
"""

from __future__ import annotations

import math

import numpy as np

from tickfix.api import Floats
from tickfix_filters.fading_params import FadingParams


def predicted(X: Floats, P: Floats, t: float, params: FadingParams) -> tuple[Floats, Floats, Floats]:
    """Return X (4,), Φ P Φᵀ and Q (4, 4) after ``t`` seconds."""
    Phi = np.eye(4)
    Phi[[0, 1], [2, 3]] = t  # eq. (10)
    Gamma = np.array([[0.5 * t**2, 0.0], [0.0, 0.5 * t**2], [t, 0.0], [0.0, t]])  # eq. (11)
    return Phi @ X, Phi @ P @ Phi.T, params.acceleration_mps2**2 * Gamma @ Gamma.T  # eqs. (16), (17)


def observation(
    X: Floats, t: float, wifi: tuple[Floats, Floats], way: Floats, heading_rad: float | None, params: FadingParams
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return Z and h(X) (5,), H (5, 4) and R (5, 5), eqs. (12)–(13).

    Args:
        X: (4,) predicted.
        t: seconds since the last fix.
        wifi: N_wifi and E_wifi (2,), and their noise (2, 2).
        way: (2,) s_n and s_e.
        heading_rad: None where there is none; its row then says nothing.
        params: the noises.
    """
    _, _, v_n, v_e = X
    s_n, s_e = way
    Z = np.array([*wifi[0], s_e, s_n, heading_rad or 0.0])
    h = np.array([X[0], X[1], v_e * t, v_n * t, math.atan2(v_e, v_n)])
    H = np.zeros((5, 4))
    H[[0, 1], [0, 1]] = 1.0
    H[[2, 3], [3, 2]] = t
    H[4, 2:] = np.array([-v_e, v_n]) / max(v_n**2 + v_e**2, params.crawl_mps**2)
    R = np.zeros((5, 5))
    R[:2, :2] = wifi[1]
    R[[2, 3], [2, 3]] = 0.5 * t * params.odometry_sigma_m**2
    R[4, 4] = params.heading_sigma_rad**2
    return Z, h, H, R
