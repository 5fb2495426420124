"""Filter ``fusion-pf``: a particle filter that motion moves, fixes weigh and walls thin out.

[jiang2015] sections 6 and 7: each particle walks every 200 ms, eq. (16), is weighed by a Wi-Fi fix when there is one,
and else by the motion result, eqs. (18)–(19), and the set is resampled (SIR). The preset ``jiang2015`` is that and
nothing else.

The defaults go beyond the paper. Without a fix nothing weighs: particles spread as motion says that it errs. A particle
also carries its own bias of the heading and error of the step length, which its walk teaches it, and how far the last
fix was off if the particle is right: errors of fixes have a memory (:mod:`tickfix_filters.noise`). A particle that
crosses a wall loses most of its weight, and so does, step by step, one that walks where nobody can; not all of it,
since plans err too. One that walks along the nearest wall, or straight away from it, gains a little: so corridors teach
what the bias of the heading is ([borenstein2010], :mod:`tickfix_filters.wall_directions`). A few particles begin anew
at every fix, so that a wrong belief never lasts (sensor resetting, [lenser2000] Lenser and Veloso, "Sensor resetting
localization", ICRA 2000).

Those few are too few for a person who comes out of a part that nobody surveyed. Fixes there are poor, so the belief
begins in the wrong shop, is kept there by walls, and every later fix of a large σ agrees with it. What gives it away is
that fixes lie off it *in one direction* for several scans, many metres whatever their σ: then all begin anew.

Where nobody surveyed, a fix is a surveyed place that sounds alike, and its σ says so. The particles are then metres or
shops away from the person, and walls that they meet are not the person's walls: both walls and fixes that lie off count
in proportion to how good fixes are, walls (which are met again and again) to its square.
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
    Trained,
    displacement,
)
from tickfix_filters.floors import OnFloor
from tickfix_filters.fusion_belief import beliefs, mean_xy
from tickfix_filters.fusion_motion import bias_prior, biases, heading_rad, walked
from tickfix_filters.fusion_params import JIANG2015, FusionPfParams
from tickfix_filters.fusion_state import Particles, Unseen, batches
from tickfix_filters.fusion_walls import aligned, around, toll
from tickfix_filters.noise import sigma_m
from tickfix_filters.resampling import effective_number, normalised, systematic
from tickfix_filters.wall_directions import WallDirections

_LOST: Final = 4.0  # surprise above which a belief is in doubt: twice σ per axis, over several fixes
_LEARN: Final = 0.5
_LEARN_ASTRAY: Final = 0.3  # a running mean over about as many scans as errors of fixes stay alike
_FAR: Final = 2.0  # in it, a fix counts as no further off than twice what is astray: a single one proves nothing


class FusionPf(PredictUpdateFilter[FusionPfParams, Particles]):
    """Particle filter over position, heading bias and step scale, with walls; preset jiang2015: as printed there.

    The preset is eqs. (14)–(19) alone: SIR over positions, by the fix where there is one, else by the motion result.
    """

    name = "fusion-pf"
    source = "[jiang2015] sections 6–7, eqs. (14)–(19); [bryson1968]; [lenser2000]; [borenstein2010]"
    Params = FusionPfParams
    State = Particles
    presets: ClassVar[Mapping[str, Preset]] = {"jiang2015": JIANG2015}

    def __init__(self, params: FusionPfParams, context: Context, trained: Trained | None = None) -> None:
        """Look which way the walls run of the floors that the pipeline has a map of."""
        super().__init__(params, context, trained)
        mapped = [floor for name, floor in context.floors.items() if params.aligned > 0.0 and name in context.maps]
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
        moved = self.predict_many(states, motions, rngs)
        return [self._corrected(*each) for each in zip(states, moved, motions, observations, rngs, strict=True)]

    def begin(self, fix: Fix, rng: Rng) -> Particles:
        """Scatter the particles around the fix; their biases come with the first motion."""
        n = self.params.particles
        xy = around(fix, n, self.context.maps.get(fix.floor), self.params, rng)
        error = (fix.xy - xy) / sigma_m(fix)
        trust = self._trust(fix)
        return Particles(
            OnFloor(fix.floor), xy, np.zeros(n), np.zeros(n), error, np.zeros(n), fix.t_ns, np.zeros(2), trust=trust
        )

    def predict(self, state: Particles, motion: Motion, rng: Rng) -> Particles:
        """Walk every particle, [jiang2015] eq. (16), and let walls take their toll."""
        return self.predict_many([state], [motion], [rng])[0]

    def predict_many(
        self, states: Sequence[Particles], motions: Sequence[Motion], rngs: Sequence[Rng]
    ) -> list[Particles]:
        """Do the same for many devices."""
        moved: list[Particles] = []
        for batch in batches(states):
            moved += self._predicted(states[batch], motions[batch], rngs[batch])
        return moved

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
        off = fix.xy - mean_xy(state)
        innovation_m = math.hypot(*off)
        counted = min(1.0, _FAR * self.params.astray_m / max(innovation_m, 1e-9)) * off
        trust = self._trust(fix)
        astray = (1.0 - trust * _LEARN_ASTRAY) * state.astray + trust * _LEARN_ASTRAY * counted
        if math.hypot(*astray) > self.params.astray_m:
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
            trust=trust,
        )
        report = Report(used=1, innovation_m=innovation_m, lost=surprise > _LOST)
        return self._resampled(self._renewed(weighed, fix, rng), rng), report

    def estimate(self, state: Particles) -> Belief:
        """Say where the particles are, and how far around."""
        return self.estimate_many([state])[0]

    def estimate_many(self, states: Sequence[Particles]) -> list[Belief]:
        """Do the same for many devices."""
        return [
            belief
            for batch in batches(states)
            for belief in beliefs(states[batch], median=self.params.centre == "median")
        ]

    def _predicted(
        self, states: Sequence[Particles], motions: Sequence[Motion], rngs: Sequence[Rng]
    ) -> list[Particles]:
        """Walk the particles of D devices, N each."""
        states = [self._biased(*each) for each in zip(states, motions, rngs, strict=True)]
        headings = [heading_rad(*each) for each in zip(states, motions, strict=True)]
        before, bias, scale, log_weights = (
            np.array([getattr(state, name) for state in states]) for name in ("xy", "bias_rad", "scale", "log_weights")
        )
        xy, bias = walked(before, bias, scale, headings, motions, rngs, self.params)
        floors = [state.on.floor for state in states]
        trust = np.array([state.trust for state in states])
        log_weights += trust[:, None] ** 2 * toll(before, xy, floors, motions, self.context.maps, self.params)
        if self.params.aligned > 0.0:
            theta = np.array(headings)[:, None] + bias
            log_weights += aligned(theta, xy, floors, motions, self._directions, self.params)
        weights = normalised(log_weights)
        moved = []
        for d, (state, motion) in enumerate(zip(states, motions, strict=True)):
            moved.append(
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
            moved[d] = self._drawn(moved[d], weights[d], rngs[d])
        return moved

    def _biased(self, state: Particles, motion: Motion, rng: Rng) -> Particles:
        """Draw the particles' biases where this is the first motion."""
        if state.motion is not None:
            return state
        prior = bias_prior(motion, self.params)
        bias, scale = biases(prior, len(state.xy), rng)
        return replace(state, bias_rad=bias, scale=scale, motion=prior)

    def _corrected(
        self, before: Particles, moved: Particles, motion: Motion, observations: Sequence[Observation], rng: Rng
    ) -> tuple[Particles, Report]:
        """Weigh the particles of one device by its fixes, or by the motion result."""
        state, report = self.correct(moved, observations, rng)
        if self.params.without_fix == "nothing":
            return state, report
        if report.used:
            return replace(state, unseen=Unseen()), report
        way = displacement(motion.distance_m, 0.0 if state.heading_rad is None else state.heading_rad)
        motion_result = mean_xy(before) + way  # eq. (13), and (17) with R = 0
        squares: Floats = ((motion_result - state.xy) ** 2).sum(axis=1) / self.params.fix_sigma_m**2
        log_weights = state.log_weights - 0.5 * squares  # eqs. (18), (19)
        weighed = replace(state, log_weights=log_weights, unseen=before.unseen.after(motion))
        return self._resampled(weighed, rng), report

    def _trust(self, fix: Fix) -> float:
        """Return how far the fix says that a survey came here, in (0, 1]."""
        return min(1.0, self.params.surveyed_m / max(sigma_m(fix), 1e-9))

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
        xy[those] = around(fix, n, self.context.maps.get(fix.floor), self.params, rng)
        error[those] = (fix.xy - xy[those]) / sigma
        bias[those], scale[those] = biases(state.motion, n, rng)
        log_weights[those] = average
        return replace(state, xy=xy, bias_rad=bias, scale=scale, error=error, log_weights=log_weights)

    def _begun_anew(self, state: Particles, fix: Fix, rng: Rng) -> Particles:
        """Begin at the fix, facing and walking as before; what was learnt of the biases was learnt in a wrong place."""
        anew = replace(self.begin(fix, rng), heading_rad=state.heading_rad, speed_mps=state.speed_mps)
        if state.motion is None:
            return anew
        bias, scale = biases(state.motion, len(anew.xy), rng)
        return replace(anew, bias_rad=bias, scale=scale, motion=state.motion)

    def _resampled(self, state: Particles, rng: Rng) -> Particles:
        """Draw the particles anew, where their weights ask for it."""
        weights = normalised(state.log_weights)
        return self._drawn(state, weights, rng) if self._degenerate(weights) else state

    def _degenerate(self, weights: Floats) -> Bools:
        """Tell which weights (…, N) ask for resampling; equal ones do not, whatever rounding makes of them."""
        needed = self.params.resample_below * weights.shape[-1] * (1.0 - 1e-9)
        degenerate: Bools = effective_number(weights) < needed
        return degenerate

    def _drawn(self, state: Particles, weights: Floats, rng: Rng) -> Particles:
        """Draw the particles anew in proportion to their weights."""
        n = len(weights)
        drawn = systematic(weights, rng) if self.params.resampling == "systematic" else rng.choice(n, n, p=weights)
        return replace(
            state,
            xy=state.xy[drawn],
            bias_rad=state.bias_rad[drawn],
            scale=state.scale[drawn],
            error=state.error[drawn],
            log_weights=np.zeros(n),
        )
