"""Pdr ``multi-threshold``.

The dead reckoning of [wang2015] sections 3.1 and 3.2, equations (3)-(8). Eqs. (3)-(6) are garbled in print and read as
follows, with Δt_p the time between consecutive peaks, Δt_pv from the valley before to a peak, δ(Δt_pv) = ½·δ(Δt_p), and
valleys mirroring peaks by magnitude. Eq. (3): a peak that makes one more than there are valleys is true if a_p ≥ δ_ap,
Δt_p ≥ δ(Δt_p) and Δt_pv ≥ δ(Δt_pv). Eq. (4): a second peak in a row replaces the first if Δa_p ≥ 0 besides. Eqs.
(5)-(6): the same for valleys. A step is a true peak followed by a true valley, reported at that valley; a deeper valley
that replaces it moves the times that later extrema are measured from, not the step. Hybrid heading, the first of two
equations numbered (8): θ_m is the magnetometer's, θ_g the gyroscope's, θ_{k-1} the fused heading of the step before;
θ_Δc = |θ_m,k - θ_g,k|, θ_Δm = |θ_m,k - θ_m,k-1|. Weights of a branch are normalised and the mean is taken on the
circle. What θ_g is counted from is not printed: the preset ``wang2015`` counts from the first compass reading, so
gyroscope drift is compared with the compass for ever and turns in the third branch are lost; by default
(``keep_turns``) θ_g,k is θ_{k-1} plus the turn since, and the θ_{k-1} that α weighs is rotated by that turn too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
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
    TrainedModel,
    parameter,
    wrap_rad,
)
from tickfix.toolkit.calibration import calibrate
from tickfix.toolkit.heading import azimuth_from_quaternions, compass_heading, integrate_yaw, update_gravity
from tickfix.toolkit.step_signal import Extremum, StepErrorParams, StepSignalState, detect_extrema, motion_from_steps


@dataclass(frozen=True, slots=True)
class StepThresholds:
    """What extrema are held against.

    Attributes:
        amplitude: δ_ap = |δ_av|, m/s² above or below the slow mean.
        min_peak_interval_s: δ(Δt_p) = δ(Δt_v); between a peak and its valley half of it.
        stationary_after_s: so long without an extremum of that amplitude, the person stands.
    """

    amplitude: float
    min_peak_interval_s: float
    stationary_after_s: float


@dataclass(frozen=True, slots=True)
class ExtremaState:
    """The true extrema so far.

    Attributes:
        surplus: Num_pk − Num_vy: 1 when a true peak awaits its valley.
        peak_ns, valley_ns: the last true ones, −1 before the first.
        a_p, a_v: their values, m/s².
        active_ns: the last extremum with the amplitude of walking, −1 before the first.
    """

    surplus: int = 0
    peak_ns: int = -1
    valley_ns: int = -1
    a_p: float = 0.0
    a_v: float = 0.0
    active_ns: int = -1


@dataclass(frozen=True, slots=True)
class MultiThresholdStep:
    """A step: when its valley was, and acc_max and acc_min of eq. (7), m/s²."""

    t_ns: int
    acc_max: float
    acc_min: float


def detect_steps_from_extrema(
    state: ExtremaState, extrema: Iterable[Extremum], thresholds: StepThresholds
) -> tuple[ExtremaState, tuple[MultiThresholdStep, ...]]:
    """Fold extrema in their order; return the new state and the steps completed."""
    steps: list[MultiThresholdStep] = []
    for extremum in extrema:
        if abs(extremum.a) < thresholds.amplitude:
            continue  # a_p < δ_ap, a_v < δ_av: a false one by any of the four equations
        if state.active_ns >= 0 and _at_least_apart(state.active_ns, extremum.t_ns, thresholds.stationary_after_s):
            state = ExtremaState()  # stood: what was before belongs to no step
        state = replace(state, active_ns=extremum.t_ns)
        if extremum.peak and extremum.a > 0.0:
            state = _with_peak(state, extremum, thresholds)
        elif not extremum.peak and extremum.a < 0.0:
            surplus = state.surplus
            state = _with_valley(state, extremum, thresholds)
            if state.surplus < surplus:
                steps.append(MultiThresholdStep(extremum.t_ns, state.a_p, state.a_v))
    return state, tuple(steps)


def _with_peak(state: ExtremaState, peak: Extremum, d: StepThresholds) -> ExtremaState:
    true = _at_least_apart(state.peak_ns, peak.t_ns, d.min_peak_interval_s)  # Δt_p ≥ δ(Δt_p)
    true = true and _at_least_apart(state.valley_ns, peak.t_ns, d.min_peak_interval_s / 2.0)  # Δt_pv ≥ δ(Δt_pv)
    if state.surplus == 1:
        true = true and peak.a >= state.a_p  # eq. (4), otherwise eq. (3)
    return replace(state, surplus=1, peak_ns=peak.t_ns, a_p=peak.a) if true else state


def _with_valley(state: ExtremaState, valley: Extremum, d: StepThresholds) -> ExtremaState:
    true = state.peak_ns >= 0  # a valley before the first peak ends no step
    true = true and _at_least_apart(state.valley_ns, valley.t_ns, d.min_peak_interval_s)  # Δt_v ≥ δ(Δt_v)
    true = true and _at_least_apart(state.peak_ns, valley.t_ns, d.min_peak_interval_s / 2.0)  # Δt_vp ≥ δ(Δt_vp)
    if state.surplus == 0:
        true = true and -valley.a >= -state.a_v  # eq. (6), otherwise eq. (5)
    return replace(state, surplus=0, valley_ns=valley.t_ns, a_v=valley.a) if true else state


def _at_least_apart(before_ns: int, now_ns: int, least_s: float) -> bool:
    return before_ns < 0 or (now_ns - before_ns) * 1e-9 >= least_s


@dataclass(frozen=True, slots=True)
class HybridWeights:
    """α, β, γ: of the heading before, the magnetometer and the gyroscope; θ_c and θ_m in radians."""

    alpha: float
    beta: float
    gamma: float
    theta_c: float
    theta_m: float


def hybrid_heading(before: float, theta_m: float, theta_m_before: float, theta_g: float, w: HybridWeights) -> float:
    """Return θ_k [wang2015] eq. (8), all angles in radians.

    Args:
        before: θ_{k−1}, the fused heading of the step before.
        theta_m, theta_m_before: θ_m,k and θ_m,k−1.
        theta_g: θ_g,k.
        w: weights and thresholds.
    """
    agree = abs(wrap_rad(theta_m - theta_g)) <= w.theta_c  # θ_Δc ≤ θ_c
    steady = abs(wrap_rad(theta_m - theta_m_before)) <= w.theta_m  # θ_Δm ≤ θ_m
    if agree and steady:
        terms = [(w.alpha, before), (w.beta, theta_m), (w.gamma, theta_g)]
    elif agree:
        terms = [(w.beta, theta_m), (w.gamma, theta_g)]
    elif steady:
        terms = [(w.alpha, before)]
    else:
        terms = [(w.alpha, before), (w.gamma, theta_g)]
    return circular_mean(terms, before)


def circular_mean(terms: Sequence[tuple[float, float]], otherwise: float) -> float:
    """Return the mean of (weight, angle) on the circle; ``otherwise`` where they cancel or weigh nothing.

    The length of the sum does not matter for its direction: this is where the weights come to sum to one.
    """
    sin = sum(weight * math.sin(angle) for weight, angle in terms)
    cos = sum(weight * math.cos(angle) for weight, angle in terms)
    if math.hypot(sin, cos) <= 1e-9 * sum(weight for weight, _ in terms):
        return otherwise
    return math.atan2(sin, cos)


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
    min_peak_interval_s: Annotated[
        float,
        parameter(
            "δ(Δt_p): least time between peaks", unit="s", source="section 3.1", gt=0, trains=True, formerly="between_s"
        ),
    ] = 0.2
    low_pass_hz: Annotated[
        float, parameter("corner of the smoothing; 0: the raw acceleration", unit="Hz", ge=0, trains=True)
    ] = 3.0
    stationary_after_s: Annotated[
        float,
        parameter(
            "without such a peak for so long, the person stands", unit="s", gt=0, trains=True, formerly="standing_s"
        ),
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
        since_step_s: since the last step.
        travelled_m: so far.
    """

    signal: StepSignalState = field(default_factory=StepSignalState)
    steps: ExtremaState = field(default_factory=ExtremaState)
    up: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyroscope_ns: int = -1
    heading_rad: float | None = None
    theta_m: float = 0.0
    theta_g: float = 0.0
    sin: float = 0.0
    cos: float = 0.0
    turned_rad: float = 0.0
    since_step_s: float = 0.0
    travelled_m: float = 0.0


