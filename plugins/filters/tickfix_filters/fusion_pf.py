"""Filter ``fusion-pf``: a particle filter that motion moves, fixes weigh and walls thin out.

[jiang2015] sections 6 and 7: each particle walks every 200 ms, eq. (16), is weighed by a Wi-Fi fix when there is one,
and else by the motion result, eqs. (18)–(19), and the set is resampled (SIR). The preset ``jiang2015`` is that and
nothing else.

The defaults go beyond the paper. Without a fix weights do not change: particles spread by the errors that motion
reports. A particle also carries its own bias of the heading and error of the step length, which its walk teaches it,
and how far the last fix was off if the particle is right: errors of fixes have a memory
(:mod:`tickfix.toolkit.fix_errors`). A particle that crosses a wall loses most of its weight, and so does, step by step,
one that walks where one cannot; not all of it, since plans err too. One that walks along the nearest wall, or straight
away from it, gains a little: so corridors teach what the bias of the heading is ([borenstein2010],
:mod:`tickfix.toolkit.walkable_area`). A few particles are reinitialised at every fix, so that a wrong belief never
lasts (sensor resetting, [lenser2000] Lenser and Veloso, "Sensor resetting localization", ICRA 2000).

Those few are too few for a person who leaves a part that was not surveyed. Fixes there are poor, so the belief begins
in the wrong shop, is kept there by walls, and every later fix of a large σ agrees with it. What gives it away is that
fixes lie off it *in one direction* for several scans, many metres whatever their σ: then all particles are
reinitialised.

Outside the survey a fix is a surveyed place with similar signal strengths, and its σ is large. The particles are then
metres or shops away from the person, and walls that they meet are not the person's walls: both walls and fixes that lie
off count in proportion to how good fixes are, walls (which are met again and again) to its square.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Final

import numpy as np

from tickfix.api import (
    Belief,
    Bools,
    Context,
    Fix,
    Floats,
    Motion,
    Observation,
    PredictUpdateFilter,
    Preset,
    Report,
    Rng,
    TrainedModel,
    displacement,
)
from tickfix.toolkit.fix_errors import FloorHysteresis, sigma_per_axis_m
from tickfix.toolkit.likelihoods import offered_log_likelihood
from tickfix.toolkit.particles import effective_sample_size, normalise_log_weights, systematic_resample
from tickfix.toolkit.walkable_area import WallDirections
from tickfix_filters.fusion_model import (
    JIANG2015,
    DriftSinceFix,
    FusionPfParams,
    Particles,
    batches,
    beliefs_of_particles,
    heading_rad,
    initial_bias_prior,
    mean_xy,
    propagate,
    sample_around_fix,
    sample_biases,
    wall_alignment,
    wall_log_weight,
)

_LOST_NIS: Final = 4.0  # surprise above which a belief is in doubt: twice σ per axis, over several fixes
_NIS_GAIN: Final = 0.5
_OFFSET_GAIN: Final = 0.3  # a running mean over about as many scans as errors of fixes stay alike
_MAX_OFFSET_RATIO: Final = (
    2.0  # in it, a fix counts as no further off than twice what is astray: a single one proves nothing
)


class FusionPf(PredictUpdateFilter[FusionPfParams, Particles]):
    """Particle filter over position, heading bias and step scale, with walls; preset jiang2015: as printed there.

    The preset is eqs. (14)–(19) alone: SIR over positions, by the fix where there is one, else by the motion result.
    """

    name = "fusion-pf"
    source = "[jiang2015] sections 6–7, eqs. (14)–(19); [bryson1968]; [lenser2000]; [borenstein2010]"
    Params = FusionPfParams
    State = Particles
    presets: ClassVar[Mapping[str, Preset]] = {"jiang2015": JIANG2015}

    def __init__(self, params: FusionPfParams, context: Context, trained: TrainedModel | None = None) -> None:
        """Look which way the walls run of the floors that the pipeline has a map of."""
        super().__init__(params, context, trained)
        mapped = [
            floor for name, floor in context.floors.items() if params.wall_alignment > 0.0 and name in context.maps
        ]
        self._directions = {floor.name: WallDirections(floor) for floor in mapped}

    def step(
        self, state: Particles, motion: Motion, observations: Sequence[Observation], rng: Rng
    ) -> tuple[Particles, Report]:
        """Predict, correct, update and resample, steps 3 to 7 of section 6; see section 7 for what corrects."""
        return self.step_many([state], [motion], [observations], [rng])[0]

    def step_many(
        self,
        states: Sequence[Particles],
        motions: Sequence[Motion],
        observations: Sequence[Sequence[Observation]],
        rngs: Sequence[Rng],
    ) -> list[tuple[Particles, Report]]:
        """Do the same for many devices."""
        propagated = self.predict_many(states, motions, rngs)
        return [
            self._update_device(*each) for each in zip(states, propagated, motions, observations, rngs, strict=True)
        ]

    def begin(self, fix: Fix, rng: Rng) -> Particles:
        """Scatter the particles around the fix; their biases come with the first motion."""
        n = self.params.particles
        xy = sample_around_fix(fix, n, self.context.maps.get(fix.floor), self.params, rng)
        error = (fix.xy - xy) / sigma_per_axis_m(fix)
        fix_quality = self._fix_quality(fix)
        return Particles(
            FloorHysteresis(fix.floor),
            xy,
            np.zeros(n),
            np.zeros(n),
            error,
            np.zeros(n),
            fix.t_ns,
            np.zeros(2),
            fix_quality=fix_quality,
        )

    def predict(self, state: Particles, motion: Motion, rng: Rng) -> Particles:
        """Walk every particle, [jiang2015] eq. (16), and let walls take their toll."""
        return self.predict_many([state], [motion], [rng])[0]

    def predict_many(
        self, states: Sequence[Particles], motions: Sequence[Motion], rngs: Sequence[Rng]
    ) -> list[Particles]:
        """Do the same for many devices."""
        propagated: list[Particles] = []
        for batch in batches(states):
            propagated += self._propagate_batch(states[batch], motions[batch], rngs[batch])
        return propagated

    def observe(self, state: Particles, observation: Observation, rng: Rng) -> tuple[Particles, Report] | None:
        """Weigh the particles by the observation's likelihood where it offers one, else by its fix."""
        floor = state.hysteresis.floor
        log_likelihood = offered_log_likelihood(observation, floor, state.xy)
        if log_likelihood is None:
            return None if observation.fix is None else self.update(state, observation.fix, rng)
        if not np.isfinite(log_likelihood).any():
            return state, Report(gated=1, reasons=("no particle explains the scan",))
        fix = observation.fix
        if fix is not None:
            return self._update(state, fix, rng, log_likelihood)
        weighted = replace(state, log_weights=state.log_weights + log_likelihood)
        diagnostics = {"ess": float(effective_sample_size(normalise_log_weights(weighted.log_weights)))}
        return self._resample_if_degenerate(weighted, rng), Report(used=1, diagnostics=diagnostics)

    def update(self, state: Particles, fix: Fix, rng: Rng) -> tuple[Particles, Report]:
        """Weigh the particles by the fix, [jiang2015] eqs. (18)–(19): Student's t for what is new in its error."""
        return self._update(state, fix, rng, None)

    def _update(self, state: Particles, fix: Fix, rng: Rng, log_likelihood: Floats | None) -> tuple[Particles, Report]:
        """Correct by a fix; ``log_likelihood`` (N,) weighs the particles instead of the fix's error model."""
        hysteresis = state.hysteresis.observe(fix.floor)
        if hysteresis.floor != state.hysteresis.floor:
            return self.begin(fix, rng), Report(used=1, reasons=("changed floor",))
        if fix.floor != hysteresis.floor:
            return replace(state, hysteresis=hysteresis), Report(gated=1, reasons=("fix on another floor",))
        nu, rho = self.params.student_t_dof, self.params.correlation(fix, state.last_fix_ns)
        error = (fix.xy - state.xy) / (self.params.fix_sigma_m or sigma_per_axis_m(fix))
        squares: Floats = ((error - rho * state.error) ** 2).sum(axis=1) / (1.0 - rho**2)
        if log_likelihood is None:
            log_likelihood = -0.5 * (nu + 2.0) * np.log1p(squares / nu)
        log_weights = state.log_weights + log_likelihood
        off = fix.xy - mean_xy(state)
        innovation_m = math.hypot(*off)
        clipped_offset = min(1.0, _MAX_OFFSET_RATIO * self.params.reset_distance_m / max(innovation_m, 1e-9)) * off
        fix_quality = self._fix_quality(fix)
        mean_fix_offset = (
            1.0 - fix_quality * _OFFSET_GAIN
        ) * state.mean_fix_offset + fix_quality * _OFFSET_GAIN * clipped_offset
        if math.hypot(*mean_fix_offset) > self.params.reset_distance_m:
            report = Report(used=1, innovation_m=innovation_m, lost=True, reasons=("reinitialised",))
            return self._reinitialise(state, fix, rng), report
        mean_nis = (1.0 - _NIS_GAIN) * state.mean_nis + _NIS_GAIN * 0.5 * float(off @ off) / sigma_per_axis_m(fix) ** 2
        weighted = replace(
            state,
            hysteresis=hysteresis,
            error=error,
            log_weights=log_weights,
            last_fix_ns=fix.t_ns,
            mean_fix_offset=mean_fix_offset,
            mean_nis=mean_nis,
            fix_quality=fix_quality,
        )
        injected_share = self._injected_share(weighted, fix)
        diagnostics = {
            "ess": float(effective_sample_size(normalise_log_weights(log_weights))),
            "injected_share": injected_share,
            "mean_nis": mean_nis,
        }
        report = Report(used=1, innovation_m=innovation_m, lost=mean_nis > _LOST_NIS, diagnostics=diagnostics)
        injected = self._inject(weighted, fix, injected_share, rng)
        return self._resample_if_degenerate(injected, rng), report

    def estimate(self, state: Particles) -> Belief:
        """Return the point estimate of the particles, their covariance and mixture."""
        return self.estimate_many([state])[0]

    def estimate_many(self, states: Sequence[Particles]) -> list[Belief]:
        """Do the same for many devices."""
        return [
            belief
            for batch in batches(states)
            for belief in beliefs_of_particles(states[batch], median=self.params.point_estimate == "median")
        ]

    def _propagate_batch(
        self, states: Sequence[Particles], motions: Sequence[Motion], rngs: Sequence[Rng]
    ) -> list[Particles]:
        """Walk the particles of D devices, N each."""
        states = [self._with_biases(*each) for each in zip(states, motions, rngs, strict=True)]
        headings = [heading_rad(*each) for each in zip(states, motions, strict=True)]
        before, bias, scale, log_weights = (
            np.array([getattr(state, name) for state in states]) for name in ("xy", "bias_rad", "scale", "log_weights")
        )
        xy, bias = propagate(before, bias, scale, headings, motions, rngs, self.params)
        floors = [state.hysteresis.floor for state in states]
        fix_quality = np.array([state.fix_quality for state in states])
        log_weights += fix_quality[:, None] ** 2 * wall_log_weight(
            before, xy, floors, motions, self.context.maps, self.params
        )
        if self.params.wall_alignment > 0.0:
            theta = np.array(headings)[:, None] + bias
            log_weights += wall_alignment(theta, xy, floors, motions, self._directions, self.params)
        weights = normalise_log_weights(log_weights)
        propagated = []
        for d, (state, motion) in enumerate(zip(states, motions, strict=True)):
            propagated.append(
                replace(
                    state,
                    xy=xy[d].copy(),
                    bias_rad=bias[d].copy(),
                    log_weights=log_weights[d].copy(),
                    heading_rad=headings[d],
                    speed_mps=motion.distance_m / ((motion.t1_ns - motion.t0_ns) * 1e-9),
                )
            )
        for d in np.flatnonzero(self._degenerate(weights)).tolist():
            propagated[d] = self._resample(propagated[d], weights[d], rngs[d])
        return propagated

    def _with_biases(self, state: Particles, motion: Motion, rng: Rng) -> Particles:
        """Draw the particles' biases where this is the first motion."""
        if state.motion is not None:
            return state
        prior = initial_bias_prior(motion, self.params)
        bias, scale = sample_biases(prior, len(state.xy), rng)
        return replace(state, bias_rad=bias, scale=scale, motion=prior)

    def _update_device(
        self, before: Particles, propagated: Particles, motion: Motion, observations: Sequence[Observation], rng: Rng
    ) -> tuple[Particles, Report]:
        """Weigh the particles of one device by its fixes, or by the motion result."""
        state, report = self.correct(propagated, observations, rng)
        if self.params.weight_without_fix == "nothing":
            return state, report
        if report.used:
            return replace(state, drift_since_fix=DriftSinceFix()), report
        way = displacement(motion.distance_m, 0.0 if state.heading_rad is None else state.heading_rad)
        motion_result = mean_xy(before) + way  # eq. (13), and (17) with R = 0
        squares: Floats = ((motion_result - state.xy) ** 2).sum(axis=1) / self.params.fix_sigma_m**2
        log_weights = state.log_weights - 0.5 * squares  # eqs. (18), (19)
        weighted = replace(state, log_weights=log_weights, drift_since_fix=before.drift_since_fix.with_motion(motion))
        return self._resample_if_degenerate(weighted, rng), report

    def _fix_quality(self, fix: Fix) -> float:
        """Return the quality of the fix, reference_sigma_m / σ, in (0, 1]: low outside the survey."""
        return min(1.0, self.params.reference_sigma_m / max(sigma_per_axis_m(fix), 1e-9))

    def _injected_share(self, state: Particles, fix: Fix) -> float:
        """Return the share of the particles to inject at a fix: more in doubt, fewer at a poor fix, 0 … 1."""
        if state.motion is None:
            return 0.0
        share = self.params.injection_rate_lost if state.mean_nis > _LOST_NIS else self.params.injection_rate
        share *= min(1.0, (self.params.injection_sigma_m / sigma_per_axis_m(fix)) ** 2)
        return round(share * len(state.xy)) / len(state.xy)

    def _inject(self, state: Particles, fix: Fix, share: float, rng: Rng) -> Particles:
        """Reinitialise a random share of the particles at the fix, each with the weight of an average particle."""
        sigma = sigma_per_axis_m(fix)
        n = round(share * len(state.xy))
        if n == 0 or state.motion is None:
            return state
        injected = rng.choice(len(state.xy), n, replace=False)
        highest = float(state.log_weights.max())
        average = highest + math.log(float(np.exp(state.log_weights - highest).mean()))
        xy, error, log_weights = state.xy.copy(), state.error.copy(), state.log_weights.copy()
        bias, scale = state.bias_rad.copy(), state.scale.copy()
        xy[injected] = sample_around_fix(fix, n, self.context.maps.get(fix.floor), self.params, rng)
        error[injected] = (fix.xy - xy[injected]) / sigma
        bias[injected], scale[injected] = sample_biases(state.motion, n, rng)
        log_weights[injected] = average
        return replace(state, xy=xy, bias_rad=bias, scale=scale, error=error, log_weights=log_weights)

    def _reinitialise(self, state: Particles, fix: Fix, rng: Rng) -> Particles:
        """Begin at the fix, facing and walking as before; what was learnt of the biases was learnt in a wrong place."""
        reinitialised = replace(self.begin(fix, rng), heading_rad=state.heading_rad, speed_mps=state.speed_mps)
        if state.motion is None:
            return reinitialised
        bias, scale = sample_biases(state.motion, len(reinitialised.xy), rng)
        return replace(reinitialised, bias_rad=bias, scale=scale, motion=state.motion)

    def _resample_if_degenerate(self, state: Particles, rng: Rng) -> Particles:
        """Resample where the effective sample size is below the threshold."""
        weights = normalise_log_weights(state.log_weights)
        return self._resample(state, weights, rng) if self._degenerate(weights) else state

    def _degenerate(self, weights: Floats) -> Bools:
        """Return which weights (…, N) call for resampling; equal ones do not, despite rounding."""
        needed = self.params.ess_threshold * weights.shape[-1] * (1.0 - 1e-9)
        degenerate: Bools = effective_sample_size(weights) < needed
        return degenerate

    def _resample(self, state: Particles, weights: Floats, rng: Rng) -> Particles:
        """Draw particles with replacement in proportion to their weights."""
        n = len(weights)
        indices = (
            systematic_resample(weights, rng) if self.params.resampling == "systematic" else rng.choice(n, n, p=weights)
        )
        return replace(
            state,
            xy=state.xy[indices],
            bias_rad=state.bias_rad[indices],
            scale=state.scale[indices],
            error=state.error[indices],
            log_weights=np.zeros(n),
        )
