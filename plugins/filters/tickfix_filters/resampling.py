"""Weights of particles, kept as logarithms, and resampling. Model: [arulampalam2002] A Tutorial on Particle Filters."""

from __future__ import annotations

import numpy as np

from tickfix.api import Floats, Ints, Rng


def normalised(log_weights: Floats) -> Floats:
    """Return weights (N,) that sum to one; all alike where every one of them is zero."""
    highest = log_weights.max()
    if highest == -np.inf:
        return np.full(len(log_weights), 1.0 / len(log_weights))
    weights: Floats = np.exp(log_weights - highest)
    return weights / weights.sum()


def effective_number(weights: Floats) -> float:
    """Return 1/Σw², [arulampalam2002] eq. (51): how many particles the weights leave."""
    return 1.0 / float(weights @ weights)


def systematic(weights: Floats, rng: Rng) -> Ints:
    """Return N indices drawn in proportion to ``weights`` (N,) with a single random number, [arulampalam2002] alg. 2."""
    n = len(weights)
    cumulative = np.cumsum(weights)
    cumulative[-1] = 1.0  # rounding must not leave the last comb tooth without a particle
    return np.searchsorted(cumulative, (np.arange(n) + rng.random()) / n).astype(np.int64)
