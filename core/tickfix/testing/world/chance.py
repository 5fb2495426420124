"""The world's randomness, the same every time."""

from __future__ import annotations

import numpy as np

from tickfix.api import Rng


def rng(*key: int) -> Rng:
    """Return the random stream of a key, as the kernel gives each tick its own."""
    return np.random.default_rng([20_240_601, *key])
