"""Pdr ``elm``: velocity and orientation by regression, [jiang2015] sections 4, 5 and 8.2, eqs.

(1)-(13): parameters, training on surveyed walks with the errors expected of it, and the dead reckoning itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from tickfix.api import (
    TICK_NS,
    BasePdr,
    Context,
    Floats,
    Ints,
    Motion,
    MotionSamples,
    Preset,
    Rng,
    Survey,
    TrainedModel,
    parameter,
    wrap_rad,
)
from tickfix.toolkit.extreme_learning import RegressionElm, train_regression
from tickfix.toolkit.heading import integrate_yaw, update_gravity
from tickfix_pdr.elm_features import (
    SensorSums,
    assign_folds,
    heading_features,
    headings_of_outputs,
    labelled_windows,
    merge_sums,
    sum_samples,
    velocities_of_outputs,
    velocity_features,
)

Activation = Literal["hardlim", "sigmoid"]


@dataclass(frozen=True)
class ElmParams:
    """Parameters of ``elm``."""

    window_ms: Annotated[
        int,
        parameter(
            "T_w, whole ticks over whose samples features are averaged; the result is that of the last one",
            unit="ms",
            source="[jiang2015] 8.2.1",
            ge=200,
            trains=True,
        ),
    ] = 200
    velocity_nodes: Annotated[
        tuple[int, ...], parameter("hidden nodes to choose from", source="[jiang2015] 8.2.2", trains=True)
    ] = (25, 50, 100, 200, 400)
    heading_nodes: Annotated[
        tuple[int, ...], parameter("hidden nodes to choose from", source="[jiang2015] 8.2.2", trains=True)
    ] = (25, 50, 100, 200, 400)
    velocity_activation: Annotated[
        Activation, parameter("g(x) for the velocity", source="[jiang2015] 8.2.2", trains=True)
    ] = "hardlim"
    heading_activation: Annotated[
        Activation, parameter("g(x) for the orientation", source="[jiang2015] 8.2.2", trains=True)
    ] = "sigmoid"
    fold_count: Annotated[
        int, parameter("folds of the cross-validation", source="[jiang2015] 8.2.2", ge=2, trains=True)
    ] = 10
    keep_chains: Annotated[bool, parameter("folds keep a chain of walks together; else at random", trains=True)] = True
    as_vector: Annotated[
        bool, parameter("regress the heading as sine and cosine; else the plain angle", trains=True)
    ] = True
    ridge: Annotated[
        float, parameter("regularisation per sample", source="[jiang2015] eq. (10)", gt=0, trains=True)
    ] = 1e-3
    stationary_threshold_mps2: Annotated[
        float,
        parameter(
            "a phone that shakes less is at rest; 0: the output of the network decides",
            unit="m/s²",
            ge=0,
            formerly="still_mps2",
        ),
    ] = 0.15

    def __post_init__(self) -> None:
        """Check the window.

        Raises:
            ValueError: when it is not a whole number of ticks.
        """
        if self.window_ms * 1_000_000 % TICK_NS:
            raise ValueError(f"window_ms: found {self.window_ms}, expected a multiple of {TICK_NS // 1_000_000}")


_MIN_WINDOWS = 50


def train_networks(params: ElmParams, survey: Survey, rng: Rng) -> TrainedModel:
    """Train both networks on the survey's walks.

    Returns:
        The networks; ``velocity_mse`` and ``heading_mse`` by number of nodes as rows (nodes, MSE); ``errors``: (4,)
        of the velocity from tick to tick (m/s) and of a walk (relative), of the heading likewise (both radians);
        ``window_mse``: (2,) of the chosen networks in windows they did not see, m²/s² and, the shorter way round,
        rad², the figures of [jiang2015] Table 3.

    Raises:
        ValueError: when the survey has too few windows with all four sensors and waypoints.
    """
    velocity, heading = labelled_windows(survey.walks, params.window_ms * 1_000_000, as_vector=params.as_vector)
    if min(len(velocity.t), len(heading.t)) < _MIN_WINDOWS:
        raise ValueError(
            f"elm: found {len(velocity.t)} windows for the velocity and {len(heading.t)} for the heading, needs "
            f"{_MIN_WINDOWS}: walks with waypoints, accelerometer, gyroscope, magnetometer and rotation vector"
        )
    names = sorted({walk.chain for walk in survey.walks})
    chain = np.array([names.index(walk.chain) for walk in survey.walks])

    def fold(walk: Ints) -> Ints:
        return assign_folds(walk, chain, params.fold_count, keep_chains=params.keep_chains, rng=rng)

    v = train_regression(
        velocity.x,
        velocity.t[:, None],
        fold(velocity.walk),
        params.velocity_nodes,
        activation=params.velocity_activation,
        ridge=params.ridge,
        rng=rng,
    )
    o = train_regression(
        heading.x,
        np.stack([np.sin(heading.t), np.cos(heading.t)], axis=1) if params.as_vector else heading.t[:, None],
        fold(heading.walk),
        params.heading_nodes,
        activation=params.heading_activation,
        ridge=params.ridge,
        rng=rng,
    )
    model: dict[str, Any] = {**v.elm.arrays("velocity"), **o.elm.arrays("heading")}
    model["velocity_mse"] = np.stack([v.nodes, v.mse])
    model["heading_mse"] = np.stack([o.nodes, o.mse])
    velocity_errors = velocity.t - velocities_of_outputs(v.held_out)
    mean = _mean_by_walk(velocity_errors, velocity.walk)
    heading_errors = wrap_rad(heading.t - headings_of_outputs(o.held_out))
    bias = np.arctan2(
        _mean_by_walk(np.sin(heading_errors), heading.walk), _mean_by_walk(np.cos(heading_errors), heading.walk)
    )
    model["window_mse"] = np.array([np.mean((velocity.t - v.held_out[:, 0]) ** 2), np.mean(heading_errors**2)])
    model["errors"] = np.array(
        [
            _rms(velocity_errors - mean),
            _rms(mean) / max(float(velocity.t.mean()), 0.1),
            _robust_sigma(wrap_rad(heading_errors - bias)),
            _rms(bias),
        ]
    )
    return model


def _mean_by_walk(values: Floats, walk: Ints) -> Floats:
    """Return for each value (N,) the mean of its walk."""
    mean: Floats = (np.bincount(walk, values) / np.maximum(np.bincount(walk), 1))[walk]
    return mean


def _robust_sigma(values: Floats) -> float:
    """Return the standard deviation by the median: a spline through sparse waypoints errs far where people stop."""
    return float(1.4826 * np.median(np.abs(values)))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


_SHAKE_TIME_CONSTANT_S = 0.5


@dataclass(frozen=True, slots=True)
class ElmState:
    """What is carried from tick to tick.

    Attributes:
        heading_rad: the last one output, None before.
        up: gravity's reaction in the device frame, smoothed, m/s²; zero before the first acceleration.
        gyroscope_ns: the last gyroscope sample's time, −1 before the first.
        shake: smoothed square of the acceleration's departure from gravity's length, m²/s⁴; −1 before the first.
        travelled_m: so far.
        recent_sums: what was felt in the ticks before, as many as a window needs.
    """

    heading_rad: float | None = None
    up: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyroscope_ns: int = -1
    shake: float = -1.0
    travelled_m: float = 0.0
    recent_sums: tuple[SensorSums, ...] = ()


class ElmPdr(BasePdr[ElmParams]):
    """Velocity and orientation of each tick by two extreme learning machines, trained on the survey's walks.

    Uncertainties come from cross-validation: errors on walks that the network did not see, split into a part that
    changes from tick to tick and a part that is constant over a walk. Without the sensors of the orientation, the
    gyroscope carries the heading on; without those of the velocity, the displacement is unknown. A phone at rest stays
    where it is, whatever the network outputs for its pose; that rule is ours and off in the preset.

    Mean accelerations depend more on how a phone is held than on how fast it moves: survey with the people and the
    holds that will be tracked. Trained on one person, the velocity of another may be worse than a constant.
    """

    name = "elm"
    source = "[jiang2015] eqs. (1)–(13)"
    Params = ElmParams
    State = ElmState
    presets: ClassVar[Mapping[str, Preset]] = {
        "jiang2015": Preset(
            "[jiang2015] section 8.2.2: 500 hardlim and 1000 sigmoid nodes, random folds, plain angle",
            {
                "window_ms": 200,
                "velocity_nodes": (500,),
                "heading_nodes": (1000,),
                "velocity_activation": "hardlim",
                "heading_activation": "sigmoid",
                "fold_count": 10,
                "keep_chains": False,
                "as_vector": False,
                "ridge": 1e-8,
                "stationary_threshold_mps2": 0.0,
            },
        )
    }

    def __init__(self, params: ElmParams, context: Context, trained: TrainedModel | None = None) -> None:
        """Take the two networks.

        Raises:
            ValueError: without them.
        """
        super().__init__(params, context, trained)
        if trained is None:
            raise ValueError("elm: found no trained model; survey again with this configuration (--config)")
        self._before = params.window_ms * 1_000_000 // TICK_NS - 1
        self._velocity = RegressionElm.of(trained, "velocity", params.velocity_activation)
        self._heading = RegressionElm.of(trained, "heading", params.heading_activation)
        self._sigma, self._scale_sigma, self._heading_sigma, self._heading_bias = (
            float(v) for v in np.asarray(trained["errors"])
        )

    def start(self) -> ElmState:
        """Return the state before any sample."""
        return ElmState()

    def step(self, state: ElmState, samples: MotionSamples) -> tuple[ElmState, Motion]:
        """Fold a tick's samples into motion."""
        dt = (samples.t1_ns - samples.t0_ns) * 1e-9
        accelerometer = samples.sensors.get("accelerometer")
        up = update_gravity(state.up, accelerometer, dt)
        turned, gyroscope_ns = integrate_yaw(state.gyroscope_ns, samples.sensors.get("gyroscope"), up)
        shake = state.shake
        if accelerometer is not None:
            lengths = np.linalg.norm(accelerometer.values, axis=1)
            square = float(np.mean((lengths - math.hypot(*up)) ** 2))
            shake = square if shake < 0.0 else shake + dt / (_SHAKE_TIME_CONSTANT_S + dt) * (square - shake)
        still = accelerometer is not None and 0.0 <= shake < self.params.stationary_threshold_mps2**2

        window = (*state.recent_sums, sum_samples(samples))
        mean = merge_sums(window)
        x = velocity_features(mean)
        v = 0.0 if x is None or still else float(velocities_of_outputs(self._velocity(x[None]))[0])
        distance_m = v * dt  # eq. (13), with T_w the tick
        x_o = heading_features(mean, as_vector=self.params.as_vector)
        heading = state.heading_rad
        if x_o is not None:
            heading = float(headings_of_outputs(self._heading(x_o[None]))[0])
        elif heading is not None:
            heading = float(wrap_rad(heading + (turned or 0.0)))
        if turned is None and heading is not None and state.heading_rad is not None:
            turned = float(wrap_rad(heading - state.heading_rad))
        motion = Motion(
            t0_ns=samples.t0_ns,
            t1_ns=samples.t1_ns,
            distance_m=distance_m,
            heading_rad=heading,
            turn_rad=turned or 0.0,
            distance_sigma_m=0.0 if still else dt if x is None else self._sigma * dt,
            distance_scale_sigma=self._scale_sigma,
            heading_sigma_rad=self._heading_sigma,
            heading_bias_sigma_rad=self._heading_bias,
            turn_sigma_rad=min(0.1, self._heading_sigma),
            stationary=still,
            travelled_m=state.travelled_m + distance_m,
        )
        recent_sums = window[-self._before :] if self._before else ()
        return ElmState(heading, up, gyroscope_ns, shake, motion.travelled_m, recent_sums), motion

    @staticmethod
    def train(params: ElmParams, survey: Survey, rng: Rng) -> TrainedModel:
        """Train both networks on the survey's walks, see :func:`~tickfix_pdr.elm.train_networks`."""
        return train_networks(params, survey, rng)
