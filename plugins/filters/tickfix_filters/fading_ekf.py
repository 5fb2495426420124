"""Filter ``fading-ekf``: WPO, the fading-factor extended Kalman filter of [wang2015] section 4.

The equations are in :mod:`tickfix_filters.fading`, which ``map-pf`` runs as well. Here are the floors, and what is
told: between fixes the place is dead reckoned from the last one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from tickfix.api import Belief, Fix, Motion, PredictUpdateFilter, Preset, Report, Rng
from tickfix_filters.fading import Fading, begin, carry, correct, course, extrapolated
from tickfix_filters.fading_params import FadingParams
from tickfix_filters.floors import OnFloor


@dataclass(frozen=True)
class FadingEkfParams(FadingParams):
    """Parameters of ``fading-ekf``."""


@dataclass(frozen=True, slots=True)
class OnFloorFading:
    """The filter's state and the floor it is on."""

    on: OnFloor
    ekf: Fading


class FadingEkf(PredictUpdateFilter[FadingEkfParams, OnFloorFading]):
    """Fixes, pseudo-odometry and heading in an extended Kalman filter that trusts the past less when it erred."""

    name = "fading-ekf"
    source = "[wang2015] section 4, eqs. (8)–(22); [zhou1996] for the residuals' covariance"
    Params = FadingEkfParams
    State = OnFloorFading
    presets: ClassVar[Mapping[str, Preset]] = {
        "wang2015": Preset(
            source="[wang2015] section 4, eq. (22) as printed",
            values={"delta_s_m": 3.0, "reject_go_and_back": False, "fading": "trace"},
        ),
        "wang2015-reject": Preset(
            source="[wang2015] section 4.3, the text after eq. (22)",
            values={"delta_s_m": 3.0, "reject_go_and_back": True, "fading": "trace"},
        ),
    }

    def begin(self, fix: Fix, rng: Rng) -> OnFloorFading:  # noqa: ARG002
        """Stand at the fix."""
        return OnFloorFading(OnFloor(fix.floor), begin(fix.xy, fix.covariance, self.params))

    def predict(self, state: OnFloorFading, motion: Motion, rng: Rng) -> OnFloorFading:  # noqa: ARG002
        """Carry the motion until the next fix."""
        return replace(state, ekf=carry(state.ekf, motion))

    def update(self, state: OnFloorFading, fix: Fix, rng: Rng) -> tuple[OnFloorFading, Report]:
        """Predict to this instant and correct."""
        on = state.on.observe(fix.floor)
        if on.floor != state.on.floor:
            return self.begin(fix, rng), Report(used=1, reasons=("changed floor",))
        if fix.floor != on.floor:
            return replace(state, on=on), Report(gated=1, reasons=("fix on another floor",))
        ekf, outcome = correct(state.ekf, fix.xy, fix.covariance, self.params)
        return OnFloorFading(on, ekf), outcome.report

    def estimate(self, state: OnFloorFading) -> Belief:
        """Say the place, dead reckoned since the last fix."""
        xy, covariance = extrapolated(state.ekf, self.params)
        speed_mps, heading_rad = course(state.ekf)
        return Belief(floor=state.on.floor, xy=xy, covariance=covariance, speed_mps=speed_mps, heading_rad=heading_rad)
