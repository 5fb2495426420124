"""What a fix is worth when the one before it erred alike.

Errors of successive fixes are correlated: the phone has hardly moved, the walls and the crowd are the same. Taken as a
first-order Gauss–Markov process with correlation ρ between two fixes, a run of them is worth as much as independent
fixes whose covariance is (1 + ρ)/(1 − ρ) times larger.
"""

from __future__ import annotations

import math
from typing import Final

from tickfix.api import Fix, Floats

_MOST: Final = 25.0


def independent_covariance(fix: Fix, previous_ns: int | None, correlation_s: float) -> Floats:
    """Return the covariance (2, 2), m², that lets ``fix`` be used as if its error were independent.

    Args:
        fix: the fix.
        previous_ns: when the last one was used, None for the first.
        correlation_s: time after which the correlation of errors has fallen to 1/e; 0 when they are independent.
    """
    if previous_ns is None or correlation_s <= 0.0:
        return fix.covariance
    rho = math.exp(-abs(fix.t_ns - previous_ns) * 1e-9 / correlation_s)
    inflation = min(_MOST, (1.0 + rho) / max(1.0 - rho, 1e-9))
    return inflation * fix.covariance
