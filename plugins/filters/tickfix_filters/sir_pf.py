"""Filter ``sir-pf``: the particle filter of [jiang2015] sections 6 and 7 as printed.

Every tick each particle walks, eq. (16), and is weighed, eqs. (18)–(19), by an observed place: the fix where the tick
has one, and else the motion result, which is the last place told plus the tick's way (section 7). Then N are drawn with
replacement, in proportion to their weights (SIR), and the place told is their mean.

What the paper leaves open: Q is printed as a variance of 0.1 m/s²; it is added to the place, so 0.1 m² per tick is
taken. σ is 50 without unit, and 50 cm is taken; eq. (18) is used for both coordinates. R is 0, eq. (17). The filter
knows no walls. Weighed by their own walk, particles never spread: what a walk without fixes makes less sure is added to
the covariance told, and changes no place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np

from tickfix.api import (
    BaseFilter,
    Belief,
    Fix,
    Floats,
    Motion,
    Observation,
    Preset,
    Prior,
    Report,
    Rng,
    displacement,
    frozen,
    parameter,
    wrap_rad,
)
from tickfix_filters.floors import OnFloor
from tickfix_filters.resampling import normalised


@dataclass(frozen=True)
class SirPfParams:
    """Parameters of ``sir-pf``."""

    particles: Annotated[int, parameter("N, which is not printed", source="[jiang2015] section 6", ge=2)] = 500
    q_m2: Annotated[
        float, parameter("Q, variance per axis and tick", unit="m²", source="[jiang2015] eq. (16)", gt=0)
    ] = 0.1
    sigma_m: Annotated[float, parameter("σ of an observed place", unit="m", source="[jiang2015] eq. (18)", gt=0)] = 0.5


@dataclass(frozen=True, slots=True)
class Cloud:
    """N particles of one weight.

    Attributes:
        on: the floor all are on.
        x: (N, 2) metres.
        walked_m: since the last fix; with ``bias``, the relative error that a walk keeps, how unsure that has become.
        white_m2: variance of the ticks' ways since the last fix.
    """

    on: OnFloor
    x: Floats
    heading_rad: float | None = None
    speed_mps: float = 0.0
    walked_m: float = 0.0
    bias: float = 0.0
    white_m2: float = 0.0


class SirPf(BaseFilter[SirPfParams]):
    """Sequential importance resampling, by the fix when there is one and else by the motion result."""

    name = "sir-pf"
    source = "[jiang2015] sections 6–7, eqs. (14)–(19)"
    Params = SirPfParams
    State = Cloud
    presets: ClassVar[Mapping[str, Preset]] = {
        "jiang2015": Preset(source="[jiang2015] section 6", values={"q_m2": 0.1, "sigma_m": 0.5})
    }

    def start(self, prior: Prior, rng: Rng) -> Cloud | None:
        """Scatter the particles around the first fix, as surely as it is known."""
        return None if prior.fix is None else self._around(prior.fix, rng)

    def step(self, state: Cloud, motion: Motion, observations: Sequence[Observation], rng: Rng) -> tuple[Cloud, Report]:
        """Predict, correct, update and resample: steps 3 to 7 of section 6."""
        dt = (motion.t1_ns - motion.t0_ns) * 1e-9
        heading = motion.heading_rad
        if heading is None:  # without compass, headings are relative to the unknown one at the start
            heading = float(wrap_rad((state.heading_rad or 0.0) + motion.turn_rad))
        way = displacement(motion.distance_m, heading)
        motion_result = state.x.mean(axis=0) + way  # eqs. (13), (17)
        noise = np.sqrt(self.params.q_m2) * rng.standard_normal(state.x.shape)
        moved = replace(
            state,
            x=frozen(state.x + way + noise),  # eq. (16)
            heading_rad=heading,
            speed_mps=motion.distance_m / dt,
            walked_m=state.walked_m + motion.distance_m,
            bias=float(np.hypot(motion.distance_scale_sigma, min(motion.heading_bias_sigma_rad, 1.0))),
            white_m2=state.white_m2
            + motion.distance_sigma_m**2
            + (motion.distance_m * min(motion.heading_sigma_rad, 1.0)) ** 2,
        )
        used, gated, innovation_m = 0, 0, None
        reasons: tuple[str, ...] = ()
        for fix in [o.fix for o in observations if o.fix is not None]:
            on = moved.on.observe(fix.floor)
            if on.floor != moved.on.floor:
                moved, used, reasons = self._around(fix, rng), used + 1, ("changed floor",)
            elif fix.floor != on.floor:
                moved, gated, reasons = replace(moved, on=on), gated + 1, ("fix on another floor",)
            else:
                innovation_m = float(np.hypot(*(fix.xy - moved.x.mean(axis=0))))
                moved, used = replace(self._drawn(moved, fix.xy, rng), on=on, walked_m=0.0, white_m2=0.0), used + 1
        if used == 0:
            moved = self._drawn(moved, motion_result, rng)
        return moved, Report(used=used, gated=gated, reasons=reasons, innovation_m=innovation_m)

    def estimate(self, state: Cloud) -> Belief:
        """Say the mean of the particles, step 7 of section 6."""
        off = state.x - state.x.mean(axis=0)
        unsure = 0.5 * (state.white_m2 + (state.bias * state.walked_m) ** 2)
        return Belief(
            floor=state.on.floor,
            xy=state.x.mean(axis=0),
            covariance=off.T @ off / len(off) + unsure * np.eye(2),
            speed_mps=state.speed_mps,
            heading_rad=state.heading_rad,
        )

    def _around(self, fix: Fix, rng: Rng) -> Cloud:
        spread = np.linalg.cholesky(fix.covariance + 1e-9 * np.eye(2))
        return Cloud(OnFloor(fix.floor), frozen(fix.xy + rng.standard_normal((self.params.particles, 2)) @ spread.T))

    def _drawn(self, state: Cloud, observed: Floats, rng: Rng) -> Cloud:
        """Return the particles weighed by the ``observed`` place (2,) and drawn with replacement."""
        # Eq. (18); its constant factor cancels, and all weights were 1/N before, eq. (19).
        w = normalised(-((state.x - observed) ** 2).sum(axis=1) / (2.0 * self.params.sigma_m**2))
        return replace(state, x=frozen(state.x[rng.choice(len(w), len(w), p=w)]))
