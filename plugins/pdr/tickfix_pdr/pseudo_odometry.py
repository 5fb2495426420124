"""Pdr ``pseudo-odometry``: [wang2015] section 3.3, dead reckoning read as an odometer, at the rate of the fixes."""

from __future__ import annotations

import math
from collections.abc import Mapping
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
    Survey,
    TrainedModel,
    heading_of,
    parameter,
)
from tickfix_pdr.multi_threshold import MultiThreshold, MultiThresholdParams, MultiThresholdState


@dataclass(frozen=True)
class PseudoOdometryParams(MultiThresholdParams):
    """Parameters of ``pseudo-odometry``: those of ``multi-threshold``, and the period of the fixes."""

    period_s: Annotated[
        float, parameter("time between RSSI measurements", unit="s", source="[wang2015] section 3.3", gt=0)
    ] = 2.0


@dataclass(frozen=True, slots=True)
class PseudoOdometryState:
    """The dead reckoning within, and what it walked since the last reading of the odometer.

    Attributes:
        inner_state: state of ``multi-threshold``.
        elapsed_ns: since the last reading.
        distance_m: cumulative PDR distance less that of the last reading.
        east, north: the same as a displacement, metres.
        sigma_m: white uncertainty of the distance, metres.
        travelled_m: the odometer's last reading.
    """

    inner_state: MultiThresholdState = field(default_factory=MultiThresholdState)
    elapsed_ns: int = 0
    distance_m: float = 0.0
    east: float = 0.0
    north: float = 0.0
    sigma_m: float = 0.0
    travelled_m: float = 0.0


class PseudoOdometry(BasePdr[PseudoOdometryParams]):
    """The distance of ``multi-threshold``, read every two seconds as an odometer is, and differenced.

    A dead reckoning sees samples and no fixes, so that it cannot difference at their times: the odometer is read on a
    fixed grid at the rate of the RSSI measurements (``period_s``), which begins with the track. A tick that ends at
    or just past a point of the grid brings the way since the reading before: its length along the steps, and the
    direction of the sum of the steps, s_e and s_n of [wang2015] eq. (13). All other ticks bring no way and its
    certainty: the distance between readings lags by up to one period, as the paper's odometer does. Steps and turns
    are reported when they happen.
    """

    name = "pseudo-odometry"
    source = "[wang2015] section 3.3"
    Params = PseudoOdometryParams
    State = PseudoOdometryState
    presets: ClassVar[Mapping[str, Preset]] = {
        "wang2015": Preset(
            "[wang2015] section 3.3: every 2 s; the rest is the preset of multi-threshold",
            {**MultiThreshold.presets["wang2015"].values, "period_s": 2.0},
        )
    }

    def __init__(self, params: PseudoOdometryParams, context: Context, trained: TrainedModel | None = None) -> None:
        """Build the dead reckoning within."""
        super().__init__(params, context, trained)
        self._pdr = MultiThreshold(params, context, trained)
        self._period_ns = max(1, round(params.period_s * 1e9))

    def start(self) -> PseudoOdometryState:
        """Return the state before any sample."""
        return PseudoOdometryState()

    def step(self, state: PseudoOdometryState, samples: MotionSamples) -> tuple[PseudoOdometryState, Motion]:
        """Fold a tick's samples; return a displacement in ticks in which the odometer is read."""
        inner, motion = self._pdr.step(state.inner_state, samples)
        heading = motion.heading_rad
        way = motion.distance_m if heading is not None else 0.0
        summed = PseudoOdometryState(
            inner_state=inner,
            elapsed_ns=state.elapsed_ns + samples.t1_ns - samples.t0_ns,
            distance_m=state.distance_m + motion.distance_m,
            east=state.east + way * math.sin(heading or 0.0),
            north=state.north + way * math.cos(heading or 0.0),
            sigma_m=math.hypot(state.sigma_m, motion.distance_sigma_m),
            travelled_m=state.travelled_m,
        )
        if summed.elapsed_ns < self._period_ns:
            between_readings = replace(
                motion,
                distance_m=0.0,
                distance_sigma_m=0.0,
                stationary=motion.stationary and summed.distance_m == 0.0,
                travelled_m=state.travelled_m,
            )
            return summed, between_readings
        if math.hypot(summed.east, summed.north) > 0.0:
            heading = heading_of(np.array([summed.east, summed.north]))
        read = replace(
            motion,
            distance_m=summed.distance_m,
            heading_rad=heading,
            distance_sigma_m=summed.sigma_m,
            stationary=motion.stationary and summed.distance_m == 0.0,
            travelled_m=state.travelled_m + summed.distance_m,
        )
        rest_ns = summed.elapsed_ns % self._period_ns
        return PseudoOdometryState(inner_state=inner, elapsed_ns=rest_ns, travelled_m=read.travelled_m), read

    @staticmethod
    def train(params: PseudoOdometryParams, survey: Survey, rng: Rng) -> TrainedModel:
        """Learn what ``multi-threshold`` learns."""
        return MultiThreshold.train(params, survey, rng)
