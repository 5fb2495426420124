"""Filter ``map-pf``: MWPO, the floor-map-aided particle filter of [wang2015] section 5.

It runs the fading-factor filter (:mod:`tickfix_filters.fading_ekf`) and observes its result. Particles walk with every
tick, by what was measured; or, where ``propagation`` is ``"ekf"``, by the EKF's velocity, since section 5.3 names only
the EKF's places and the map as what goes in, and section 5.1 leaves the transition open. One that leaves the effective
region of the map, or passes a wall on the way, has weight 0, eq. (24). At each fix the others are weighed by a Gaussian
of their distance to the EKF's place, and drawn by auxiliary SIR, [arulampalam2002] algorithm 5: in proportion to how
well they explain it *before* they are scattered, and weighed by what that got wrong.

A map can also kill a filter: when every particle has died, or when the particles stay far from the EKF for several
fixes in a row (one gross error is no reason), they are reinitialised around its position, where one can stand. How much
a particle's walk differs from the measured one is not printed; these parameters are ours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from tickfix.api import (
    Belief,
    Bools,
    Fix,
    Floats,
    Motion,
    Observation,
    PredictUpdateFilter,
    Preset,
    Report,
    Rng,
    displacement,
    frozen,
    parameter,
)
from tickfix.toolkit.fix_errors import FloorHysteresis
from tickfix.toolkit.particles import effective_sample_size, normalise_log_weights, systematic_resample
from tickfix.toolkit.walkable_area import outside_walkable, sample_around
from tickfix_filters.fading_ekf import (
    FadingParams,
    FadingState,
    accumulate_motion,
    correct_by_fix,
    extrapolate,
    initial_state,
    speed_and_heading,
    velocity,
)


@dataclass(frozen=True)
class MapPfParams(FadingParams):
    """Parameters of ``map-pf``."""

    particles: Annotated[int, parameter("N", source="[wang2015] section 6.1", ge=2)] = 100
    sigma_m: Annotated[float, parameter("σ of the EKF's place", unit="m", source="[wang2015] eq. (24)", gt=0)] = 1.0
    diffusion_m: Annotated[
        float, parameter("way per square root of a second that no step explains", unit="m/√s", gt=0)
    ] = 0.4
    jitter_sigma_m: Annotated[
        float, parameter("σ by which what was drawn is scattered", unit="m", gt=0, formerly="scatter_m")
    ] = 0.3
    propagation: Annotated[
        Literal["motion", "ekf"],
        parameter(
            "by what particles walk: measured motion, or the EKF's velocity",
            source="[wang2015] 5.1, step 2",
            formerly="walk",
        ),
    ] = "motion"
    walls: Annotated[bool, parameter("a particle that passes a wall has left the effective region")] = True
    reset_distance_m: Annotated[
        float,
        parameter("particles this far from the EKF's place are locked out", unit="m", gt=0, formerly="locked_out_m"),
    ] = 4.0
    reset_after_fixes: Annotated[
        int, parameter("… when they are for so many fixes in a row", ge=1, formerly="locked_out_fixes")
    ] = 3


@dataclass(frozen=True, slots=True)
class MapParticles:
    """N particles beside the EKF that they observe.

    Attributes:
        hysteresis: the floor all are on.
        ekf: the fading-factor filter's state.
        xy: (N, 2) metres.
        log_weights: (N,), −inf for the dead; not all are.
        distant_fixes: fixes in a row at which the particles were far from the EKF's place.
        depletions, lockouts: how often all particles died, and how often they were far from the EKF; each time they
            were reinitialised.
    """

    hysteresis: FloorHysteresis
    ekf: FadingState
    xy: Floats
    log_weights: Floats
    distant_fixes: int = 0
    depletions: int = 0
    lockouts: int = 0


class MapPf(PredictUpdateFilter[MapPfParams, MapParticles]):
    """Few particles, held to the floor's map, around the place of a fading-factor Kalman filter."""

    name = "map-pf"
    source = "[wang2015] section 5, eqs. (23)–(24); [arulampalam2002] algorithm 5"
    Params = MapPfParams
    State = MapParticles
    presets: ClassVar[Mapping[str, Preset]] = {
        "wang2015": Preset(
            source="[wang2015] sections 4.4, 5.2 and 6.1", values={"particles": 100, "sigma_m": 1.0, "delta_s_m": 3.0}
        ),
        "wang2015-50": Preset(
            source="[wang2015] figure 17 and table 2", values={"particles": 50, "sigma_m": 1.0, "delta_s_m": 3.0}
        ),
        "wang2015-ekf": Preset(
            source="[wang2015] section 5.3: nothing but the EKF's result and the map goes in",
            values={"particles": 100, "sigma_m": 1.0, "delta_s_m": 3.0, "propagation": "ekf"},
        ),
    }

    def begin(self, fix: Fix, rng: Rng) -> MapParticles:
        """Step 1 of section 5.1: scatter the particles around the fix."""
        ekf = initial_state(fix.xy, fix.covariance, self.params)
        n = self.params.particles
        return MapParticles(
            FloorHysteresis(fix.floor), ekf, self._sample_around_ekf(ekf, fix.floor, rng), frozen(np.zeros(n))
        )

    def step(
        self, state: MapParticles, motion: Motion, observations: Sequence[Observation], rng: Rng
    ) -> tuple[MapParticles, Report]:
        """Fold one tick, and report when the particles were reinitialised."""
        after, report = super().step(state, motion, observations, rng)
        reasons = report.reasons
        if after.depletions > state.depletions:
            reasons += ("all particles died",)
        if after.lockouts > state.lockouts:
            reasons += ("the map had locked the particles out",)
        return after, replace(report, reasons=reasons)

    def predict(self, state: MapParticles, motion: Motion, rng: Rng) -> MapParticles:
        """Step 2: let every particle walk."""
        ekf = accumulate_motion(state.ekf, motion)
        dt = (motion.t1_ns - motion.t0_ns) * 1e-9
        if motion.heading_rad is None or self.params.propagation == "ekf":
            move = dt * velocity(ekf)
        else:
            move = displacement(motion.distance_m, motion.heading_rad)
        xy = state.xy + move + self.params.diffusion_m * math.sqrt(dt) * rng.standard_normal(state.xy.shape)
        dead = self._outside(state.hysteresis.floor, state.xy, xy)
        log_weights = np.where(dead, -np.inf, state.log_weights)  # eq. (24), first line
        moved = replace(state, ekf=ekf, xy=frozen(xy), log_weights=frozen(log_weights))
        return (
            moved
            if np.isfinite(log_weights).any()
            else self._reinitialise(replace(moved, depletions=state.depletions + 1), rng)
        )

    def update(self, state: MapParticles, fix: Fix, rng: Rng) -> tuple[MapParticles, Report]:
        """Correct the EKF, then steps 3 to 5: weigh the particles by its place, and draw."""
        hysteresis = state.hysteresis.observe(fix.floor)
        if hysteresis.floor != state.hysteresis.floor:
            initial = replace(self.begin(fix, rng), depletions=state.depletions, lockouts=state.lockouts)
            return initial, Report(used=1, reasons=("changed floor",))
        if fix.floor != hysteresis.floor:
            return replace(state, hysteresis=hysteresis), Report(gated=1, reasons=("fix on another floor",))
        ekf, correction = correct_by_fix(state.ekf, fix.xy, fix.covariance, self.params)
        place, _ = extrapolate(ekf, self.params)
        resampled = self._resample(replace(state, hysteresis=hysteresis, ekf=ekf), place, rng)
        weights = normalise_log_weights(resampled.log_weights)
        report = replace(correction.report, diagnostics={"ess": float(effective_sample_size(weights))})
        off = place - weights @ resampled.xy
        distant_fixes = state.distant_fixes + 1 if float(np.hypot(*off)) > self.params.reset_distance_m else 0
        if distant_fixes >= self.params.reset_after_fixes:
            return self._reinitialise(replace(resampled, lockouts=state.lockouts + 1), rng), report
        return replace(resampled, distant_fixes=distant_fixes), report

    def estimate(self, state: MapParticles) -> Belief:
        """Step 6: the weighted mean of the particles, eq. (23)."""
        w = normalise_log_weights(state.log_weights)
        centre = w @ state.xy
        off = state.xy - centre
        speed_mps, heading_rad = speed_and_heading(state.ekf)
        return Belief(
            floor=state.hysteresis.floor,
            xy=centre,
            covariance=(w[:, None] * off).T @ off,
            speed_mps=speed_mps,
            heading_rad=heading_rad,
        )

    def _resample(self, state: MapParticles, place: Floats, rng: Rng) -> MapParticles:
        """Return the particles drawn and weighed by the EKF's place (2,), by auxiliary SIR."""
        first_stage_log_p = self._log_p(place, state.xy)
        chosen = systematic_resample(
            normalise_log_weights(state.log_weights + first_stage_log_p), rng
        )  # first stage, by what is expected of each
        mu = state.xy[chosen]
        xy = mu + self.params.jitter_sigma_m * rng.standard_normal(mu.shape)
        log_weights = self._log_p(place, xy) - first_stage_log_p[chosen]  # second stage: p(z|x)/p(z|μ)
        log_weights[self._outside(state.hysteresis.floor, mu, xy)] = -np.inf  # eq. (24), first line
        resampled = replace(state, xy=frozen(xy), log_weights=frozen(log_weights))
        return (
            resampled
            if np.isfinite(log_weights).any()
            else self._reinitialise(replace(resampled, depletions=state.depletions + 1), rng)
        )

    def _log_p(self, place: Floats, xy: Floats) -> Floats:
        """Return the logarithm (N,) of eq. (24), second line, without its constant factor."""
        log_p: Floats = -((xy - place) ** 2).sum(axis=1) / (2.0 * self.params.sigma_m**2)
        return log_p

    def _reinitialise(self, state: MapParticles, rng: Rng) -> MapParticles:
        """Return the particles scattered around where the EKF is now."""
        xy = self._sample_around_ekf(state.ekf, state.hysteresis.floor, rng)
        return replace(state, xy=xy, log_weights=frozen(np.zeros(len(xy))), distant_fixes=0)

    def _sample_around_ekf(self, ekf: FadingState, floor: str, rng: Rng) -> Floats:
        """Draw N places around the EKF's, those preferred where one can stand."""
        place, covariance = extrapolate(ekf, self.params)
        sigma_m = math.sqrt(0.5 * float(np.trace(covariance)))
        return sample_around(self.context.maps.get(floor), place, sigma_m, self.params.particles, rng)

    def _outside(self, floor: str, before: Floats, xy: Floats) -> Bools:
        """Return which particles (N,) have left the effective region of the map."""
        return outside_walkable(self.context.maps.get(floor), before, xy, walls=self.params.walls)
