"""How the errors of fixes behave: with heavy tails, and with a memory.

A fix errs because the map of signals was learnt with other bodies, doors and crowds around; a few seconds later and a
few metres further, most of that is still so. The normalised error u = (fix − place)/σ is therefore modelled as a
stationary first-order Gauss–Markov process plus a white part: its correlation over a time Δt is

    ρ(Δt) = remembered · exp(−Δt / correlation_s)

Taking errors as independent makes a filter believe ten fixes from one corner more than one; modelling their
correlation is the measurement differencing of [bryson1968] Bryson and Henrikson, "Estimation using sampled data
containing sequentially correlated noise", J. Spacecraft and Rockets 5 (1968).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from tickfix.api import Fix, parameter


@dataclass(frozen=True)
class FixErrorParams:
    """Parameters of the model, shared by the filters that use fixes."""

    correlation_s: Annotated[float, parameter("time over which errors of fixes are alike", unit="s", gt=0)] = 5.0
    remembered: Annotated[float, parameter("share of the error's variance that has a memory", ge=0, lt=1)] = 0.8
    freedom: Annotated[float, parameter("degrees of freedom ν of Student's t for the errors", gt=0)] = 4.0

    def correlation(self, fix: Fix, previous_ns: int) -> float:
        """Return ρ between the errors of ``fix`` and of the one at ``previous_ns``."""
        return self.remembered * math.exp(-abs(fix.t_ns - previous_ns) * 1e-9 / self.correlation_s)


def sigma_m(fix: Fix) -> float:
    """Return σ of ``fix``, metres per axis."""
    (xx, _), (_, yy) = fix.covariance.tolist()
    return math.sqrt(0.5 * (xx + yy))
