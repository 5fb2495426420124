"""Pdr ``elm``: velocity and orientation by regression, [jiang2015] sections 4 and 5, eqs. (1)–(13)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tickfix.api import (
    TICK_NS,
    BasePdr,
    Context,
    Motion,
    MotionSamples,
    Preset,
    Rng,
    Survey,
    Trained,
    wrap_rad,
)
from tickfix_pdr.elm_model import Elm
from tickfix_pdr.elm_params import ElmParams
from tickfix_pdr.elm_training import train
from tickfix_pdr.elm_windows import Felt, felt, heading_features, headings, joined, velocities, velocity_features
from tickfix_pdr.heading import fold_gravity, fold_yaw

_SHAKE_S = 0.5


@dataclass(frozen=True, slots=True)
class ElmState:
    """What is carried from tick to tick.

    Attributes:
        heading_rad: the last one told, None before.
        up: gravity's reaction in the device frame, smoothed, m/s²; zero before the first acceleration.
        gyroscope_ns: the last gyroscope sample's time, −1 before the first.
        shake: smoothed square of the acceleration's departure from gravity's length, m²/s⁴; −1 before the first.
        travelled_m: so far.
        recent: what was felt in the ticks before, as many as a window needs.
    """

    heading_rad: float | None = None
    up: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyroscope_ns: int = -1
    shake: float = -1.0
    travelled_m: float = 0.0
    recent: tuple[Felt, ...] = ()


class ElmPdr(BasePdr[ElmParams]):
    """Velocity and orientation of each tick by two extreme learning machines, trained on the survey's walks.

    The uncertainties told are what cross-validation found: errors of walks that the network did not see, apart for what
    changes from tick to tick and what stays for a walk. Where the sensors of the orientation are silent, the heading
    goes on by the gyroscope; where those of the velocity are, nothing is known of the way. A phone that lies still
    stays where it is, whatever the network says of its pose; that rule is ours and off in the preset.

    Mean accelerations tell how a phone is held before they tell how fast it goes: survey with the people and the holds
    that will be followed. Of one person's survey the velocity of another person may come out worse than a constant.
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
                "still_mps2": 0.0,
            },
        )
    }

    def __init__(self, params: ElmParams, context: Context, trained: Trained | None = None) -> None:
        """Take the two networks.

        Raises:
            ValueError: without them.
        """
        super().__init__(params, context, trained)
        if trained is None:
            raise ValueError("elm: found no trained model; survey again with this configuration (--config)")
        self._before = params.window_ms * 1_000_000 // TICK_NS - 1
        self._velocity = Elm.of(trained, "velocity", params.velocity_activation)
        self._heading = Elm.of(trained, "heading", params.heading_activation)
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
        up = fold_gravity(state.up, accelerometer, dt)
        turned, gyroscope_ns = fold_yaw(state.gyroscope_ns, samples.sensors.get("gyroscope"), up)
        shake = state.shake
        if accelerometer is not None:
            lengths = np.linalg.norm(accelerometer.values, axis=1)
            square = float(np.mean((lengths - math.hypot(*up)) ** 2))
            shake = square if shake < 0.0 else shake + dt / (_SHAKE_S + dt) * (square - shake)
        still = accelerometer is not None and 0.0 <= shake < self.params.still_mps2**2

        window = (*state.recent, felt(samples))
        mean = joined(window)
        x = velocity_features(mean)
        v = 0.0 if x is None or still else float(velocities(self._velocity(x[None]))[0])
        distance_m = v * dt  # eq. (13), with T_w the tick
        x_o = heading_features(mean, as_vector=self.params.as_vector)
        heading = state.heading_rad
        if x_o is not None:
            heading = float(headings(self._heading(x_o[None]))[0])
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
        recent = window[-self._before :] if self._before else ()
        return ElmState(heading, up, gyroscope_ns, shake, motion.travelled_m, recent), motion

    @staticmethod
    def train(params: ElmParams, survey: Survey, rng: Rng) -> Trained:
        """Train both networks on the survey's walks, see :func:`~tickfix_pdr.elm_training.train`."""
        return train(params, survey, rng)
