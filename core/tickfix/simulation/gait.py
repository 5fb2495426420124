"""How a walking body is accelerated."""

from __future__ import annotations

from typing import Final

import numpy as np

from tickfix.api import Floats
from tickfix.simulation.walker import Trajectory

_FORWARD: Final = 0.3
"""Swing of the forward acceleration relative to the vertical one."""
_LATERAL: Final = 0.12
"""Swing from side to side, once per pair of steps, relative to the vertical one."""
_HARMONIC: Final = 0.2
"""Second harmonic of the vertical acceleration: the heel strikes harder than the foot lifts."""


def body_acceleration(trajectory: Trajectory) -> Floats:
    """Return the acceleration of the hand that holds the phone, gravity not included.

    Vertically each step is one wave, −cos(2πφ) with a second harmonic, whose swing a_max − a_min is the step's; that
    swing grows with the fourth power of the step's length, as Weinberg (2002) found. Forward it accelerates and brakes,
    sideways it sways with every pair of steps. Starting, stopping and curves add their own.

    Returns:
        (n, 3) m/s² to the right, forward and up, at the trajectory's instants.
    """
    phi = 2.0 * np.pi * trajectory.phase
    swing = trajectory.swing_mps2
    wave = -np.cos(phi) + _HARMONIC * np.cos(2.0 * phi + np.pi / 3.0)
    up = swing * wave / _WAVE_SWING
    forward = swing * _FORWARD / 2.0 * np.sin(phi)
    right = swing * _LATERAL / 2.0 * np.sin(phi / 2.0)
    forward = forward + np.gradient(trajectory.speed_mps, trajectory.t_s)
    right = right + trajectory.speed_mps * np.gradient(trajectory.heading_rad, trajectory.t_s)
    return np.stack([right, forward, up], axis=1)


def _wave_swing() -> float:
    phi = np.linspace(0.0, 2.0 * np.pi, 3601)
    return float(np.ptp(-np.cos(phi) + _HARMONIC * np.cos(2.0 * phi + np.pi / 3.0)))


_WAVE_SWING: Final = _wave_swing()
