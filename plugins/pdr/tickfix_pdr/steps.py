"""Pdr ``steps``: steps from the accelerometer, their length from how hard they are, their direction from the phone."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

from tickfix.api import BasePdr, Context, Motion, MotionSamples, Rng, Survey, TrainedModel, parameter, wrap_rad
from tickfix.toolkit.calibration import calibrate
from tickfix.toolkit.heading import HeadingState, update_heading
from tickfix.toolkit.step_signal import (
    DetectedStep,
    StepDetectorState,
    StepErrorParams,
    detect_steps,
    motion_from_steps,
)


@dataclass(frozen=True)
class StepsParams(StepErrorParams):
    """Parameters of ``steps``."""

    low_pass_hz: Annotated[float, parameter("corner of the smoothing", unit="Hz", gt=0, trains=True)] = 2.0
    threshold: Annotated[
        float, parameter("least height of a peak of the acceleration", unit="m/s²", gt=0, trains=True)
    ] = 0.4
    min_step_interval_s: Annotated[
        float, parameter("least time between steps", unit="s", gt=0, trains=True, formerly="shortest_s")
    ] = 0.3
    length_factor: Annotated[
        float,
        parameter("K in step length = K·⁴√(fall of the acceleration)", source="[weinberg2002]", gt=0, trains=True),
    ] = 0.47
    heading_sigma_rad: Annotated[float, parameter("error of a single step's direction", unit="rad", ge=0)] = 0.09
    heading_bias_sigma_rad: Annotated[float, parameter("error that stays for the walk", unit="rad", ge=0)] = 0.2
    gyroscope_time_constant_s: Annotated[
        float,
        parameter(
            "time constant with which a gyroscope's turns are pulled to the rotation vector; 0: that one alone",
            unit="s",
            ge=0,
            trains=True,
            formerly="gyroscope_s",
        ),
    ] = 40.0
    gyroscope_bias_random_walk_rad: Annotated[
        float,
        parameter(
            "by which the error of the heading changes with a step where a gyroscope carries it",
            unit="rad",
            ge=0,
            formerly="gyroscope_walk_rad",
        ),
    ] = 0.02
    stationary_after_s: Annotated[
        float, parameter("without a step for so long, the phone stands", unit="s", gt=0, formerly="standing_s")
    ] = 2.0


@dataclass(frozen=True, slots=True)
class StepsState:
    """Gait, heading, the direction summed since the last step, and what was walked."""

    gait: StepDetectorState = field(default_factory=StepDetectorState)
    heading: HeadingState = field(default_factory=HeadingState)
    sin: float = 0.0
    cos: float = 0.0
    since_step_s: float = 0.0
    travelled_m: float = 0.0


class StepsPdr(BasePdr[StepsParams]):
    """Steps by peak and valley, length after Weinberg, direction where the phone points.

    Steel bends the field from corridor to corridor, and the rotation vector with it, while a gyroscope keeps its
    direction for a minute. So the rotation vector gives the long-term mean of the heading, the gyroscope its changes.

    The survey teaches two things that a building or its drawing bring: by how much the drawing's +y is off the north
    that phones show, and how long steps are here.
    """

    name = "steps"
    source = "[weinberg2002]; heading as in [jiang2015] eq. (13)"
    Params = StepsParams
    State = StepsState

    def __init__(self, params: StepsParams, context: Context, trained: TrainedModel | None = None) -> None:
        """Take what the survey taught."""
        super().__init__(params, context, trained)
        self._offset_rad = 0.0 if trained is None else float(trained["heading_offset_rad"])
        self._length_factor = params.length_factor * (1.0 if trained is None else float(trained["length_scale"]))

    def start(self) -> StepsState:
        """Return the state before any sample."""
        return StepsState()

    def step(self, state: StepsState, samples: MotionSamples) -> tuple[StepsState, Motion]:
        """Fold a tick's samples into motion."""
        p = self.params
        dt = (samples.t1_ns - samples.t0_ns) * 1e-9
        heading, direction = update_heading(
            state.heading, samples, gyroscope_time_constant_s=p.gyroscope_time_constant_s
        )
        sin, cos = state.sin + direction.sin, state.cos + direction.cos
        accelerometer = samples.sensors.get("accelerometer")
        gait, found = state.gait, list[DetectedStep]()
        if accelerometer is not None:
            gait, found = detect_steps(
                state.gait,
                accelerometer,
                low_pass_hz=p.low_pass_hz,
                threshold=p.threshold,
                min_step_interval_s=p.min_step_interval_s,
            )
        lengths = [self._length_factor * step.amplitude**0.25 for step in found]
        since_step_s = 0.0 if found else state.since_step_s + dt
        heading_rad = None
        if direction.known:
            # A step's direction is the mean since the step before it: the phone sways with every step.
            pointing = math.atan2(sin, cos) if found or heading.heading_rad is None else heading.heading_rad
            heading_rad = float(wrap_rad(pointing + self._offset_rad))
        motion = motion_from_steps(
            samples,
            lengths,
            p,
            heading_rad=heading_rad,
            turn_rad=direction.turn_rad,
            stationary=since_step_s > p.stationary_after_s,
            travelled_before_m=state.travelled_m,
            heading_bias_random_walk_rad=p.gyroscope_bias_random_walk_rad
            if p.gyroscope_time_constant_s and "gyroscope" in samples.sensors
            else p.heading_bias_random_walk_rad,
        )
        if found:
            sin = cos = 0.0
        return StepsState(gait, heading, sin, cos, since_step_s, motion.travelled_m), motion

    @staticmethod
    def train(params: StepsParams, survey: Survey, rng: Rng) -> TrainedModel:  # noqa: ARG004 - nothing is drawn
        """Learn the drawing's north and the length of steps from the survey, see :mod:`tickfix.toolkit.calibration`."""
        return calibrate(StepsPdr(params, Context()), survey)
