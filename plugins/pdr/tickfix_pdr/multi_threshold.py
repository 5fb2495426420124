"""Pdr ``multi-threshold``: the dead reckoning of [wang2015] sections 3.1 and 3.2, equations (3)–(8)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import numpy as np

from tickfix.api import (
    BasePdr,
    Context,
    Motion,
    MotionSamples,
    Preset,
    Rng,
    Samples,
    Survey,
    Trained,
    parameter,
    wrap_rad,
)
from tickfix_pdr.calibration import calibrate
from tickfix_pdr.extrema import SignalState, fold_signal
from tickfix_pdr.heading import azimuth_of, compass_heading, fold_gravity, fold_yaw
from tickfix_pdr.hybrid_heading import HybridWeights, hybrid_heading
from tickfix_pdr.multi_threshold_detector import Step, StepState, Thresholds, fold_extrema
from tickfix_pdr.walked import StepErrorParams, walked


@dataclass(frozen=True)
class MultiThresholdParams(StepErrorParams):
    """Parameters of ``multi-threshold``.

    δ(Δt_p) is printed; the other thresholds and the weights are "determined empirically" and not printed: ours come
    from the hand-held Oxford recordings (``benchmarks/steps.py``) and from simulated walks.
    """

    amplitude: Annotated[
        float,
        parameter("δ_ap = |δ_av|: least height of a peak", unit="m/s²", source="eqs. (3)–(6)", gt=0, trains=True),
    ] = 0.3
    between_s: Annotated[
        float, parameter("δ(Δt_p): least time between peaks", unit="s", source="section 3.1", gt=0, trains=True)
    ] = 0.2
    low_pass_hz: Annotated[
        float, parameter("corner of the smoothing; 0: the raw acceleration", unit="Hz", ge=0, trains=True)
    ] = 3.0
    standing_s: Annotated[
        float, parameter("without such a peak for so long, the person stands", unit="s", gt=0, trains=True)
    ] = 1.5
    length_factor: Annotated[float, parameter("K of the step length", source="eq. (7)", gt=0, trains=True)] = 0.46
    alpha: Annotated[float, parameter("α: weight of the heading before", source="eq. (8)", gt=0, trains=True)] = 2.0
    beta: Annotated[float, parameter("β: weight of the magnetometer", source="eq. (8)", gt=0, trains=True)] = 0.3
    gamma: Annotated[float, parameter("γ: weight of the gyroscope", source="eq. (8)", gt=0, trains=True)] = 2.0
    theta_c_rad: Annotated[
        float, parameter("θ_c: compass and gyroscope agree within", unit="rad", source="eq. (8)", gt=0, trains=True)
    ] = 0.35
    theta_m_rad: Annotated[
        float, parameter("θ_m: a steady compass changes less a step", unit="rad", source="eq. (8)", gt=0, trains=True)
    ] = 0.1
    keep_turns: Annotated[
        bool, parameter("carry what was turned since the step before into θ_(k−1)", source="eq. (8)", trains=True)
    ] = True


@dataclass(frozen=True, slots=True)
class MultiThresholdState:
    """What is carried from tick to tick.

    Attributes:
        signal, steps: of the detector.
        up: gravity's reaction in the device frame, smoothed, m/s²; zero before the first acceleration.
        gyroscope_ns: the last gyroscope sample's time, −1 before the first.
        heading_rad: θ_{k−1}, the fused heading of the last step; None before any compass.
        theta_m: θ_m,k−1, the compass at the last step.
        sin, cos: compass readings summed since the last step.
        theta_g: θ_g at the last step, the gyroscope's heading.
        turned_rad: by the gyroscope since the last step.
        still_s: since the last step.
        travelled_m: so far.
    """

    signal: SignalState = field(default_factory=SignalState)
    steps: StepState = field(default_factory=StepState)
    up: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyroscope_ns: int = -1
    heading_rad: float | None = None
    theta_m: float = 0.0
    theta_g: float = 0.0
    sin: float = 0.0
    cos: float = 0.0
    turned_rad: float = 0.0
    still_s: float = 0.0
    travelled_m: float = 0.0


class MultiThreshold(BasePdr[MultiThresholdParams]):
    """Steps by the multi-threshold rules, length by K·⁴√(acc_max − acc_min), hybrid heading of compass and gyroscope.

    A phone without magnetometer takes the compass out of its rotation vector, one without gyroscope has θ_g = θ_m, one
    without both has no heading and tells only its turns. The survey calibrates K and the drawing's north.
    """

    name = "multi-threshold"
    source = "[wang2015] eqs. (3)–(8)"
    Params = MultiThresholdParams
    State = MultiThresholdState
    presets: ClassVar[Mapping[str, Preset]] = {
        "wang2015": Preset(
            "[wang2015] sections 3.1–3.2: raw acceleration, δ(Δt_p) = 0.2 s, eq. (8) to the letter; "
            "δ_ap, K, α, β, γ, θ_c and θ_m are not printed and ours",
            {"low_pass_hz": 0.0, "between_s": 0.2, "amplitude": 1.0, "keep_turns": False, "beta": 1.0},
        )
    }

    def __init__(self, params: MultiThresholdParams, context: Context, trained: Trained | None = None) -> None:
        """Take what the survey taught."""
        super().__init__(params, context, trained)
        p = params
        self._offset_rad = 0.0 if trained is None else float(trained["heading_offset_rad"])
        self._k = p.length_factor * (1.0 if trained is None else float(trained["length_scale"]))
        self._thresholds = Thresholds(p.amplitude, p.between_s, p.standing_s)
        self._weights = HybridWeights(p.alpha, p.beta, p.gamma, p.theta_c_rad, p.theta_m_rad)

    def start(self) -> MultiThresholdState:
        """Return the state before any sample."""
        return MultiThresholdState()

    def step(self, state: MultiThresholdState, samples: MotionSamples) -> tuple[MultiThresholdState, Motion]:
        """Fold a tick's samples into motion."""
        p = self.params
        dt = (samples.t1_ns - samples.t0_ns) * 1e-9
        accelerometer = samples.sensors.get("accelerometer")
        signal, steps, found = state.signal, state.steps, tuple[Step, ...]()
        if accelerometer is not None:
            signal, extrema = fold_signal(signal, accelerometer, p.low_pass_hz)
            steps, found = fold_extrema(steps, extrema, self._thresholds)
        lengths = [self._k * (step.acc_max - step.acc_min) ** 0.25 for step in found]  # eq. (7)

        up = fold_gravity(state.up, accelerometer, dt)
        turned, gyroscope_ns = fold_yaw(state.gyroscope_ns, samples.sensors.get("gyroscope"), up)
        compass = _compass(samples, up)
        sin = state.sin + (0.0 if compass is None else math.sin(compass))
        cos = state.cos + (0.0 if compass is None else math.cos(compass))
        since_rad = float(wrap_rad(state.turned_rad + (turned or 0.0)))
        theta, theta_m, theta_g = state.heading_rad, state.theta_m, state.theta_g
        if theta is None:
            if compass is not None:
                theta, theta_m, theta_g, since_rad = compass, compass, compass, 0.0
        elif found:
            # θ_m,k is the mean since the step before: the phone sways with every step. Without it θ_m,k = θ_g,k.
            heard = math.hypot(sin, cos) > 0.0
            theta_m_k = math.atan2(sin, cos) if heard else theta + since_rad
            theta_g_k = theta_g + since_rad if gyroscope_ns >= 0 else theta_m_k
            before = theta + since_rad if p.keep_turns else theta
            theta = hybrid_heading(before, theta_m_k, theta_m, theta_g_k, self._weights)  # eq. (8)
            theta_m, since_rad = theta_m_k, 0.0
            theta_g = theta if p.keep_turns else float(wrap_rad(theta_g_k))
        heading_rad = None if theta is None else float(wrap_rad(theta + since_rad + self._offset_rad))
        if found:
            sin = cos = 0.0
        still_s = 0.0 if found else state.still_s + dt
        motion = walked(
            samples,
            lengths,
            p,
            heading_rad=heading_rad,
            turn_rad=turned or 0.0,
            stands=still_s > p.standing_s,
            before_m=state.travelled_m,
        )
        return MultiThresholdState(
            signal, steps, up, gyroscope_ns, theta, theta_m, theta_g, sin, cos, since_rad, still_s, motion.travelled_m
        ), motion

    @staticmethod
    def train(params: MultiThresholdParams, survey: Survey, rng: Rng) -> Trained:  # noqa: ARG004 - nothing is drawn
        """Calibrate K and the drawing's north on the survey's walks, see :mod:`tickfix_pdr.calibration`."""
        return calibrate(MultiThreshold(params, Context()), survey)


def _compass(samples: MotionSamples, up: tuple[float, float, float]) -> float | None:
    """Return where the phone points in this tick by its magnetometer, else by its rotation vector, else None."""
    magnetometer: Samples | None = samples.sensors.get("magnetometer")
    if magnetometer is not None and any(up):
        return compass_heading(magnetometer.values.mean(axis=0), np.array(up))
    rotation = samples.sensors.get("rotation_vector")
    if rotation is None:
        return None
    azimuths = azimuth_of(rotation.values)
    return math.atan2(float(np.sin(azimuths).sum()), float(np.cos(azimuths).sum()))
