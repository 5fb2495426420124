"""From a line to a course in time: legs between sharp corners, bouts between stops, speeds that turning allows."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from tickfix.api import Floats, Rng, wrap_rad
from tickfix.simulation.people import Walker

_STEP_M: Final = 0.02
"""Resolution of the line."""
_SMOOTH_M: Final = 0.16
"""Headings are averaged over this much of the line, since an arc comes as a polygon."""
_SHARP_RAD: Final = 0.3
"""A corner sharper than this is turned on the spot."""
_VARIATION_M: Final = 5.0
"""Over which the speed changes."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Course:
    """Knots of a walk, linear between them.

    Attributes:
        t_s, way_m, heading_rad, speed_mps: (n,) at each knot; the heading is continuous.
        line_m, line_xy: (m,), (m, 2): the line, by the way along it.
    """

    t_s: Floats
    way_m: Floats
    heading_rad: Floats
    speed_mps: Floats
    line_m: Floats
    line_xy: Floats


def walk_course(line: Floats, walker: Walker, rng: Rng) -> tuple[Course, tuple[Floats, ...]]:
    """Walk along a line (m, 2).

    Returns:
        The course, and for each bout of walking between two stops the times (k + 1,) that bound its k steps.
    """
    line_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    t, way, heading, speed = [0.0], [0.0], [_headings(line)[0]], [0.0]
    bouts: list[Floats] = []

    def stand(seconds: float, towards: float) -> None:
        """Stand, then face ``towards``, the shorter way round."""
        turn = wrap_rad(towards - heading[-1])
        for pause, angle in ((seconds, 0.0), (abs(turn) / walker.turn_rad_s, turn)):
            if pause > 0:
                t.append(t[-1] + pause)
                way.append(way[-1])
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
            v = _reachable(
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
            way += at[1:].tolist()
            heading += (theta[1:] + 2.0 * np.pi * turns).tolist()
            speed += v[1:].tolist()
    stand(walker.stand_s, heading[-1])
    course = Course(
        t_s=np.array(t),
        way_m=np.array(way),
        heading_rad=np.array(heading),
        speed_mps=np.array(speed),
        line_m=line_m,
        line_xy=line,
    )
    return course, tuple(bouts)


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


def _reachable(at: Floats, limit: Floats, acceleration: float) -> Floats:
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
