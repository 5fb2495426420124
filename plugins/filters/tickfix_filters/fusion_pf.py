"""Filter ``fusion-pf``: a particle filter that motion moves, fixes weigh and walls thin out.

After [jiang2015] sections 6 and 7: each particle walks every 200 ms, is weighed by a Wi-Fi fix when there is one, and
the set is resampled. Beyond the paper, a particle also carries its own bias of the heading and error of the step
length, which its walk teaches it; the fix's error has heavy tails and a memory; a particle that crosses a wall loses
nearly all of its weight; and a few particles begin anew at every fix, so that a wrong belief never lasts
(sensor resetting, [lenser2000] Lenser and Veloso, "Sensor resetting localization", ICRA 2000).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Final

import numpy as np

from tickfix.api import Belief, Fix, Floats, Motion, PredictUpdateFilter, Report, Rng, frozen, parameter, wrap_rad
from tickfix_filters.floors import OnFloor
from tickfix_filters.noise import independent_covariance
from tickfix_filters.resampling import effective_number, normalised, systematic

_TRIES: Final = 8  # places drawn for each particle, to find one where it can stand


@dataclass(frozen=True)
class FusionPfParams:
    """Parameters of ``fusion-pf``."""

    particles: Annotated[int, parameter("N", source="[jiang2015] section 6", ge=2)] = 500
    diffusion_m: Annotated[
        float, parameter("way per square root of a second that no step explains", unit="m/√s", ge=0)
    ] = 0.1
    correlation_s: Annotated[float, parameter("time over which errors of fixes are alike", unit="s", ge=0)] = 6.0
    freedom: Annotated[float, parameter("degrees of freedom ν of the errors of fixes", gt=0)] = 4.0
    crossing_weight: Annotated[
        float, parameter("share of its weight that a particle keeps when it crosses a wall", gt=0, le=1)
    ] = 0.05
    renewed: Annotated[
        float, parameter("share of the particles that begin anew at a fix", source="[lenser2000]", ge=0, lt=1)
    ] = 0.03
    resample_below: Annotated[
        float, parameter("effective share of particles that calls for resampling", gt=0, le=1)
    ] = 0.5


@dataclass(frozen=True, slots=True)
class Particles:
    """N particles: positions (N, 2) in metres, heading biases (N,) in rad, step scales (N,), log weights (N,)."""

    on: OnFloor
    xy: Floats
    bias_rad: Floats
    scale: Floats
    log_weights: Floats
    heading_rad: float | None = None
    speed_mps: float = 0.0
    fixed_ns: int | None = None
    walked: bool = False


class FusionPf(PredictUpdateFilter[FusionPfParams, Particles]):
    """Particle filter over position, heading bias and step scale, with walls."""

    name = "fusion-pf"
    source = "[jiang2015] sections 6–7, eqs. (16)–(19)"
    Params = FusionPfParams
    State = Particles

    def begin(self, fix: Fix, rng: Rng) -> Particles:
        """Scatter the particles around the fix; their biases come with the first motion."""
        n = self.params.particles
        zeros = frozen(np.zeros(n))
        xy = self._around(fix, n, rng)
        return Particles(OnFloor(fix.floor), frozen(xy), zeros, zeros, zeros, fixed_ns=fix.t_ns)

    def predict(self, state: Particles, motion: Motion, rng: Rng) -> Particles:
        """Walk every particle, [jiang2015] eq. (16), and let walls take their toll."""
        n = len(state.xy)
        dt = (motion.t1_ns - motion.t0_ns) * 1e-9
        bias, scale, log_weights = state.bias_rad, state.scale, state.log_weights
        if not state.walked:
            bias, scale = self._biases(motion, n, rng)
        move = self.params.diffusion_m * math.sqrt(dt) * rng.standard_normal((n, 2))
        heading = state.heading_rad
        if motion.heading_rad is not None or motion.turn_rad or motion.distance_m or motion.distance_sigma_m:
            if motion.turn_bias_sigma_rad:
                bias = bias + motion.turn_bias_sigma_rad * rng.standard_normal(n)
            # Without compass the particles' biases begin all around, and turns are all there is to follow.
            heading = motion.heading_rad
            if heading is None:
                heading = float(wrap_rad((state.heading_rad or 0.0) + motion.turn_rad))
        if motion.distance_m or motion.distance_sigma_m:
            distance = motion.distance_m * (1.0 + scale) + motion.distance_sigma_m * rng.standard_normal(n)
            direction = (heading or 0.0) + bias + motion.heading_sigma_rad * rng.standard_normal(n)
            move[:, 0] += distance * np.sin(direction)
            move[:, 1] += distance * np.cos(direction)
        xy = state.xy + move
        floor_map = self.context.maps.get(state.on.floor)
        if floor_map is not None and self.params.crossing_weight < 1.0:
            crossed = floor_map.crosses(state.xy, xy)
            if crossed.any():
                log_weights = log_weights + math.log(self.params.crossing_weight) * crossed
        moved = replace(
            state,
            xy=xy,
            bias_rad=bias,
            scale=scale,
            log_weights=log_weights,
            heading_rad=heading,
            speed_mps=motion.distance_m / dt,
            walked=True,
        )
        return self._resampled(moved, rng)

    def update(self, state: Particles, fix: Fix, rng: Rng) -> tuple[Particles, Report]:
        """Weigh the particles by the fix, [jiang2015] eqs. (18)–(19) with Student's t for the Gaussian."""
        on = state.on.observe(fix.floor)
        if on.floor != state.on.floor:
            return self.begin(fix, rng), Report(used=1, reasons=("changed floor",))
        if fix.floor != on.floor:
            return replace(state, on=on), Report(gated=1, reasons=("fix on another floor",))
        renewed = self._renewed(state, fix, rng)
        covariance = independent_covariance(fix, state.fixed_ns, self.params.correlation_s)
        off = renewed.xy - fix.xy
        squares = np.einsum("ni,ij,nj->n", off, np.linalg.inv(covariance), off)
        nu = self.params.freedom
        log_weights = renewed.log_weights - 0.5 * (nu + 2.0) * np.log1p(squares / nu)
        mean = normalised(state.log_weights) @ state.xy
        report = Report(used=1, innovation_m=float(np.hypot(*(fix.xy - mean))))
        weighed = replace(renewed, on=on, log_weights=log_weights, fixed_ns=fix.t_ns)
        return self._resampled(weighed, rng), report

    def estimate(self, state: Particles) -> Belief:
        """Say mean and covariance of the particles."""
        weights = normalised(state.log_weights)
        mean = weights @ state.xy
        off = state.xy - mean
        heading = None
        if state.heading_rad is not None and state.walked:
            turned = np.array([weights @ np.sin(state.bias_rad), weights @ np.cos(state.bias_rad)])
            heading = float(wrap_rad(state.heading_rad + math.atan2(*turned)))
        return Belief(
            floor=state.on.floor,
            xy=mean,
            covariance=(weights[:, None] * off).T @ off,
            speed_mps=state.speed_mps,
            heading_rad=heading,
        )

    def _around(self, fix: Fix, n: int, rng: Rng) -> Floats:
        """Draw n places from the fix's Gaussian, those preferred where one can stand."""
        floor_map = self.context.maps.get(fix.floor)
        drawn = n if floor_map is None else _TRIES * n
        xy = fix.xy + rng.standard_normal((drawn, 2)) @ np.linalg.cholesky(fix.covariance).T
        if floor_map is None:
            return xy
        free = xy[floor_map.contains(xy)]
        if len(free) == 0:
            return floor_map.nearest_free(xy[:n])
        return free[np.arange(n) % len(free)]

    @staticmethod
    def _biases(motion: Motion, n: int, rng: Rng) -> tuple[Floats, Floats]:
        sigma_rad = motion.heading_bias_sigma_rad
        compass = motion.heading_rad is not None and sigma_rad < np.pi
        bias = sigma_rad * rng.standard_normal(n) if compass else rng.uniform(-np.pi, np.pi, n)
        return bias, motion.distance_scale_sigma * rng.standard_normal(n)

    def _renewed(self, state: Particles, fix: Fix, rng: Rng) -> Particles:
        """Let a random few begin anew at the fix, with the weight of the middling particle."""
        n = round(self.params.renewed * len(state.xy))
        if n == 0:
            return state
        those = rng.choice(len(state.xy), n, replace=False)
        xy, log_weights = state.xy.copy(), state.log_weights.copy()
        xy[those] = self._around(fix, n, rng)
        log_weights[those] = np.median(state.log_weights)
        return replace(state, xy=xy, log_weights=log_weights)

    def _resampled(self, state: Particles, rng: Rng) -> Particles:
        weights = normalised(state.log_weights)
        if effective_number(weights) >= self.params.resample_below * len(weights):
            return state
        drawn = systematic(weights, rng)
        return replace(
            state,
            xy=state.xy[drawn],
            bias_rad=state.bias_rad[drawn],
            scale=state.scale[drawn],
            log_weights=np.zeros(len(drawn)),
        )
