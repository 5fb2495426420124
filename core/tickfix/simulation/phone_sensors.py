"""A hand-held phone: its attitude, and what its motion sensors measure with noise, bias, drift and dropouts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from tickfix.api import Floats, Ints, Rng, wrap_rad
from tickfix.simulation.fields import MagneticField
from tickfix.simulation.pedestrian import PhoneHold, Trajectory, body_acceleration
from tickfix.simulation.radio_channel import RECEIVER_HEIGHT_M


def attitude(heading_rad: Floats, phase: Floats, hold: PhoneHold, dt_s: float, rng: Rng) -> Rotation:
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
    wander = np.stack([gauss_markov_noise(rng, len(phase), hold.wander_rad, hold.wander_s, dt_s) for _ in range(3)])
    yaw, pitch, roll = np.array([[hold.yaw_rad], [hold.pitch_rad], [hold.roll_rad]]) + sway + wander
    return Rotation.from_euler("ZXY", np.stack([-(heading_rad + yaw), pitch, roll], axis=1))


def gauss_markov_noise(rng: Rng, n: int, sigma: float, decay_s: float, dt_s: float) -> Floats:
    """Return n values of noise around zero, normal with ``sigma``, that forgets over ``decay_s`` (Gauss–Markov)."""
    keep = float(np.exp(-dt_s / decay_s))
    white = rng.standard_normal(n) * sigma
    white[1:] *= np.sqrt(1.0 - keep**2)
    noise: Floats = lfilter([1.0], [1.0, -keep], white)
    return noise


def angular_rates(attitudes: Rotation, t_s: Floats) -> Floats:
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


GRAVITY: Final = 9.81
"""m/s²"""

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Phone:
    """Motion sensors and their errors; vectors are x, y, z in the device frame.

    Attributes:
        rate_hz: of all motion sensors, which share their times.
        jitter_s: standard deviation of the times around the grid.
        dropouts_per_s: how often all motion sensors fall silent.
        dropout_s: shortest and longest such gap.
        accelerometer_noise_mps2, gyroscope_noise_rad_s, magnetometer_noise_ut: standard deviation of a sample.
        accelerometer_bias_mps2, gyroscope_bias_rad_s: constant.
        accelerometer_scale, gyroscope_scale: relative error.
        gyroscope_walk_rad_s: standard deviation by which the gyroscope's bias has wandered after one second, growing
            with the root of time.
        hard_iron_ut: field of the phone itself that its calibration has left.
        magnet_s: time in which the rotation vector follows the magnetometer; until then it follows the gyroscope.
        yaw_walk_rad: standard deviation by which its heading has drifted after one second.
        yaw_start_rad: standard deviation of its heading's error when the recording begins.
        tilt_rad, tilt_s: standard deviation of its tilt, and over which that decorrelates to 1/e.
        sensors: which of its sensors the phone has.
    """

    rate_hz: float = 50.0
    jitter_s: float = 0.0005
    dropouts_per_s: float = 0.0
    dropout_s: tuple[float, float] = (0.1, 0.5)
    accelerometer_noise_mps2: float = 0.05
    accelerometer_bias_mps2: Vector = (0.0, 0.0, 0.0)
    accelerometer_scale: float = 0.0
    gyroscope_noise_rad_s: float = 0.005
    gyroscope_bias_rad_s: Vector = (0.0, 0.0, 0.0)
    gyroscope_scale: float = 0.0
    gyroscope_walk_rad_s: float = 0.0002
    magnetometer_noise_ut: float = 0.5
    hard_iron_ut: Vector = (0.0, 0.0, 0.0)
    magnet_s: float = 8.0
    yaw_walk_rad: float = 0.005
    yaw_start_rad: float = 0.05
    tilt_rad: float = 0.01
    tilt_s: float = 3.0
    sensors: tuple[str, ...] = ("accelerometer", "gyroscope", "magnetometer", "rotation_vector")


def draw_phone(rng: Rng) -> Phone:
    """Draw a phone: its biases, its scales, its residual hard iron."""

    def vector(sigma: float) -> Vector:
        x, y, z = rng.normal(0.0, sigma, 3).tolist()
        return x, y, z

    return Phone(
        accelerometer_bias_mps2=vector(0.05),
        accelerometer_scale=float(rng.normal(0.0, 0.004)),
        gyroscope_bias_rad_s=vector(0.003),
        gyroscope_scale=float(rng.normal(0.0, 0.005)),
        hard_iron_ut=vector(1.0),
    )


def perfect_phone(rate_hz: float = 50.0) -> Phone:
    """Return a phone without any error, for tests and for finding out what an error costs."""
    return Phone(
        rate_hz=rate_hz,
        jitter_s=0.0,
        accelerometer_noise_mps2=0.0,
        gyroscope_noise_rad_s=0.0,
        gyroscope_walk_rad_s=0.0,
        magnetometer_noise_ut=0.0,
        yaw_walk_rad=0.0,
        yaw_start_rad=0.0,
        tilt_rad=0.0,
    )


def simulate_motion_sensors(
    trajectory: Trajectory, level_m: float, magnetic: MagneticField, phone: Phone, hold: PhoneHold, rng: Rng
) -> tuple[Floats, Mapping[str, Floats]]:
    """Return what the phone measures on a walk.

    Args:
        trajectory: of the person.
        level_m: height of the floor within the building.
        magnetic: the building's field.
        phone, hold: the sensors, and how they are held.
        rng: draws noise and drift.

    Returns:
        Times (n,) in seconds since the recording began, strictly increasing, and by sensor its samples (n, c), as
        :data:`tickfix.api.SENSORS` describes them. North is magnetic north, as a phone knows it.
    """
    time_rng, hand_rng, noise_rng = rng.spawn(3)
    t = _sample_times(float(trajectory.t_s[-1]), phone, time_rng)
    dt = 1.0 / phone.rate_hz
    heading = trajectory.heading_at(t)
    phase = np.interp(t, trajectory.t_s, trajectory.phase)
    device = attitude(heading, phase, hold, dt, hand_rng)
    field = magnetic.at(np.column_stack([trajectory.xy_at(t), np.full(len(t), level_m + RECEIVER_HEIGHT_M)]))
    field_device = device.apply(field, inverse=True) + np.array(phone.hard_iron_ut)
    rng = noise_rng
    samples = {
        "accelerometer": _accelerometer(trajectory, t, heading, device, phone, rng),
        "gyroscope": _gyroscope(device, t, phone, rng),
        "magnetometer": field_device + phone.magnetometer_noise_ut * rng.standard_normal(field_device.shape),
        "rotation_vector": _rotation_vector(
            device, device.apply(field_device), magnetic.settings.north_rad, phone, rng
        ),
    }
    kept = _without_dropouts(t, phone, time_rng)
    return t[kept], {name: samples[name][kept] for name in phone.sensors}


def _sample_times(duration_s: float, phone: Phone, rng: Rng) -> Floats:
    grid = np.arange(int(duration_s * phone.rate_hz)) / phone.rate_hz
    # Never more than a fifth of the grid, so that no sample overtakes another.
    jitter = np.clip(phone.jitter_s * rng.standard_normal(len(grid)), -0.2 / phone.rate_hz, 0.2 / phone.rate_hz)
    times: Floats = grid + jitter + 0.5 / phone.rate_hz
    return times


def _without_dropouts(t: Floats, phone: Phone, rng: Rng) -> Ints:
    kept = np.ones(len(t), dtype=bool)
    for start in rng.uniform(t[0], t[-1], rng.poisson(phone.dropouts_per_s * (t[-1] - t[0]))):
        kept &= (t < start) | (t > start + rng.uniform(*phone.dropout_s))
    return np.flatnonzero(kept)


def _accelerometer(
    trajectory: Trajectory, t: Floats, heading: Floats, device: Rotation, phone: Phone, rng: Rng
) -> Floats:
    body = body_acceleration(trajectory)
    right, forward, up = (np.interp(t, trajectory.t_s, body[:, i]) for i in range(3))
    sin, cos = np.sin(heading), np.cos(heading)
    world = np.stack([right * cos + forward * sin, forward * cos - right * sin, up + GRAVITY], axis=1)
    true = device.apply(world, inverse=True)
    noise = phone.accelerometer_noise_mps2 * rng.standard_normal(true.shape)
    scale, bias = 1.0 + phone.accelerometer_scale, np.array(phone.accelerometer_bias_mps2)
    measured: Floats = true * scale + bias + noise
    return measured


def _gyroscope(device: Rotation, t: Floats, phone: Phone, rng: Rng) -> Floats:
    true = angular_rates(device, t)
    drift = phone.gyroscope_walk_rad_s / np.sqrt(phone.rate_hz) * rng.standard_normal(true.shape).cumsum(axis=0)
    noise = phone.gyroscope_noise_rad_s * rng.standard_normal(true.shape)
    measured: Floats = true * (1.0 + phone.gyroscope_scale) + np.array(phone.gyroscope_bias_rad_s) + drift + noise
    return measured


def _rotation_vector(device: Rotation, field: Floats, north_rad: float, phone: Phone, rng: Rng) -> Floats:
    """Return the quaternions (n, 4) of a phone that takes the direction of ``field`` (n, 3) for north, with a lag."""
    n = len(field)
    share = 1.0 - np.exp(-1.0 / (phone.rate_hz * phone.magnet_s))
    # A field that is turned clockwise makes the phone believe that it points further anticlockwise.
    pull = -np.unwrap(wrap_rad(np.arctan2(field[:, 0], field[:, 1]) - north_rad))
    drive = share * pull + phone.yaw_walk_rad / np.sqrt(phone.rate_hz) * rng.standard_normal(n)
    drive[0] = pull[0] + phone.yaw_start_rad * rng.standard_normal()
    error = lfilter([1.0], [1.0, share - 1.0], drive)
    tilt = np.stack(
        [gauss_markov_noise(rng, n, phone.tilt_rad, phone.tilt_s, 1.0 / phone.rate_hz) for _ in range(2)], axis=1
    )
    turned = Rotation.from_rotvec(np.column_stack([tilt, north_rad - error]))
    quaternions: Floats = (turned * device).as_quat(canonical=True)
    return quaternions
