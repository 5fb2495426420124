"""Where the phone points, from whichever sensors there are: clockwise from north, radians.

The phone is taken to point along its y axis, the long one, or along −z where it is held upright. In order of trust:

1. the rotation vector, which the phone's own filter computed from all sensors; with ``gyroscope_time_constant_s`` its
   long-term mean alone, carried from moment to moment by the gyroscope: steel in a building bends the rotation vector
   too;
2. gyroscope and magnetometer: yaw integrated and slowly pulled to the compass;
3. the magnetometer alone: the tilt-compensated compass, smoothed;
4. the gyroscope alone: how it turned, but not where to.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from tickfix.api import Floats, MotionSamples, Samples, wrap_rad

_GRAVITY_TIME_CONSTANT_S: Final = 0.5
_COMPASS_WITH_GYROSCOPE_S: Final = 10.0
_COMPASS_ALONE_S: Final = 0.5
_UPRIGHT_LIMIT: Final = 0.35  # horizontal part of the y axis below which the phone stands rather than lies
_MAX_DT_S: Final = 0.2
_GYROSCOPE_TIMEOUT_NS: Final = 1_000_000_000


@dataclass(frozen=True, slots=True)
class HeadingState:
    """What is known of the direction.

    Attributes:
        heading_rad: None until a sensor measured one.
        up: gravity's reaction in the device frame, smoothed, m/s²; zero before the first acceleration.
        gyroscope_ns: the last gyroscope sample's time, −1 before the first.
        compass_s: for how long the compass has been listened to.
    """

    heading_rad: float | None = None
    up: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyroscope_ns: int = -1
    compass_s: float = 0.0


@dataclass(frozen=True, slots=True)
class TickDirection:
    """Mean direction (sin, cos) over a tick, and how far the phone turned in it."""

    sin: float
    cos: float
    turn_rad: float
    known: bool


def update_heading(
    state: HeadingState, samples: MotionSamples, *, gyroscope_time_constant_s: float = 0.0
) -> tuple[HeadingState, TickDirection]:
    """Fold a tick's samples; return the new state and the direction during the tick.

    Args:
        state: after the tick before.
        samples: of the tick.
        gyroscope_time_constant_s: time constant with which a gyroscope's yaw is pulled to the rotation vector; at
            first, and with a time constant longer than the walk, it is the mean since the walk began that pulls. 0: the
            rotation vector is followed as it is.
    """
    dt = (samples.t1_ns - samples.t0_ns) * 1e-9
    up = update_gravity(state.up, samples.sensors.get("accelerometer"), dt)
    turned, gyroscope_ns = integrate_yaw(state.gyroscope_ns, samples.sensors.get("gyroscope"), up)
    rotation = samples.sensors.get("rotation_vector")
    magnetometer = samples.sensors.get("magnetometer")
    heading, compass_s = state.heading_rad, state.compass_s
    sin = cos = 0.0
    compass, time_constant_s = None, 0.0
    if rotation is not None:
        azimuths = azimuth_from_quaternions(rotation.values)
        n = len(azimuths)
        sin, cos = float(np.sin(azimuths).sum()) / n, float(np.cos(azimuths).sum()) / n
        # A tick may lie between two samples of a gyroscope that is well.
        carried = gyroscope_ns >= 0 and samples.t1_ns - gyroscope_ns <= _GYROSCOPE_TIMEOUT_NS
        compass, time_constant_s = float(azimuths[-1]), gyroscope_time_constant_s if carried else 0.0
    elif magnetometer is not None and any(up):
        compass = compass_heading(magnetometer.values.mean(axis=0), np.array(up))
        time_constant_s = _COMPASS_ALONE_S if turned is None else _COMPASS_WITH_GYROSCOPE_S
    if compass is not None and time_constant_s:
        compass_s = min(compass_s + dt, time_constant_s)
        predicted = compass if heading is None else heading + (turned or 0.0)
        pulled = predicted + dt / (compass_s + dt) * float(wrap_rad(compass - predicted))
        turned = turned if turned is not None else (0.0 if heading is None else pulled - heading)
        heading = pulled
    elif compass is not None:
        turned = compass - heading if heading is not None and turned is None else (turned or 0.0)
        heading = compass
    elif heading is not None and turned is not None:
        heading += turned
    if heading is not None:
        heading = float(wrap_rad(heading))
        if rotation is None or time_constant_s:
            sin, cos = math.sin(heading), math.cos(heading)
    direction = TickDirection(sin, cos, float(wrap_rad(turned or 0.0)), known=heading is not None)
    return HeadingState(heading, up, gyroscope_ns, compass_s), direction


def azimuth_from_quaternions(quaternions: Floats) -> Floats:
    """Return where the phone points (n,), clockwise from north, for quaternions (n, 4) x, y, z, w device → ENU."""
    x, y, z, w = quaternions.T
    east, north = 2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z)
    upright = np.hypot(east, north) < _UPRIGHT_LIMIT
    if upright.any():
        east = np.where(upright, -2.0 * (x * z + y * w), east)
        north = np.where(upright, -2.0 * (y * z - x * w), north)
    azimuth: Floats = np.arctan2(east, north)
    return azimuth


def compass_heading(field: Floats, up: Floats) -> float:
    """Return where the phone points by the magnetic field (3,) and the vertical (3,), both in the device frame."""
    up = up / np.linalg.norm(up)
    east = np.cross(field, up)
    norm = float(np.linalg.norm(east))
    if norm == 0.0:
        return 0.0  # no field across the vertical: nothing points anywhere
    east = east / norm
    north = np.cross(up, east)
    axis = 1 if math.hypot(east[1], north[1]) >= _UPRIGHT_LIMIT else 2
    sign = 1.0 if axis == 1 else -1.0
    return math.atan2(sign * float(east[axis]), sign * float(north[axis]))


def update_gravity(up: tuple[float, float, float], samples: Samples | None, dt: float) -> tuple[float, float, float]:
    """Return gravity's reaction in the device frame after ``dt`` seconds of samples, smoothed."""
    if samples is None:
        return up
    x, y, z = (samples.values.sum(axis=0) / len(samples)).tolist()
    if not any(up):
        return x, y, z
    gain = dt / (_GRAVITY_TIME_CONSTANT_S + dt)
    return up[0] + gain * (x - up[0]), up[1] + gain * (y - up[1]), up[2] + gain * (z - up[2])


def integrate_yaw(last_ns: int, samples: Samples | None, up: tuple[float, float, float]) -> tuple[float | None, int]:
    """Return how far the phone turned clockwise about the vertical, None without gyroscope or vertical."""
    if samples is None:
        return None, last_ns
    vertical = np.array(up)
    length = math.hypot(*up)
    newest_ns = int(samples.t_ns[-1])
    if length == 0.0:
        return None, newest_ns
    dt = np.empty(len(samples))
    dt[0] = 0.0 if last_ns < 0 else (int(samples.t_ns[0]) - last_ns) * 1e-9
    np.multiply(samples.t_ns[1:] - samples.t_ns[:-1], 1e-9, out=dt[1:])
    np.minimum(dt, _MAX_DT_S, out=dt)
    # The right-hand rule turns counter-clockwise seen from above; headings run clockwise.
    return -float(dt @ (samples.values @ vertical)) / length, newest_ns
