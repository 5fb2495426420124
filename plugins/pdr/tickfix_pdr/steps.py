"""Pdr ``steps``: steps from the accelerometer, their length from how hard they are, their direction from the phone."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from tickfix.api import (
    TICK_NS,
    BasePdr,
    Context,
    Motion,
    MotionSamples,
    Rng,
    Samples,
    Survey,
    SurveyWalk,
    Trained,
    parameter,
    wrap_rad,
)
from tickfix_pdr.heading import HeadingState, fold_heading
from tickfix_pdr.step_detector import GaitState, Step, detect_steps


@dataclass(frozen=True)
class StepsParams:
    """Parameters of ``steps``."""

    low_pass_hz: Annotated[float, parameter("corner of the smoothing", unit="Hz", gt=0, trains=True)] = 2.0
    threshold: Annotated[
        float, parameter("least height of a peak of the acceleration", unit="m/s²", gt=0, trains=True)
    ] = 0.4
    shortest_s: Annotated[float, parameter("least time between steps", unit="s", gt=0, trains=True)] = 0.3
    length_factor: Annotated[
        float,
        parameter("K in step length = K·⁴√(fall of the acceleration)", source="[weinberg2002]", gt=0, trains=True),
    ] = 0.47
    length_sigma: Annotated[float, parameter("relative error of a single step's length", ge=0)] = 0.1
    scale_sigma: Annotated[float, parameter("relative error that stays for the walk", ge=0)] = 0.12
    heading_sigma_rad: Annotated[float, parameter("error of a single step's direction", unit="rad", ge=0)] = 0.09
    heading_bias_sigma_rad: Annotated[float, parameter("error that stays for the walk", unit="rad", ge=0)] = 0.26
    bias_walk_rad: Annotated[float, parameter("by which that error changes with a step", unit="rad", ge=0)] = 0.05
    standing_s: Annotated[float, parameter("without a step for so long, the phone stands", unit="s", gt=0)] = 2.0


@dataclass(frozen=True, slots=True)
class StepsState:
    """Gait, heading, the direction summed since the last step, and what was walked."""

    gait: GaitState = field(default_factory=GaitState)
    heading: HeadingState = field(default_factory=HeadingState)
    sin: float = 0.0
    cos: float = 0.0
    since_step_s: float = 0.0
    travelled_m: float = 0.0


class Steps(BasePdr[StepsParams]):
    """Steps by peak and valley, length after Weinberg, direction where the phone points.

    The survey teaches two things that a building or its drawing bring: by how much the drawing's +y is off the north
    that phones show, and how long steps are here.
    """

    name = "steps"
    source = "[weinberg2002]; heading as in [jiang2015] eq. (13)"
    Params = StepsParams
    State = StepsState

    def __init__(self, params: StepsParams, context: Context, trained: Trained | None = None) -> None:
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
        heading, direction = fold_heading(state.heading, samples)
        sin, cos = state.sin + direction.sin, state.cos + direction.cos
        accelerometer = samples.sensors.get("accelerometer")
        gait, found = state.gait, list[Step]()
        if accelerometer is not None:
            gait, found = detect_steps(
                state.gait,
                accelerometer,
                low_pass_hz=p.low_pass_hz,
                threshold=p.threshold,
                shortest_s=p.shortest_s,
            )
        lengths = [self._length_factor * step.amplitude**0.25 for step in found]
        distance_m = sum(lengths)
        since_step_s = 0.0 if found else state.since_step_s + dt
        heading_rad = None
        if direction.known:
            # A step's direction is the mean since the step before it: the phone sways with every step.
            pointing = math.atan2(sin, cos) if found or heading.heading_rad is None else heading.heading_rad
            heading_rad = float(wrap_rad(pointing + self._offset_rad))
        motion = Motion(
            t0_ns=samples.t0_ns,
            t1_ns=samples.t1_ns,
            distance_m=distance_m,
            heading_rad=heading_rad,
            turn_rad=direction.turn_rad,
            distance_sigma_m=p.length_sigma * math.hypot(*lengths) if accelerometer is not None else dt,
            distance_scale_sigma=p.scale_sigma,
            heading_sigma_rad=p.heading_sigma_rad,
            heading_bias_sigma_rad=p.heading_bias_sigma_rad,
            turn_sigma_rad=p.heading_sigma_rad,
            turn_bias_sigma_rad=p.bias_walk_rad * math.sqrt(len(found)),
            steps=len(found),
            stationary=accelerometer is not None and since_step_s > p.standing_s,
            travelled_m=state.travelled_m + distance_m,
        )
        if found:
            sin = cos = 0.0
        return StepsState(gait, heading, sin, cos, since_step_s, motion.travelled_m), motion

    @staticmethod
    def train(params: StepsParams, survey: Survey, rng: Rng) -> Trained:  # noqa: ARG004 - nothing is drawn
        """Learn the drawing's north and the length of steps from the survey's walks.

        Each walk's waypoints, seen from its first, are compared with where the steps lead, as complex numbers: the
        factor that fits best has the angle between the norths; the walk's length gives the scale.
        """
        untrained = Steps(params, Context(), None)
        factors, scales = [], []
        for walk in survey.walks:
            reckoned, walked_m = _reckon(untrained, walk)
            true = np.array([complex(*truth.xy) for truth in walk.truth])
            length_m = float(np.abs(np.diff(true)).sum())
            if length_m < 10.0 or walked_m < 5.0:
                continue
            true, reckoned = true - true[0], reckoned - reckoned[0]
            factors.append(np.vdot(reckoned, true) / max(np.vdot(reckoned, reckoned).real, 1.0) * length_m)
            scales.append(length_m / walked_m)
        # A heading θ is the direction sin θ + i·cos θ; turning it clockwise multiplies by exp(−iφ).
        offset_rad = -float(np.angle(sum(factors))) if factors else 0.0
        scale = float(np.median(scales)) if scales else 1.0
        return {"heading_offset_rad": np.array(offset_rad), "length_scale": np.array(scale)}


def _reckon(pdr: Steps, walk: SurveyWalk) -> tuple[np.ndarray[tuple[int], np.dtype[np.complex128]], float]:
    """Return where the steps lead by each waypoint, x + iy (n,), and how far from the first to the last."""
    state = pdr.start()
    first, last = walk.motion.t0_ns // TICK_NS, -(-walk.motion.t1_ns // TICK_NS)
    place, places, travelled = 0j, [], []
    for tick in range(first, last + 1):
        state, motion = pdr.step(state, _within(walk.motion, (tick - 1) * TICK_NS, tick * TICK_NS))
        heading = 0.0 if motion.heading_rad is None else motion.heading_rad
        place += motion.distance_m * complex(math.sin(heading), math.cos(heading))
        places.append(place)
        travelled.append(motion.travelled_m)
    ticks = np.clip([-(-truth.t_ns // TICK_NS) - first for truth in walk.truth], 0, len(places) - 1)
    return np.array(places)[ticks], travelled[ticks[-1]] - travelled[ticks[0]]


def _within(motion: MotionSamples, t0_ns: int, t1_ns: int) -> MotionSamples:
    sensors = {}
    for name, samples in motion.sensors.items():
        a, b = np.searchsorted(samples.t_ns, [t0_ns, t1_ns], side="right")
        if b > a:
            sensors[name] = Samples(samples.t_ns[a:b], samples.values[a:b])
    return MotionSamples(sensors=sensors, t0_ns=t0_ns, t1_ns=t1_ns)
