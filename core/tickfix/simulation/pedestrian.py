"""A pedestrian on a route.

Who walks and how the phone is held, the motion profile (speeds that turning allows, stops, step times), the true
trajectory and steps, and the acceleration of the body.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from tickfix.api import Floats, Rng, frozen, wrap_rad
from tickfix.simulation.routes import Route


@dataclass(frozen=True, slots=True, kw_only=True)
class PhoneHold:
    """How somebody holds the phone in the hand.

    Attributes:
        pitch_rad: of the phone's top above the horizon.
        yaw_rad: where the phone points, clockwise from where the person walks.
        roll_rad: right edge down.
        sway_rad: amplitude of the turning to and fro with every stride, a pair of steps; half of it in pitch and roll.
        wander_rad: standard deviation of the hand's slow wandering in each angle.
        wander_s: over which it decorrelates to 1/e.
    """

    pitch_rad: float = 0.7
    yaw_rad: float = 0.0
    roll_rad: float = 0.0
    sway_rad: float = 0.05
    wander_rad: float = 0.03
    wander_s: float = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Walker:
    """How somebody walks.

    Attributes:
        speed_mps: preferred.
        speed_variation: standard deviation of the speed along the way, relative; it changes over some 5 m.
        walk_ratio_ms: step length over cadence, m·s, a person's constant at any speed (Sekiya and Nagasaki 1998):
            length √(speed·ratio), cadence √(speed/ratio).
        weinberg_k: K of Weinberg (2002), m^(3/4)·s^(1/2): length = K·(a_max − a_min)^(1/4), by which steps shake.
        step_jitter: standard deviation of a step's duration, relative.
        swing_jitter: standard deviation of a step's swing a_max − a_min, relative.
        acceleration_mps2: when starting, stopping, and slowing for a corner.
        turn_rad_s: greatest rate of turning.
        pauses_per_m: how often they stop to look around.
        pause_s: shortest and longest such stop.
        stand_s: how long they stand before the first step and after the last.
        hold: of the phone.
    """

    speed_mps: float = 1.25
    speed_variation: float = 0.06
    walk_ratio_ms: float = 0.39
    weinberg_k: float = 0.43
    step_jitter: float = 0.02
    swing_jitter: float = 0.1
    acceleration_mps2: float = 1.0
    turn_rad_s: float = 2.2
    pauses_per_m: float = 0.01
    pause_s: tuple[float, float] = (2.0, 6.0)
    stand_s: float = 1.5
    hold: PhoneHold = PhoneHold()


def draw_walker(rng: Rng) -> Walker:
    """Draw a person: their pace, their step, their hand."""
    return Walker(
        speed_mps=float(np.clip(rng.normal(1.25, 0.12), 0.9, 1.6)),
        walk_ratio_ms=float(np.clip(rng.normal(0.39, 0.025), 0.32, 0.46)),
        weinberg_k=float(np.clip(rng.normal(0.43, 0.015), 0.39, 0.47)),
        hold=PhoneHold(
            pitch_rad=float(np.radians(rng.uniform(30.0, 50.0))),
            yaw_rad=float(np.radians(np.clip(rng.normal(0.0, 6.0), -15.0, 15.0))),
            roll_rad=float(np.radians(rng.normal(0.0, 3.0))),
            sway_rad=float(np.radians(rng.uniform(2.0, 5.0))),
        ),
    )


_STEP_M: Final = 0.02
"""Resolution of the line."""
_SMOOTH_M: Final = 0.16
"""Headings are averaged over this much of the line, since an arc comes as a polygon."""
_SHARP_RAD: Final = 0.3
"""A corner sharper than this is turned on the spot."""
_VARIATION_M: Final = 5.0
"""Over which the speed changes."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MotionProfile:
    """Knots of a walk, linear between them.

    Attributes:
        t_s, distance_m, heading_rad, speed_mps: (n,) at each knot; the heading is continuous.
        line_m, line_xy: (m,), (m, 2): the line, by the way along it.
    """

    t_s: Floats
    distance_m: Floats
    heading_rad: Floats
    speed_mps: Floats
    line_m: Floats
    line_xy: Floats


