"""Error model of position fixes.

Heavy-tailed, correlated in time, and now and then on the wrong floor. Normalised errors are a first-order Gauss-Markov
process plus a white part, ρ(Δt) = error_correlation · exp(-Δt / correlation_time_s); modelling that correlation is the
measurement differencing of [bryson1968] Bryson and Henrikson, "Estimation using sampled data containing sequentially
correlated noise", J. Spacecraft and Rockets 5 (1968). A filter changes floor only after several fixes in a row agree on
the other one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final

from tickfix.api import Fix, parameter


@dataclass(frozen=True)
class FixErrorParams:
    """Parameters of the model, shared by the filters that use fixes."""

    correlation_time_s: Annotated[
        float, parameter("time over which errors of fixes are alike", unit="s", gt=0, formerly="correlation_s")
    ] = 5.0
    error_correlation: Annotated[
        float, parameter("share of the error's variance that has a memory", ge=0, lt=1, formerly="remembered")
    ] = 0.8
    student_t_dof: Annotated[
        float, parameter("degrees of freedom ν of Student's t for the errors", gt=0, formerly="freedom")
    ] = 4.0

    def correlation(self, fix: Fix, previous_ns: int) -> float:
        """Return ρ between the errors of ``fix`` and of the one at ``previous_ns``."""
        return self.error_correlation * math.exp(-abs(fix.t_ns - previous_ns) * 1e-9 / self.correlation_time_s)


def sigma_per_axis_m(fix: Fix) -> float:
    """Return σ of ``fix``, metres per axis."""
    (xx, _), (_, yy) = fix.covariance.tolist()
    return math.sqrt(0.5 * (xx + yy))


_FIXES_TO_CHANGE_FLOOR: Final = 3


@dataclass(frozen=True, slots=True)
class FloorHysteresis:
    """The current floor, and how often in a row another one was observed."""

    floor: str
    candidate: str = ""
    candidate_fixes: int = 0

    def observe(self, floor: str) -> FloorHysteresis:
        """Return the hysteresis after a fix on ``floor``; three in a row on another floor change it."""
        if floor == self.floor:
            return FloorHysteresis(self.floor)
        candidate_fixes = self.candidate_fixes + 1 if floor == self.candidate else 1
        return (
            FloorHysteresis(floor)
            if candidate_fixes >= _FIXES_TO_CHANGE_FLOOR
            else FloorHysteresis(self.floor, floor, candidate_fixes)
        )
