"""What a survey teaches any dead reckoning: the drawing's north, and how long steps are here.

A building's drawing is turned against the north that phones show, and people's steps differ from the default. Each
walk's waypoints, seen from its first, are compared with where the steps lead, as complex numbers: the factor that fits
best has the angle between the norths; the walk's length gives the scale.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tickfix.api import TICK_NS, MotionSamples, Pdr, Samples, Survey, SurveyWalk, TrainedModel

_MIN_WALK_M = 10.0
_MIN_RECKONED_M = 5.0


def calibrate(untrained: Pdr, survey: Survey) -> TrainedModel:
    """Return ``heading_offset_rad`` to add to headings and ``length_scale`` to multiply distances by, both scalars."""
    factors, scales = [], []
    for walk in survey.walks:
        reckoned, walked_m = _dead_reckon(untrained, walk)
        true = np.array([complex(*truth.xy) for truth in walk.truth])
        length_m = float(np.abs(np.diff(true)).sum())
        if length_m < _MIN_WALK_M or walked_m < _MIN_RECKONED_M:
            continue
        true, reckoned = true - true[0], reckoned - reckoned[0]
        factors.append(np.vdot(reckoned, true) / max(np.vdot(reckoned, reckoned).real, 1.0) * length_m)
        scales.append(length_m / walked_m)
    # A heading θ is the direction sin θ + i·cos θ; turning it clockwise multiplies by exp(−iφ).
    offset_rad = -float(np.angle(sum(factors))) if factors else 0.0
    scale = float(np.median(scales)) if scales else 1.0
    return {"heading_offset_rad": np.array(offset_rad), "length_scale": np.array(scale)}


def samples_between(motion: MotionSamples, t0_ns: int, t1_ns: int) -> MotionSamples:
    """Return the samples of (``t0_ns``, ``t1_ns``], as a tick delivers them: sensors without samples are absent."""
    sensors = {}
    for name, samples in motion.sensors.items():
        a, b = np.searchsorted(samples.t_ns, [t0_ns, t1_ns], side="right")
        if b > a:
            sensors[name] = Samples(samples.t_ns[a:b], samples.values[a:b])
    return MotionSamples(sensors=sensors, t0_ns=t0_ns, t1_ns=t1_ns)


def _dead_reckon(pdr: Pdr, walk: SurveyWalk) -> tuple[NDArray[Any], float]:
    """Return where the steps lead by each waypoint, x + iy (n,), and how far from the first to the last."""
    state = pdr.start()
    first, last = walk.motion.t0_ns // TICK_NS, -(-walk.motion.t1_ns // TICK_NS)
    place, places, travelled = 0j, [], []
    for tick in range(first, last + 1):
        state, motion = pdr.step(state, samples_between(walk.motion, (tick - 1) * TICK_NS, tick * TICK_NS))
        heading = 0.0 if motion.heading_rad is None else motion.heading_rad
        place += motion.distance_m * complex(math.sin(heading), math.cos(heading))
        places.append(place)
        travelled.append(motion.travelled_m)
    ticks = np.clip([-(-truth.t_ns // TICK_NS) - first for truth in walk.truth], 0, len(places) - 1)
    return np.array(places)[ticks], travelled[ticks[-1]] - travelled[ticks[0]]
