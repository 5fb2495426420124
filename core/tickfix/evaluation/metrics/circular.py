"""Circular error and floor detection as in ISO/IEC 18305."""

from __future__ import annotations

import math

import numpy as np

from tickfix.api import Bools, Floats


def circular_error(error_m: Floats, share: float) -> float | None:
    """Return the radius of the smallest circle around the truth that held ``share`` of the estimates, None of none.

    It is the order statistic e_(⌈share·n⌉), an error that occurred: CE50 and CE95 of ISO/IEC 18305 for 0.5 and 0.95.
    Unlike the median and p95 of :class:`~tickfix.evaluation.figures.Figures` nothing is interpolated.
    """
    if len(error_m) == 0:
        return None
    # Without the margin 0.95 · 20 = 19.000000000000004 would ask for the 20th of 20.
    rank = max(1, math.ceil(share * len(error_m) - 1e-9))
    return float(np.sort(error_m)[rank - 1])


def floor_probability(floor_right: Bools) -> float | None:
    """Return the floor detection probability: the share of estimates on the right floor, None of none."""
    return float(np.mean(floor_right)) if len(floor_right) else None
