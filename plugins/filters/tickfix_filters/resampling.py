"""Weights of particles, kept as logarithms, their middle, and resampling.

Source: [arulampalam2002] Arulampalam et al., "A tutorial on particle filters for online nonlinear/non-Gaussian Bayesian
tracking", IEEE Trans. Signal Processing 50 (2002).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from tickfix.api import Floats, Ints, Rng

_WEISZFELD_ITERATIONS: Final = 8
_NEAREST_M: Final = 0.3  # closer than this, the pull of a particle grows no further


def normalised(log_weights: Floats) -> Floats:
    """Return weights (N,) that sum to one; all alike where every one of them is zero."""
    highest = log_weights.max()
    if highest == -np.inf:
        return np.full(len(log_weights), 1.0 / len(log_weights))
    weights: Floats = np.exp(log_weights - highest)
    weights /= weights.sum()
    return weights


def effective_number(weights: Floats) -> float:
    """Return 1/Σw², [arulampalam2002] eq. (51): how many particles the weights leave."""
    return 1.0 / float(weights @ weights)


def systematic(weights: Floats, rng: Rng) -> Ints:
    """Return N indices drawn in proportion to ``weights`` (N,) with one random number, [arulampalam2002] alg. 2."""
    n = len(weights)
    cumulative = np.cumsum(weights)
    cumulative[-1] = 1.0  # rounding must not leave the last comb tooth without a particle
    return np.searchsorted(cumulative, (np.arange(n) + rng.random()) / n).astype(np.int64)


def spatial_median(xy: Floats, weights: Floats, start: Floats) -> Floats:
    """Return about the point (2,) with the least mean distance from ``xy`` (N, 2), by a few of Weiszfeld's iterations.

    Where the particles stand in two crowds the mean lies between them, where nobody is; this lies in the larger.
    """
    point = start
    for _ in range(_WEISZFELD_ITERATIONS):
        pull = weights / np.maximum(np.hypot(xy[:, 0] - point[0], xy[:, 1] - point[1]), _NEAREST_M)
        point = pull @ xy / pull.sum()
    return point