def motion_profile(line: Floats, walker: Walker, rng: Rng) -> tuple[MotionProfile, tuple[Floats, ...]]:
    """Walk along a line (m, 2).

    Returns:
        The course, and for each bout of walking between two stops the times (k + 1,) that bound its k steps.
    """
    line_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    t, distance, heading, speed = [0.0], [0.0], [_headings(line)[0]], [0.0]
    bouts: list[Floats] = []

    def stand(seconds: float, towards: float) -> None:
        """Stand, then face ``towards``, the shorter way round."""
        turn = wrap_rad(towards - heading[-1])
        for pause, angle in ((seconds, 0.0), (abs(turn) / walker.turn_rad_s, turn)):
            if pause > 0:
                t.append(t[-1] + pause)
                distance.append(distance[-1])
                heading.append(heading[-1] + float(angle))
                speed.append(0.0)

    stand(walker.stand_s, heading[0])
    for start, end in _legs(line, line_m):
        for at, theta, pause in _bouts(line, line_m, (start, end), walker, rng):
            stand(pause, float(theta[0]))
            ds = np.diff(at)
            limit = walker.speed_mps * np.exp(
                walker.speed_variation * _smooth_noise(rng, len(at), _VARIATION_M / float(ds.mean()))
            )
            v = _speed_limit(
                at,
                np.minimum(limit, walker.turn_rad_s / np.maximum(1e-9, _curvature(at, theta))),
                walker.acceleration_mps2,
            )
            dt = 2.0 * ds / (v[:-1] + v[1:])
            elapsed = t[-1] + np.concatenate([[0.0], np.cumsum(dt)])
            bouts.append(_step_times(elapsed, np.sqrt(v / walker.walk_ratio_ms), walker.step_jitter, rng))
            # Whole turns, so that the heading goes on from where it stood.
            turns = np.round((heading[-1] - theta[0]) / (2.0 * np.pi))
            t += elapsed[1:].tolist()
            distance += at[1:].tolist()
            heading += (theta[1:] + 2.0 * np.pi * turns).tolist()
            speed += v[1:].tolist()
    stand(walker.stand_s, heading[-1])
    profile = MotionProfile(
        t_s=np.array(t),
        distance_m=np.array(distance),
        heading_rad=np.array(heading),
        speed_mps=np.array(speed),
        line_m=line_m,
        line_xy=line,
    )
    return profile, tuple(bouts)


def _headings(xy: Floats) -> Floats:
    headings: Floats = np.arctan2(*np.diff(xy, axis=0).T)
    return headings


def _legs(line: Floats, line_m: Floats) -> list[tuple[float, float]]:
    """Cut the line at its sharp corners."""
    turn = wrap_rad(np.diff(_headings(line)))
    cuts = [0.0, *line_m[1:-1][np.abs(turn) > _SHARP_RAD].tolist(), float(line_m[-1])]
    return list(pairwise(cuts))


def _bouts(
    line: Floats, line_m: Floats, leg: tuple[float, float], walker: Walker, rng: Rng
) -> list[tuple[Floats, Floats, float]]:
    """Cut a leg at pauses: way (n,) and heading (n,) of the knots of each bout, and the pause before it in seconds."""
    start, end = leg
    n = max(8, int(np.ceil((end - start) / _STEP_M)))
    at = np.linspace(start, end, n + 1)
    xy = np.stack([np.interp(at, line_m, line[:, i]) for i in range(2)], axis=1)
    size = max(1, round(_SMOOTH_M * n / (end - start)))
    theta = uniform_filter1d(np.unwrap(_headings(xy)), min(size, n), mode="nearest")
    knots = np.concatenate([theta[:1], (theta[:-1] + theta[1:]) / 2.0, theta[-1:]])
    # A pause less than two metres from a corner or another pause would only make for hops.
    apart = int(np.ceil(2.0 * n / (end - start)))
    wished = np.sort(rng.integers(0, n, rng.poisson(walker.pauses_per_m * (end - start))))
    cuts = [0]
    for cut in wished.tolist():
        if cut - cuts[-1] >= apart and n - cut >= apart:
            cuts.append(cut)
    pauses = [0.0, *rng.uniform(*walker.pause_s, len(cuts) - 1).tolist()]
    ends = [*cuts[1:], n]
    return [(at[a : b + 1], knots[a : b + 1], p) for a, b, p in zip(cuts, ends, pauses, strict=True)]


def _curvature(at: Floats, theta: Floats) -> Floats:
    curvature: Floats = np.abs(np.gradient(theta, at))
    return curvature


def _speed_limit(at: Floats, limit: Floats, acceleration: float) -> Floats:
    """Return the greatest speed below ``limit`` that starts and ends at rest: v² changes by 2·a·ds at most."""
    energy = limit**2
    energy[0] = energy[-1] = 0.0
    gain = 2.0 * acceleration * at
    energy = gain + np.minimum.accumulate(energy - gain)
    energy = np.minimum.accumulate((energy + gain)[::-1])[::-1] - gain
    speed: Floats = np.sqrt(np.maximum(energy, 0.0))
    return speed


def _smooth_noise(rng: Rng, n: int, length: float) -> Floats:
    """Return n values of unit variance that change over ``length`` samples."""
    pad = int(4 * length)
    # The filter's weights square to 1/(2·√π·length), which is what the factor undoes.
    noise: Floats = gaussian_filter1d(rng.standard_normal(n + 2 * pad), length)[pad : pad + n]
    noise *= np.sqrt(2.0 * np.sqrt(np.pi) * length)
    return noise


