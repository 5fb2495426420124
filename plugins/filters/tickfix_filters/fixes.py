"""Filter ``fixes``: where the last fix was. The Wi-Fi-only baseline of all three papers.

With ``map_matching`` the pipeline's map corrects each fix, coming from the one before as it was corrected: the "+ Map"
of [sun2013] Table 4.
"""

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
    map_matching: Annotated[
        bool, parameter("the map corrects each fix", source="[sun2013] figure 1", formerly="matched")
    ] = False


@dataclass(frozen=True, slots=True)
class LastFix:
    """The last fix, and how far one may have walked since."""

    floor: str
    xy: Floats
    covariance: Floats
    possible_walk_m: float = 0.0


class Fixes(PredictUpdateFilter[FixesParams, LastFix]):
    """Holds the last fix until the next one comes; motion is not used."""

    name = "fixes"
    source = "Wi-Fi-only baseline of [jiang2015], [sun2013], [wang2015]"
    Params = FixesParams
    State = LastFix

    def begin(self, fix: Fix, rng: Rng) -> LastFix:  # noqa: ARG002
        """Stand at the fix."""
        return LastFix(fix.floor, self._map_matched(fix, None), fix.covariance)

    def predict(self, state: LastFix, motion: Motion, rng: Rng) -> LastFix:  # noqa: ARG002
        """Stay, less surely."""
        possible_walk_m = self.params.speed_mps * (motion.t1_ns - motion.t0_ns) * 1e-9
        return LastFix(state.floor, state.xy, state.covariance, state.possible_walk_m + possible_walk_m)

    def update(self, state: LastFix, fix: Fix, rng: Rng) -> tuple[LastFix, Report]:
        """Stand at the new fix."""
        if fix.floor != state.floor:
            return self.begin(fix, rng), Report(used=1)
        innovation_m = float(np.hypot(*(fix.xy - state.xy)))
        xy = self._map_matched(fix, state.xy)
        return LastFix(fix.floor, xy, fix.covariance), Report(used=1, innovation_m=innovation_m)

    def estimate(self, state: LastFix) -> Belief:
        """Return the position of the last fix."""
        return Belief(
            floor=state.floor, xy=state.xy, covariance=state.covariance + 0.5 * state.possible_walk_m**2 * np.eye(2)
        )

    def _map_matched(self, fix: Fix, previous: Floats | None) -> Floats:
        """Return U'ₙ for Uₙ, coming from U'ₙ₋₁ = ``previous``."""
        floor_map = self.context.maps.get(fix.floor) if self.params.map_matching else None
        return fix.xy if floor_map is None else floor_map.snap(previous, fix.xy)
