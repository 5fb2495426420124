"""Particle sets: weights in log space, effective sample size, resampling, spatial median, and normal noise for many
sets in one call. Sets of N particles may stand side by side, in the last axis; each gives the same bits as if computed
on its own. Sources: [arulampalam2002] Arulampalam et al., "A tutorial on particle filters for online nonlinear/non-
Gaussian Bayesian tracking", IEEE Trans. Signal Processing 50 (2002); [box1958] Box and Muller, "A note on the
generation of random normal deviates", Ann. Math. Statist. 29 (1958).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tickfix.api import Floats, Ints, Rng

_WEISZFELD_ITERATIONS: Final = 8
_MIN_DISTANCE_M: Final = np.float32(0.3)  # closer than this, the pull of a particle grows no further


def normalise_log_weights(log_weights: Floats) -> Floats:
    """Return weights (…, N) that sum to one; all alike where every one of them is zero."""
    highest = np.maximum.reduce(log_weights, axis=-1, keepdims=True)
    all_zero = highest == -np.inf
    if all_zero.any():
        log_weights, highest = np.where(all_zero, 0.0, log_weights), np.where(all_zero, 0.0, highest)
    weights: Floats = np.exp(log_weights - highest)
    weights /= np.add.reduce(weights, axis=-1, keepdims=True)
    return weights


def effective_sample_size(weights: Floats) -> Floats:
    """Return 1/Σw² (…), [arulampalam2002] eq. (51): how many particles the weights (…, N) leave."""
    number: Floats = 1.0 / np.add.reduce(weights * weights, axis=-1)
    return number


def systematic_resample(weights: Floats, rng: Rng) -> Ints:
    """Return N indices drawn in proportion to ``weights`` (N,) with one random number, [arulampalam2002] alg. 2."""
    n = len(weights)
    cumulative = np.cumsum(weights)
    cumulative[-1] = 1.0  # rounding must not leave the last comb tooth without a particle
    return np.searchsorted(cumulative, (np.arange(n) + rng.random()) / n).astype(np.int64)


def weighted_mean(weights: Floats, values: Floats) -> Floats:
    """Return Σ w·v (…) of each set, weights and values (…, N).

    Not by a matrix product: how BLAS adds depends on how many sets there are.
    """
    mean: Floats = np.add.reduce(weights * values, axis=-1)
    return mean


def spatial_median(x: Floats, y: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Return about the point (…) with the least mean distance from (x, y), by a few of Weiszfeld's iterations from 0.

    Where the particles stand in two crowds the mean lies between them, where nobody is; this lies in the larger.

    Args:
        x, y, weights: (…, N); places around their mean, since single precision is enough for them then.
    """
    # One array of x, y and 1, so that one product and one sum give all that an iteration needs.
    parts = np.empty((3, *x.shape), np.float32)
    parts[0], parts[1], parts[2] = x, y, 1.0
    weights = weights.astype(np.float32)
    median = np.zeros((2, *x.shape[:-1], 1), np.float32)
    for _ in range(_WEISZFELD_ITERATIONS):
        off = parts[:2] - median
        off *= off
        distance = off[0]
        distance += off[1]
        np.sqrt(distance, out=distance)
        np.maximum(distance, _MIN_DISTANCE_M, out=distance)
        pulled = np.add.reduce(parts * (weights / distance), axis=-1, keepdims=True)
        median = pulled[:2] / pulled[2]
    return median[0, ..., 0].astype(np.float64), median[1, ..., 0].astype(np.float64)


_PI_2 = np.float32(2.0 * np.pi)


def normal_pairs(rngs: Sequence[Rng], n: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return two arrays (D, n) float32 of independent standard normal numbers, row d from ``rngs[d]``."""
    uniform = np.empty((2, len(rngs), n), np.float32)
    for d, rng in enumerate(rngs):
        rng.random(out=uniform[0, d], dtype=np.float32)
        rng.random(out=uniform[1, d], dtype=np.float32)
    radius = np.log(1.0 - uniform[0])
    radius *= -2.0
    np.sqrt(radius, out=radius)
    angle = _PI_2 * uniform[1]
    return radius * np.cos(angle), radius * np.sin(angle)
