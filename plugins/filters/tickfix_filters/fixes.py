"""Filter ``fixes``: where the last fix was. The Wi-Fi-only baseline of all three papers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from tickfix.api import Belief, Fix, Floats, Motion, PredictUpdateFilter, Report, Rng, parameter


@dataclass(frozen=True)
class FixesParams:
    """Parameters of ``fixes``."""

    speed_mps: Annotated[
        float, parameter("walking speed, by which the uncertainty grows between fixes", unit="m/s", ge=0)
    ] = 1.3


@dataclass(frozen=True, slots=True)
class LastFix:
    """The last fix, and how far one may have walked since."""

    floor: str
    xy: Floats
    covariance: Floats
    walked_m: float = 0.0


class Fixes(PredictUpdateFilter[FixesParams, LastFix]):
    """Holds the last fix until the next one comes; motion is not used."""

    name = "fixes"
    source = "Wi-Fi-only baseline of [jiang2015], [sun2013], [wang2015]"
    Params = FixesParams
    State = LastFix

    def begin(self, fix: Fix, rng: Rng) -> LastFix:  # noqa: ARG002
        """Stand at the fix."""
        return LastFix(fix.floor, fix.xy, fix.covariance)

    def predict(self, state: LastFix, motion: Motion, rng: Rng) -> LastFix:  # noqa: ARG002
        """Stay, less surely."""
        walked_m = self.params.speed_mps * (motion.t1_ns - motion.t0_ns) * 1e-9
        return LastFix(state.floor, state.xy, state.covariance, state.walked_m + walked_m)

    def update(self, state: LastFix, fix: Fix, rng: Rng) -> tuple[LastFix, Report]:
        """Stand at the new fix."""
        innovation_m = float(np.hypot(*(fix.xy - state.xy))) if fix.floor == state.floor else None
        return self.begin(fix, rng), Report(used=1, innovation_m=innovation_m)

    def estimate(self, state: LastFix) -> Belief:
        """Say where the fix was."""
        return Belief(floor=state.floor, xy=state.xy, covariance=state.covariance + 0.5 * state.walked_m**2 * np.eye(2))
