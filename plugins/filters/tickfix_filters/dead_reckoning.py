"""Filter ``dead-reckoning``: motion alone, from a known start or from the first fix. The papers' PDR-only baseline."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tickfix.api import Belief, Fix, Floats, Motion, NoParams, PredictUpdateFilter, Report, Rng, displacement, wrap_rad


@dataclass(frozen=True, slots=True)
class DeadReckoningState:
    """Where the steps have led.

    The uncertainties that stay for the whole walk are kept as what they multiply: the way so far (2,) by the person's
    scale, and the same way turned by a right angle by the bias of the heading.
    """

    floor: str
    xy: Floats
    start_covariance: Floats
    white_covariance: Floats
    net_displacement: Floats
    scale_sigma: float = 0.0
    bias_sigma_rad: float = 0.0
    heading_rad: float = 0.0
    speed_mps: float = 0.0


class DeadReckoning(PredictUpdateFilter[NoParams, DeadReckoningState]):
    """Adds up motion; fixes after the first are not used, so errors accumulate."""

    name = "dead-reckoning"
    source = "[jiang2015] eq. (13), PDR-only baseline of [wang2015]"
    State = DeadReckoningState

    def begin(self, fix: Fix, rng: Rng) -> DeadReckoningState:  # noqa: ARG002
        """Start at the fix."""
        return DeadReckoningState(fix.floor, fix.xy, fix.covariance, np.zeros((2, 2)), np.zeros(2))

    def predict(self, state: DeadReckoningState, motion: Motion, rng: Rng) -> DeadReckoningState:  # noqa: ARG002
        """Walk ``motion``: x += d·sin θ, y += d·cos θ."""
        heading = motion.heading_rad
        if heading is None:  # without compass, headings are relative to the unknown one at the start
            heading = float(wrap_rad(state.heading_rad + motion.turn_rad))
        along = displacement(1.0, heading)
        across = np.array([along[1], -along[0]])
        step = motion.distance_m * along
        white = motion.distance_sigma_m**2 * np.outer(along, along)
        white += (motion.distance_m * motion.heading_sigma_rad) ** 2 * np.outer(across, across)
        return replace(
            state,
            xy=state.xy + step,
            net_displacement=state.net_displacement + step,
            white_covariance=state.white_covariance + white,
            scale_sigma=motion.distance_scale_sigma,
            bias_sigma_rad=motion.heading_bias_sigma_rad if motion.heading_rad is not None else np.pi,
            heading_rad=heading,
            speed_mps=motion.distance_m / ((motion.t1_ns - motion.t0_ns) * 1e-9),
        )

    def update(self, state: DeadReckoningState, fix: Fix, rng: Rng) -> tuple[DeadReckoningState, Report]:  # noqa: ARG002
        """Leave the state as it is; report the distance to the fix only."""
        innovation_m = float(np.hypot(*(fix.xy - state.xy))) if fix.floor == state.floor else None
        return state, Report(innovation_m=innovation_m)

    def estimate(self, state: DeadReckoningState) -> Belief:
        """Return the dead-reckoned position."""
        turned = np.array([state.net_displacement[1], -state.net_displacement[0]])
        covariance = state.start_covariance + state.white_covariance
        covariance = covariance + state.scale_sigma**2 * np.outer(state.net_displacement, state.net_displacement)
        covariance = covariance + min(state.bias_sigma_rad, 1.0) ** 2 * np.outer(turned, turned)
        return Belief(
            floor=state.floor,
            xy=state.xy,
            covariance=covariance,
            speed_mps=state.speed_mps,
            heading_rad=state.heading_rad,
        )