def _step_times(t: Floats, cadence_hz: Floats, jitter: float, rng: Rng) -> Floats:
    """Return the times (k + 1,) that bound the whole number of steps a bout takes."""
    phase = np.concatenate([[0.0], np.cumsum(np.diff(t) * (cadence_hz[:-1] + cadence_hz[1:]) / 2.0)])
    steps = max(1, round(float(phase[-1])))
    times: Floats = np.interp(np.arange(steps + 1) * phase[-1] / steps, phase, t)
    if steps > 1:
        wobble = np.clip(jitter * rng.standard_normal(steps - 1), -0.2, 0.2)
        times[1:-1] += wobble * np.minimum(np.diff(times)[:-1], np.diff(times)[1:])
    return times


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Trajectory:
    """Where the person truly was, n instants at a fixed rate.

    Attributes:
        t_s: (n,) since the recording began, evenly spaced.
        distance_m: (n,) walked so far.
        xy: (n, 2) metres, floor frame.
        heading_rad: (n,) direction of walking, clockwise from +y, continuous (not wrapped).
        speed_mps: (n,).
        phase: (n,) steps walked so far, with fractions; a whole number while standing.
        swing_mps2: (n,) swing a_max − a_min of the current step, 0 while standing.
    """

    t_s: Floats
    distance_m: Floats
    xy: Floats
    heading_rad: Floats
    speed_mps: Floats
    phase: Floats
    swing_mps2: Floats

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("t_s", "distance_m", "xy", "heading_rad", "speed_mps", "phase", "swing_mps2"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def xy_at(self, t_s: Floats) -> Floats:
        """Return the places (…, 2) at times (…) in seconds."""
        return np.stack([np.interp(t_s, self.t_s, self.xy[:, i]) for i in range(2)], axis=-1)

    def heading_at(self, t_s: Floats) -> Floats:
        """Return the headings (…) at times (…) in seconds."""
        return np.interp(t_s, self.t_s, self.heading_rad)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrueSteps:
    """The true steps.

    Attributes:
        t_s: (k,) when each was completed.
        length_m: (k,) way covered by each.
        swing_mps2: (k,) a_max − a_min of the acceleration it causes.
    """

    t_s: Floats
    length_m: Floats
    swing_mps2: Floats

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("t_s", "length_m", "swing_mps2"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.t_s)


def walk_route(route: Route, walker: Walker, rng: Rng, rate_hz: float = 200.0) -> tuple[Trajectory, TrueSteps]:
    """Walk a route from its first to its last point.

    Args:
        route: the line that is walked exactly.
        walker: who walks.
        rng: draws changes of speed, pauses, and what differs from step to step.
        rate_hz: of the trajectory.
    """
    profile, phases = motion_profile(route.xy, walker, rng)
    ends = np.concatenate([bout[1:] for bout in phases])
    begins = np.concatenate([bout[:-1] for bout in phases])
    length = np.interp(ends, profile.t_s, profile.distance_m) - np.interp(begins, profile.t_s, profile.distance_m)
    # A step much shorter than usual still shakes the phone somewhat.
    swing = np.maximum((length / walker.weinberg_k) ** 4, 0.8)
    swing *= np.clip(1.0 + walker.swing_jitter * rng.standard_normal(len(swing)), 0.5, 1.5)
    steps = TrueSteps(t_s=ends, length_m=length, swing_mps2=swing)
    return _sample_trajectory(profile, phases, swing, rate_hz), steps


def _sample_trajectory(profile: MotionProfile, phases: tuple[Floats, ...], swing: Floats, rate_hz: float) -> Trajectory:
    t = np.arange(int(np.ceil(profile.t_s[-1] * rate_hz)) + 1) / rate_hz
    distance = np.interp(t, profile.t_s, profile.distance_m)
    phase_t, phase, envelope_t, envelope = [], [], [], []
    done = 0
    for bout in phases:
        n = len(bout) - 1
        phase_t.append(bout)
        phase.append(done + np.arange(n + 1, dtype=np.float64))
        # Full swing in the middle of each step, none before the first and after the last: no jump anywhere.
        envelope_t.append(np.concatenate([bout[:1], (bout[:-1] + bout[1:]) / 2.0, bout[-1:]]))
        envelope.append(np.concatenate([[0.0], swing[done : done + n], [0.0]]))
        done += n
    return Trajectory(
        t_s=t,
        distance_m=distance,
        xy=np.stack([np.interp(distance, profile.line_m, profile.line_xy[:, i]) for i in range(2)], axis=1),
        heading_rad=np.interp(t, profile.t_s, profile.heading_rad),
        speed_mps=np.interp(t, profile.t_s, profile.speed_mps),
        phase=np.interp(t, np.concatenate(phase_t), np.concatenate(phase)),
        swing_mps2=np.interp(t, np.concatenate(envelope_t), np.concatenate(envelope)),
    )


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
