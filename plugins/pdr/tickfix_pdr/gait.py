"""Pdr ``gait``: every step is as long as every other, the comparison of [jiang2015] Table 4."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from tickfix.api import BasePdr, Context, Motion, MotionSamples, Preset, Rng, Survey, TrainedModel, parameter, wrap_rad
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
class GaitParams(StepErrorParams):
    """Parameters of ``gait``."""

    step_length_m: Annotated[
        float,
        parameter(
            "the default step length; not printed", unit="m", source="[jiang2015] section 5", gt=0, formerly="step_m"
        ),
    ] = 0.7
    low_pass_hz: Annotated[float, parameter("corner of the smoothing", unit="Hz", gt=0, trains=True)] = 2.0
    threshold: Annotated[
        float, parameter("least height of a peak of the acceleration", unit="m/s²", gt=0, trains=True)
    ] = 0.4
    min_step_interval_s: Annotated[
        float, parameter("least time between steps", unit="s", gt=0, trains=True, formerly="shortest_s")
    ] = 0.3
    length_sigma: Annotated[float, parameter("relative error of a single step's length", ge=0)] = 0.15
    scale_sigma: Annotated[float, parameter("relative error that stays for the walk", ge=0)] = 0.15
    heading_sigma_rad: Annotated[float, parameter("error of a single step's direction", unit="rad", ge=0)] = 0.13
    stationary_after_s: Annotated[
        float, parameter("without a step for so long, the phone stands", unit="s", gt=0, formerly="standing_s")
    ] = 2.0


@dataclass(frozen=True, slots=True)
class GaitPdrState:
    """Gait, heading, the time since the last step, and what was walked."""

    gait: StepDetectorState = field(default_factory=StepDetectorState)
    heading: HeadingState = field(default_factory=HeadingState)
    since_step_s: float = 0.0
    travelled_m: float = 0.0


class Gait(BasePdr[GaitParams]):
    """Steps counted times a default step length, in the direction where the phone points.

    What [jiang2015] compares its regression with: a person's steps differ from the default by a factor that stays for
    the walk (``scale_sigma``), and the survey does not calibrate it away. It does teach the drawing's north.
    """

    name = "gait"
    source = "[jiang2015] section 8.3.1, Table 4"
    Params = GaitParams
    State = GaitPdrState
    presets: ClassVar[Mapping[str, Preset]] = {
        "jiang2015": Preset("[jiang2015] Table 4; no value is printed, all are ours", {})
    }

    def __init__(self, params: GaitParams, context: Context, trained: TrainedModel | None = None) -> None:
        """Take the drawing's north from the survey."""
        super().__init__(params, context, trained)
        self._offset_rad = 0.0 if trained is None else float(trained["heading_offset_rad"])

    def start(self) -> GaitPdrState:
        """Return the state before any sample."""
        return GaitPdrState()

    def step(self, state: GaitPdrState, samples: MotionSamples) -> tuple[GaitPdrState, Motion]:
        """Fold a tick's samples into motion."""
        p = self.params
        dt = (samples.t1_ns - samples.t0_ns) * 1e-9
        heading, direction = update_heading(state.heading, samples)
        accelerometer = samples.sensors.get("accelerometer")
        gait, found = state.gait, list[DetectedStep]()
        if accelerometer is not None:
            gait, found = detect_steps(
                gait,
                accelerometer,
                low_pass_hz=p.low_pass_hz,
                threshold=p.threshold,
                min_step_interval_s=p.min_step_interval_s,
            )
        since_step_s = 0.0 if found else state.since_step_s + dt
        device_heading_rad = heading.heading_rad
        motion = motion_from_steps(
            samples,
            [p.step_length_m] * len(found),
            p,
            heading_rad=None if device_heading_rad is None else float(wrap_rad(device_heading_rad + self._offset_rad)),
            turn_rad=direction.turn_rad,
            stationary=since_step_s > p.stationary_after_s,
            travelled_before_m=state.travelled_m,
        )
        return GaitPdrState(gait, heading, since_step_s, motion.travelled_m), motion

    @staticmethod
    def train(params: GaitParams, survey: Survey, rng: Rng) -> TrainedModel:  # noqa: ARG004 - nothing is drawn
        """Learn the drawing's north, and nothing about the length of steps: the default is the method."""
        return {"heading_offset_rad": calibrate(Gait(params, Context()), survey)["heading_offset_rad"]}
