"""Which way the phone is turned, and what that makes of vectors and rates."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from tickfix.api import Floats, Rng
from tickfix.simulation.people import Hold


def attitude(heading_rad: Floats, phase: Floats, hold: Hold, dt_s: float, rng: Rng) -> Rotation:
    """Return the rotations from the device to the map's east-north-up, n of them.

    The device's x axis points right, y to its top, z out of the screen. Undisturbed, its top points where the person
    walks, raised by the pitch.

    Args:
        heading_rad: (n,) of walking, clockwise from the map's +y.
        phase: (n,) steps walked.
        hold: how the phone is held.
        dt_s: time from one instant to the next.
        rng: draws the wandering of the hand.
    """
    stride = np.pi * phase
    sway = hold.sway_rad * np.stack([np.sin(stride), np.sin(2.0 * stride) / 2.0, np.sin(stride) / 2.0])
    wander = np.stack([slow_noise(rng, len(phase), hold.wander_rad, hold.wander_s, dt_s) for _ in range(3)])
    yaw, pitch, roll = np.array([[hold.yaw_rad], [hold.pitch_rad], [hold.roll_rad]]) + sway + wander
    return Rotation.from_euler("ZXY", np.stack([-(heading_rad + yaw), pitch, roll], axis=1))


def slow_noise(rng: Rng, n: int, sigma: float, decay_s: float, dt_s: float) -> Floats:
    """Return n values of noise around zero, normal with ``sigma``, that forgets over ``decay_s`` (Gauss–Markov)."""
    keep = float(np.exp(-dt_s / decay_s))
    white = rng.standard_normal(n) * sigma
    white[1:] *= np.sqrt(1.0 - keep**2)
    noise: Floats = lfilter([1.0], [1.0, -keep], white)
    return noise


def rates(attitudes: Rotation, t_s: Floats) -> Floats:
    """Return the mean rate of turning since the sample before, (n, 3) rad/s in the device frame.

    The first sample repeats the second. Turning back by rate × time gives the rotation before exactly, as an
    integrating gyroscope would have it.
    """
    turns = (attitudes[:-1].inv() * attitudes[1:]).as_rotvec() / np.diff(t_s)[:, None]
    return np.concatenate([turns[:1], turns])


def heading_of_attitude(quaternions: Floats) -> Floats:
    """Return where the device's y axis points, (n,) rad clockwise from north, for quaternions (n, 4) x, y, z, w."""
    top = Rotation.from_quat(quaternions).apply([0.0, 1.0, 0.0])
    heading: Floats = np.arctan2(top[:, 0], top[:, 1])
    return heading
