"""Steps from the accelerometer, causally and sample by sample.

The smoothed magnitude, its extrema, a step detector with hysteresis, and the motion and errors of the steps of a tick.
The magnitude |a| does not depend on how the phone is held; its slow mean (gravity) is subtracted and two poles smooth
it. Step amplitude after [weinberg2002] Weinberg, "Using the ADXL202 in pedometer and personal navigation applications",
Analog Devices AN-602.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final

from tickfix.api import Motion, MotionSamples, Samples, parameter

_STANDARD_GRAVITY: Final = 9.81
_GRAVITY_TIME_CONSTANT_S: Final = 2.0
_FIRST_DT_S: Final = 0.02
_MIN_DT_S: Final = 1e-3
_MAX_DT_S: Final = 0.2


@dataclass(frozen=True, slots=True)
class StepSignalState:
    """Where the signal is.

    Attributes:
        t_ns: the last sample's time, −1 before the first.
        gravity, low_1, low_2: the slow mean and the two poles, m/s².
        rising: which way it went last; a signal that begins has come from nowhere and counts as falling.
    """

    t_ns: int = -1
    gravity: float = _STANDARD_GRAVITY
    low_1: float = 0.0
    low_2: float = 0.0
    rising: bool = False


@dataclass(frozen=True, slots=True)
class Extremum:
    """A local extremum: when, how far above (below: negative) the slow mean in m/s², and which kind."""

    t_ns: int
    a: float
    peak: bool


def detect_extrema(
    state: StepSignalState, accelerometer: Samples, low_pass_hz: float
) -> tuple[StepSignalState, list[Extremum]]:
    """Fold samples into the signal; return the new state and the extrema passed.

    Args:
        state: before the samples.
        accelerometer: (n, 3) m/s².
        low_pass_hz: corner of each of the two poles; 0 leaves the signal raw.
    """
    t_ns, gravity, low_1, low_2, rising = state.t_ns, state.gravity, state.low_1, state.low_2, state.rising
    extrema: list[Extremum] = []
    lengths = ((accelerometer.values**2).sum(axis=1) ** 0.5).tolist()
    for now_ns, length in zip(accelerometer.t_ns.tolist(), lengths, strict=True):
        dt = _FIRST_DT_S if t_ns < 0 else min(max((now_ns - t_ns) * 1e-9, _MIN_DT_S), _MAX_DT_S)
        gravity += (length - gravity) * dt / (_GRAVITY_TIME_CONSTANT_S + dt)
        gain = 1.0 if low_pass_hz == 0.0 else 1.0 - math.exp(-2.0 * math.pi * low_pass_hz * dt)
        low_1 += gain * (length - gravity - low_1)
        before = low_2
        low_2 += gain * (low_1 - low_2)
        if low_2 != before and (low_2 > before) != rising:
            if t_ns >= 0:
                extrema.append(Extremum(t_ns, before, rising))
            rising = not rising
        t_ns = now_ns
    return StepSignalState(t_ns, gravity, low_1, low_2, rising), extrema


@dataclass(frozen=True, slots=True)
class StepDetectorState:
    """Where in a step the signal is.

    Attributes:
        t_ns: the last sample's time, −1 before the first.
        gravity, low_1, low_2: the slow mean and the two poles, m/s².
        falling: a peak was passed and its valley is awaited.
        peak, peak_ns, valley: extremes of the step under way, m/s².
        last_peak_ns: peak of the last step, −1 before the first.
    """

    t_ns: int = -1
    gravity: float = _STANDARD_GRAVITY
    low_1: float = 0.0
    low_2: float = 0.0
    falling: bool = False
    peak: float = -math.inf
    peak_ns: int = -1
    valley: float = math.inf
    last_peak_ns: int = -1


@dataclass(frozen=True, slots=True)
class DetectedStep:
    """A step: when its peak was, and how far the signal fell from there, m/s²."""

    peak_ns: int
    amplitude: float


def detect_steps(
    state: StepDetectorState,
    accelerometer: Samples,
    *,
    low_pass_hz: float,
    threshold: float,
    min_step_interval_s: float,
) -> tuple[StepDetectorState, list[DetectedStep]]:
    """Fold samples into the gait; return the new state and the steps completed.

    Args:
        state: before the samples.
        accelerometer: (n, 3) m/s².
        low_pass_hz: corner of each of the two poles.
        threshold: a peak stands out by at least this, m/s²; a step falls by more than twice as much.
        min_step_interval_s: peaks closer than this belong to one step.
    """
    t_ns, gravity, low_1, low_2 = state.t_ns, state.gravity, state.low_1, state.low_2
    falling, peak, peak_ns, valley, last_ns = (
        state.falling,
        state.peak,
        state.peak_ns,
        state.valley,
        state.last_peak_ns,
    )
    steps: list[DetectedStep] = []
    lengths = ((accelerometer.values**2).sum(axis=1) ** 0.5).tolist()
    for now_ns, length in zip(accelerometer.t_ns.tolist(), lengths, strict=True):
        dt = _FIRST_DT_S if t_ns < 0 else min(max((now_ns - t_ns) * 1e-9, _MIN_DT_S), _MAX_DT_S)
        t_ns = now_ns
        gravity += (length - gravity) * dt / (_GRAVITY_TIME_CONSTANT_S + dt)
        gain = 1.0 - math.exp(-2.0 * math.pi * low_pass_hz * dt)
        low_1 += gain * (length - gravity - low_1)
        low_2 += gain * (low_1 - low_2)
        if not falling:
            if low_2 > peak:
                peak, peak_ns = low_2, now_ns
            elif low_2 < peak - threshold:
                if peak > threshold and (last_ns < 0 or (peak_ns - last_ns) * 1e-9 >= min_step_interval_s):
                    falling, valley = True, low_2
                else:
                    peak, peak_ns = low_2, now_ns  # too small or too soon: follow the signal down
        elif low_2 < valley:
            valley = low_2
        elif low_2 > valley + threshold or low_2 > 0.0:
            if peak - valley > 2.0 * threshold:
                steps.append(DetectedStep(peak_ns, peak - valley))
                last_ns = peak_ns
            falling, peak, peak_ns = False, low_2, now_ns
    return StepDetectorState(t_ns, gravity, low_1, low_2, falling, peak, peak_ns, valley, last_ns), steps


@dataclass(frozen=True)
class StepErrorParams:
    """Errors of steps, shared by all dead reckoning that counts steps."""

    length_sigma: Annotated[float, parameter("relative error of a single step's length", ge=0)] = 0.1
    scale_sigma: Annotated[float, parameter("relative error that stays for the walk", ge=0)] = 0.12
    heading_sigma_rad: Annotated[float, parameter("error of a single step's direction", unit="rad", ge=0)] = 0.1
    heading_bias_sigma_rad: Annotated[float, parameter("error that stays for the walk", unit="rad", ge=0)] = 0.26
    heading_bias_random_walk_rad: Annotated[
        float, parameter("by which that error changes with a step", unit="rad", ge=0, formerly="bias_walk_rad")
    ] = 0.05


def motion_from_steps(
    samples: MotionSamples,
    lengths_m: Sequence[float],
    params: StepErrorParams,
    *,
    heading_rad: float | None,
    turn_rad: float,
    stationary: bool,
    travelled_before_m: float,
    heading_bias_random_walk_rad: float | None = None,
) -> Motion:
    """Return a tick's motion.

    Args:
        samples: of the tick; without an accelerometer the distance is uncertain by a metre a second.
        lengths_m: of the steps completed in it.
        params: errors of a step.
        heading_rad: direction of walking at the end of the tick, None without compass.
        turn_rad: since the last tick.
        stationary: no step for so long that the person stands; ignored without an accelerometer.
        travelled_before_m: travelled before the tick.
        heading_bias_random_walk_rad: change of the heading's bias per step, if the sensors present allow a better value
            than ``params``.
    """
    measured = "accelerometer" in samples.sensors
    distance_m = sum(lengths_m)
    walk_rad = (
        params.heading_bias_random_walk_rad if heading_bias_random_walk_rad is None else heading_bias_random_walk_rad
    )
    return Motion(
        t0_ns=samples.t0_ns,
        t1_ns=samples.t1_ns,
        distance_m=distance_m,
        heading_rad=heading_rad,
        turn_rad=turn_rad,
        distance_sigma_m=params.length_sigma * math.hypot(*lengths_m)
        if measured
        else (samples.t1_ns - samples.t0_ns) * 1e-9,
        distance_scale_sigma=params.scale_sigma,
        heading_sigma_rad=params.heading_sigma_rad,
        heading_bias_sigma_rad=params.heading_bias_sigma_rad,
        turn_sigma_rad=params.heading_sigma_rad,
        turn_bias_sigma_rad=walk_rad * math.sqrt(len(lengths_m)),
        steps=len(lengths_m),
        stationary=measured and stationary,
        travelled_m=travelled_before_m + distance_m,
    )