class MultiThreshold(BasePdr[MultiThresholdParams]):
    """Steps by the multi-threshold rules, length by K·⁴√(acc_max − acc_min), hybrid heading of compass and gyroscope.

    A phone without magnetometer takes the compass out of its rotation vector, one without gyroscope has θ_g = θ_m, one
    without both has no heading and measures only its turns. The survey calibrates K and the drawing's north.
    """

    name = "multi-threshold"
    source = "[wang2015] eqs. (3)–(8)"
    Params = MultiThresholdParams
    State = MultiThresholdState
    presets: ClassVar[Mapping[str, Preset]] = {
        "wang2015": Preset(
            "[wang2015] sections 3.1–3.2: raw acceleration, δ(Δt_p) = 0.2 s, eq. (8) to the letter; "
            "δ_ap, K, α, β, γ, θ_c and θ_m are not printed and ours",
            {"low_pass_hz": 0.0, "min_peak_interval_s": 0.2, "amplitude": 1.0, "keep_turns": False, "beta": 1.0},
        )
    }

    def __init__(self, params: MultiThresholdParams, context: Context, trained: TrainedModel | None = None) -> None:
        """Take what the survey taught."""
        super().__init__(params, context, trained)
        p = params
        self._offset_rad = 0.0 if trained is None else float(trained["heading_offset_rad"])
        self._k = p.length_factor * (1.0 if trained is None else float(trained["length_scale"]))
        self._thresholds = StepThresholds(p.amplitude, p.min_peak_interval_s, p.stationary_after_s)
        self._weights = HybridWeights(p.alpha, p.beta, p.gamma, p.theta_c_rad, p.theta_m_rad)

    def start(self) -> MultiThresholdState:
        """Return the state before any sample."""
        return MultiThresholdState()

    def step(self, state: MultiThresholdState, samples: MotionSamples) -> tuple[MultiThresholdState, Motion]:
        """Fold a tick's samples into motion."""
        p = self.params
        dt = (samples.t1_ns - samples.t0_ns) * 1e-9
        accelerometer = samples.sensors.get("accelerometer")
        signal, steps, found = state.signal, state.steps, tuple[MultiThresholdStep, ...]()
        if accelerometer is not None:
            signal, extrema = detect_extrema(signal, accelerometer, p.low_pass_hz)
            steps, found = detect_steps_from_extrema(steps, extrema, self._thresholds)
        lengths = [self._k * (step.acc_max - step.acc_min) ** 0.25 for step in found]  # eq. (7)

        up = update_gravity(state.up, accelerometer, dt)
        turned, gyroscope_ns = integrate_yaw(state.gyroscope_ns, samples.sensors.get("gyroscope"), up)
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
            has_compass = math.hypot(sin, cos) > 0.0
            theta_m_k = math.atan2(sin, cos) if has_compass else theta + since_rad
            theta_g_k = theta_g + since_rad if gyroscope_ns >= 0 else theta_m_k
            before = theta + since_rad if p.keep_turns else theta
            theta = hybrid_heading(before, theta_m_k, theta_m, theta_g_k, self._weights)  # eq. (8)
            theta_m, since_rad = theta_m_k, 0.0
            theta_g = theta if p.keep_turns else float(wrap_rad(theta_g_k))
        heading_rad = None if theta is None else float(wrap_rad(theta + since_rad + self._offset_rad))
        if found:
            sin = cos = 0.0
        since_step_s = 0.0 if found else state.since_step_s + dt
        motion = motion_from_steps(
            samples,
            lengths,
            p,
            heading_rad=heading_rad,
            turn_rad=turned or 0.0,
            stationary=since_step_s > p.stationary_after_s,
            travelled_before_m=state.travelled_m,
        )
        return MultiThresholdState(
            signal,
            steps,
            up,
            gyroscope_ns,
            theta,
            theta_m,
            theta_g,
            sin,
            cos,
            since_rad,
            since_step_s,
            motion.travelled_m,
        ), motion

    @staticmethod
    def train(params: MultiThresholdParams, survey: Survey, rng: Rng) -> TrainedModel:  # noqa: ARG004 - nothing is drawn
        """Calibrate K and the drawing's north on the survey's walks, see :mod:`tickfix.toolkit.calibration`."""
        return calibrate(MultiThreshold(params, Context()), survey)


def _compass(samples: MotionSamples, up: tuple[float, float, float]) -> float | None:
    """Return where the phone points in this tick by its magnetometer, else by its rotation vector, else None."""
    magnetometer: Samples | None = samples.sensors.get("magnetometer")
    if magnetometer is not None and any(up):
        return compass_heading(magnetometer.values.mean(axis=0), np.array(up))
    rotation = samples.sensors.get("rotation_vector")
    if rotation is None:
        return None
    azimuths = azimuth_from_quaternions(rotation.values)
    return math.atan2(float(np.sin(azimuths).sum()), float(np.cos(azimuths).sum()))
