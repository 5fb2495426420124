"""From the steps of a tick to its motion, and how sure of it a dead reckoning by steps is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from tickfix.api import Motion, MotionSamples, parameter


@dataclass(frozen=True)
class StepErrorParams:
    """By how much steps are wrong: what every dead reckoning that counts them says of itself."""

    length_sigma: Annotated[float, parameter("relative error of a single step's length", ge=0)] = 0.1
    scale_sigma: Annotated[float, parameter("relative error that stays for the walk", ge=0)] = 0.12
    heading_sigma_rad: Annotated[float, parameter("error of a single step's direction", unit="rad", ge=0)] = 0.1
    heading_bias_sigma_rad: Annotated[float, parameter("error that stays for the walk", unit="rad", ge=0)] = 0.26
    bias_walk_rad: Annotated[float, parameter("by which that error changes with a step", unit="rad", ge=0)] = 0.05


def walked(
    samples: MotionSamples,
    lengths_m: Sequence[float],
    params: StepErrorParams,
    *,
    heading_rad: float | None,
    turn_rad: float,
    stands: bool,
    before_m: float,
    bias_walk_rad: float | None = None,
) -> Motion:
    """Return a tick's motion.

    Args:
        samples: of the tick; without an accelerometer nobody knows whether steps were made, up to a metre a second.
        lengths_m: of the steps completed in it.
        params: errors of a step.
        heading_rad: direction of walking at the end of the tick, None without compass.
        turn_rad: since the last tick.
        stands: no step was made for so long that the person stands; only believed with an accelerometer.
        before_m: travelled before the tick.
        bias_walk_rad: by which the heading's bias changes with a step, where the sensors at hand tell better than
            ``params``.
    """
    felt = "accelerometer" in samples.sensors
    distance_m = sum(lengths_m)
    walk_rad = params.bias_walk_rad if bias_walk_rad is None else bias_walk_rad
    return Motion(
        t0_ns=samples.t0_ns,
        t1_ns=samples.t1_ns,
        distance_m=distance_m,
        heading_rad=heading_rad,
        turn_rad=turn_rad,
        distance_sigma_m=params.length_sigma * math.hypot(*lengths_m)
        if felt
        else (samples.t1_ns - samples.t0_ns) * 1e-9,
        distance_scale_sigma=params.scale_sigma,
        heading_sigma_rad=params.heading_sigma_rad,
        heading_bias_sigma_rad=params.heading_bias_sigma_rad,
        turn_sigma_rad=params.heading_sigma_rad,
        turn_bias_sigma_rad=walk_rad * math.sqrt(len(lengths_m)),
        steps=len(lengths_m),
        stationary=felt and stands,
        travelled_m=before_m + distance_m,
    )
