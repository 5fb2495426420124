"""Weights of particles, kept as logarithms, their middle, and resampling.

Sets of N particles may stand side by side, in the last axis; each is treated as if it were alone, to the bit.

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
    """Return weights (…, N) that sum to one; all alike where every one of them is zero."""
    highest = log_weights.max(axis=-1, keepdims=True)
    hopeless = highest == -np.inf
    if hopeless.any():
        log_weights, highest = np.where(hopeless, 0.0, log_weights), np.where(hopeless, 0.0, highest)
    weights: Floats = np.exp(log_weights - highest)
    weights /= weights.sum(axis=-1, keepdims=True)
    return weights


def effective_number(weights: Floats) -> Floats:
    """Return 1/Σw² (…), [arulampalam2002] eq. (51): how many particles the weights (…, N) leave."""
    number: Floats = 1.0 / (weights * weights).sum(axis=-1)
    return number


def systematic(weights: Floats, rng: Rng) -> Ints:
    """Return N indices drawn in proportion to ``weights`` (N,) with one random number, [arulampalam2002] alg. 2."""
    n = len(weights)
    cumulative = np.cumsum(weights)
    cumulative[-1] = 1.0  # rounding must not leave the last comb tooth without a particle
    return np.searchsorted(cumulative, (np.arange(n) + rng.random()) / n).astype(np.int64)


def weighted_mean(weights: Floats, values: Floats) -> Floats:
    """Return Σ w·v (…) of each set, weights and values (…, N).

    Not by a matrix product: how BLAS adds depends on how many sets there are.
    """
    mean: Floats = (weights * values).sum(axis=-1)
    return mean


def spatial_median(x: Floats, y: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Return about the point (…) with the least mean distance from (x, y), by a few of Weiszfeld's iterations from 0.

    Where the particles stand in two crowds the mean lies between them, where nobody is; this lies in the larger.

    Args:
        x, y, weights: (…, N); places around their mean, since single precision is enough for them then.
    """
    x, y, weights = x.astype(np.float32), y.astype(np.float32), weights.astype(np.float32)
    median_x = median_y = np.zeros((*x.shape[:-1], 1), np.float32)
    nearest = np.float32(_NEAREST_M)
    for _ in range(_WEISZFELD_ITERATIONS):
        off_x, off_y = x - median_x, y - median_y
        off_x *= off_x
        off_y *= off_y
        distance = np.sqrt(np.add(off_x, off_y, out=off_x), out=off_x)
        pull = np.divide(weights, np.maximum(distance, nearest, out=distance), out=distance)
        total = pull.sum(axis=-1, keepdims=True)
        median_x = np.multiply(pull, x, out=off_y).sum(axis=-1, keepdims=True) / total
        median_y = np.multiply(pull, y, out=off_y).sum(axis=-1, keepdims=True) / total
    return median_x[..., 0].astype(np.float64), median_y[..., 0].astype(np.float64)
