"""Filter ``fusion-pf``: a particle filter that motion moves, fixes weigh and walls thin out.

[jiang2015] sections 6 and 7: each particle walks every 200 ms, eq. (16), is weighed by a Wi-Fi fix when there is one,
and else by the motion result, eqs. (18)–(19), and the set is resampled (SIR). The preset ``jiang2015`` is that and
nothing else.

The defaults go beyond the paper. Without a fix nothing weighs: particles spread as motion says that it errs. A particle
also carries its own bias of the heading and error of the step length, which its walk teaches it, and how far the last
fix was off if the particle is right: errors of fixes have a memory (:mod:`tickfix_filters.noise`). A particle that
crosses a wall loses most of its weight, and so does, step by step, one that walks where nobody can; not all of it,
since plans err too. A few particles begin anew at every fix, so that a wrong belief never lasts (sensor resetting,
[lenser2000] Lenser and Veloso, "Sensor resetting localization", ICRA 2000).

Those few are too few for a person who comes out of a part that nobody surveyed. Fixes there are poor, so the belief
begins in the wrong shop, is kept there by walls, and every later fix of a large σ agrees with it. What gives it away is
that fixes lie off it *in one direction* for several scans, many metres whatever their σ: then all begin anew.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Final

import numpy as np

from tickfix.api import (
    Belief,
    Fix,
    Floats,
    Motion,
    Observation,
    PredictUpdateFilter,
    Preset,
    Report,
    Rng,
    displacement,
    wrap_rad,
)
from tickfix_filters.floors import OnFloor
from tickfix_filters.fusion_params import JIANG2015, FusionPfParams
from tickfix_filters.fusion_state import BiasPrior, Particles, Unseen
from tickfix_filters.noise import sigma_m
from tickfix_filters.resampling import effective_number, normalised, spatial_median, systematic

_LOST: Final = 4.0  # surprise above which a belief is in doubt: twice σ per axis, over several fixes
_LEARN: Final = 0.5
_LEARN_ASTRAY: Final = 0.3  # a running mean over about as many scans as errors of fixes stay alike
_FAR: Final = 2.0  # in it, a fix counts as no further off than twice what is astray: a single one proves nothing
_TRIES: Final = 8  # places drawn for each particle, to find one where it can stand


class FusionPf(PredictUpdateFilter[FusionPfParams, Particles]):
    """Particle filter over position, heading bias and step scale, with walls; preset jiang2015: as printed there.

    The preset is eqs. (14)–(19) alone: SIR over positions, by the fix where there is one, else by the motion result.
    """

    name = "fusion-pf"
    source = "[jiang2015] sections 6–7, eqs. (14)–(19); [bryson1968]; [lenser2000]"
    Params = FusionPfParams
    State = Particles
    presets: ClassVar[Mapping[str, Preset]] = {"jiang2015": JIANG2015}

    def step(
        self, state: Particles, motion: Motion, observations: Sequence[Observation], rng: Rng
    ) -> tuple[Particles, Report]:
        """Predict, correct, update and resample, steps 3 to 7 of section 6; see section 7 for what corrects."""
        moved, report = super().step(state, motion, observations, rng)
        if self.params.without_fix == "nothing":
            return moved, report
        if report.used:
            return replace(moved, unseen=Unseen()), report
        way = displacement(motion.distance_m, 0.0 if moved.heading_rad is None else moved.heading_rad)
        motion_result = normalised(state.log_weights) @ state.xy + way  # eq. (13), and (17) with R = 0
        squares: Floats = ((motion_result - moved.xy) ** 2).sum(axis=1) / self.params.fix_sigma_m**2
        log_weights = moved.log_weights - 0.5 * squares  # eqs. (18), (19)
        weighed = replace(moved, log_weights=log_weights, unseen=state.unseen.after(motion))
        return self._resampled(weighed, rng), report

    def begin(self, fix: Fix, rng: Rng) -> Particles:
        """Scatter the particles around the fix; their biases come with the first motion."""
        n = self.params.particles
        xy = self._around(fix, n, rng)
        error = (fix.xy - xy) / sigma_m(fix)
        return Particles(OnFloor(fix.floor), xy, np.zeros(n), np.zeros(n), error, np.zeros(n), fix.t_ns, np.zeros(2))

    def predict(self, state: Particles, motion: Motion, rng: Rng) -> Particles:
        """Walk every particle, [jiang2015] eq. (16), and let walls take their toll."""
        n = len(state.xy)
        dt = (motion.t1_ns - motion.t0_ns) * 1e-9
        bias, scale, prior = state.bias_rad, state.scale, state.motion
        own = float(self.params.own_ways)
        if prior is None:
            compass = motion.heading_rad is not None or not self.params.own_ways
            prior = BiasPrior(own * motion.heading_bias_sigma_rad, own * motion.distance_scale_sigma, compass=compass)
            bias, scale = _biases(prior, n, rng)
        # Without compass the biases begin all around, and turns are all there is to follow.
        heading = motion.heading_rad
        if heading is None:
            heading = float(wrap_rad((state.heading_rad or 0.0) + motion.turn_rad))
        if self.params.own_ways and motion.turn_bias_sigma_rad:
            bias = bias + motion.turn_bias_sigma_rad * rng.standard_normal(n)
        move = self.params.diffusion_m * math.sqrt(dt) * rng.standard_normal((n, 2))
        if not self.params.own_ways:
            move += displacement(motion.distance_m, heading)
        elif motion.distance_m or motion.distance_sigma_m:
            distance = motion.distance_m * (1.0 + scale) + motion.distance_sigma_m * rng.standard_normal(n)
            move += displacement(distance, heading + bias + motion.heading_sigma_rad * rng.standard_normal(n))
        xy = state.xy + move
        moved = replace(
            state,
            xy=xy,
            bias_rad=bias,
            scale=scale,
            log_weights=state.log_weights + self._toll(state, xy, motion),
            heading_rad=heading,
            speed_mps=motion.distance_m / dt,
            motion=prior,
        )
        return self._resampled(moved, rng)

    def update(self, state: Particles, fix: Fix, rng: Rng) -> tuple[Particles, Report]:
        """Weigh the particles by the fix, [jiang2015] eqs. (18)–(19): Student's t for what is new in its error."""
        on = state.on.observe(fix.floor)
        if on.floor != state.on.floor:
            return self.begin(fix, rng), Report(used=1, reasons=("changed floor",))
        if fix.floor != on.floor:
            return replace(state, on=on), Report(gated=1, reasons=("fix on another floor",))
        nu, rho = self.params.freedom, self.params.correlation(fix, state.fixed_ns)
        error = (fix.xy - state.xy) / (self.params.fix_sigma_m or sigma_m(fix))
        squares: Floats = ((error - rho * state.error) ** 2).sum(axis=1) / (1.0 - rho**2)
        log_weights = state.log_weights - 0.5 * (nu + 2.0) * np.log1p(squares / nu)
        off = fix.xy - normalised(state.log_weights) @ state.xy
        innovation_m = float(np.hypot(*off))
        counted = min(1.0, _FAR * self.params.astray_m / max(innovation_m, 1e-9)) * off
        astray = (1.0 - _LEARN_ASTRAY) * state.astray + _LEARN_ASTRAY * counted
        if np.hypot(*astray) > self.params.astray_m:
            report = Report(used=1, innovation_m=innovation_m, lost=True, reasons=("began anew",))
            return self._begun_anew(state, fix, rng), report
        surprise = (1.0 - _LEARN) * state.surprise + _LEARN * 0.5 * float(off @ off) / sigma_m(fix) ** 2
        weighed = replace(
            state,
            on=on,
            error=error,
            log_weights=log_weights,
            fixed_ns=fix.t_ns,
            astray=astray,
            surprise=surprise,
        )
        report = Report(used=1, innovation_m=innovation_m, lost=surprise > _LOST)
        return self._resampled(self._renewed(weighed, fix, rng), rng), report

    def estimate(self, state: Particles) -> Belief:
        """Say where the particles are, and how far around."""
        weights = normalised(state.log_weights)
        centre: Floats = weights @ state.xy
        if self.params.centre == "median":
            centre = spatial_median(state.xy, weights, centre)
        off = state.xy - centre
        covariance = (weights[:, None] * off).T @ off + state.unseen.variance_m2 * np.eye(2)
        heading = None
        if state.heading_rad is not None:
            turned = math.atan2(weights @ np.sin(state.bias_rad), weights @ np.cos(state.bias_rad))
            heading = float(wrap_rad(state.heading_rad + turned))
        return Belief(
            floor=state.on.floor,
            xy=centre,
            covariance=covariance,
            speed_mps=state.speed_mps,
            heading_rad=heading,
        )

    def _around(self, fix: Fix, n: int, rng: Rng) -> Floats:
        """Draw n places around the fix, those preferred where one can stand."""
        floor_map = self.context.maps.get(fix.floor)
        drawn = n if floor_map is None else _TRIES * n
        xy = fix.xy + min(sigma_m(fix), self.params.scatter_m) * rng.standard_normal((drawn, 2))
        if floor_map is None:
            return xy
        free = xy[floor_map.contains(xy)]
        return free[np.arange(n) % len(free)] if len(free) else floor_map.nearest_free(xy[:n])

    def _toll(self, state: Particles, xy: Floats, motion: Motion) -> Floats | float:
        """Return the logarithm of the weight that the map leaves to each particle: (N,), or 0 without a map."""
        floor_map = self.context.maps.get(state.on.floor)
        if floor_map is None:
            return 0.0
        toll = math.log(self.params.crossing_weight) * floor_map.crosses(state.xy, xy).astype(np.float64)
        if motion.steps:
            toll += motion.steps * math.log(self.params.outside_weight) * ~floor_map.contains(xy)
        return toll

    def _renewed(self, state: Particles, fix: Fix, rng: Rng) -> Particles:
        """Let a random few begin anew at the fix, each with the weight of an average particle."""
        sigma = sigma_m(fix)
        share = self.params.renewed_lost if state.surprise > _LOST else self.params.renewed
        share *= min(1.0, (self.params.renewed_sigma_m / sigma) ** 2)
        n = round(share * len(state.xy))
        if n == 0 or state.motion is None:
            return state
        those = rng.choice(len(state.xy), n, replace=False)
        highest = float(state.log_weights.max())
        average = highest + math.log(float(np.exp(state.log_weights - highest).mean()))
        xy, error, log_weights = state.xy.copy(), state.error.copy(), state.log_weights.copy()
        bias, scale = state.bias_rad.copy(), state.scale.copy()
        xy[those] = self._around(fix, n, rng)
        error[those] = (fix.xy - xy[those]) / sigma
        bias[those], scale[those] = _biases(state.motion, n, rng)
        log_weights[those] = average
        return replace(state, xy=xy, bias_rad=bias, scale=scale, error=error, log_weights=log_weights)

    def _begun_anew(self, state: Particles, fix: Fix, rng: Rng) -> Particles:
        """Begin at the fix, facing and walking as before; what was learnt of the biases was learnt in a wrong place."""
        anew = replace(self.begin(fix, rng), heading_rad=state.heading_rad, speed_mps=state.speed_mps)
        if state.motion is None:
            return anew
        bias, scale = _biases(state.motion, len(anew.xy), rng)
        return replace(anew, bias_rad=bias, scale=scale, motion=state.motion)

    def _resampled(self, state: Particles, rng: Rng) -> Particles:
        weights = normalised(state.log_weights)
        n = len(weights)
        # Equal weights ask for nothing, whatever rounding makes of them.
        if effective_number(weights) >= self.params.resample_below * n * (1.0 - 1e-9):
            return state
        drawn = systematic(weights, rng) if self.params.resampling == "systematic" else rng.choice(n, n, p=weights)
        return replace(
            state,
            xy=state.xy[drawn],
            bias_rad=state.bias_rad[drawn],
            scale=state.scale[drawn],
            error=state.error[drawn],
            log_weights=np.zeros(len(drawn)),
        )


def _biases(prior: BiasPrior, n: int, rng: Rng) -> tuple[Floats, Floats]:
    """Draw biases (n,) of the heading and of the length of steps."""
    bias = prior.heading_rad * rng.standard_normal(n) if prior.compass else rng.uniform(-math.pi, math.pi, n)
    return bias, prior.scale * rng.standard_normal(n)
