"""How many walks it would take."""

from __future__ import annotations

import math
from typing import Final

from scipy import stats

LEVEL: Final = 0.05
POWER: Final = 0.80
_REACH: Final = float(stats.norm.ppf(1.0 - LEVEL / 2.0) + stats.norm.ppf(POWER))


def detectable_m(standard_error_m: float) -> float:
    """Return the difference that walks with this standard error would have shown four times out of five, metres."""
    return _REACH * standard_error_m


def walks_needed(walks: int, standard_error_m: float, difference_m: float) -> int | None:
    """Return how many walks like these would show ``difference_m``: at the 5 % level, with a power of 80 %.

    n · ((z₀.₉₇₅ + z₀.₈₀) · SE / |d|)², since a standard error falls with the root of their number. None for a
    difference of 0, which no number of walks shows.
    """
    if difference_m == 0.0:
        return None
    return math.ceil(walks * (detectable_m(standard_error_m) / abs(difference_m)) ** 2)
