"""A paired test: if two pipelines were equally good, swapping them on any chain would change nothing but chance."""

from __future__ import annotations

from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tickfix.api import Ints, Rng
from tickfix.evaluation.statistics.quantities import Counts, Quantity
from tickfix.evaluation.statistics.samples import Paired

PERMUTATIONS: Final = 9999
_EXACT_CHAINS: Final = 12


def p_value(paired: Paired, quantity: Quantity, rng: Rng, *, permutations: int = PERMUTATIONS) -> float:
    """Return the two-sided p-value of the difference under swaps of the two pipelines, chain by chain.

    With up to 12 chains every swap is tried and p is the share of those whose difference is as great; beyond that
    ``permutations`` are drawn and p is (1 + as great) / (1 + drawn), which never is 0: B. Phipson
    and G. Smyth, *Permutation p-values should never be zero* (2010).
    """
    if len(paired) == 0 or paired.identical:
        return 1.0
    c = paired.chains
    exact = c <= _EXACT_CHAINS
    swaps = _every(c) if exact else rng.integers(0, 2, size=(permutations, c), dtype=np.int8)
    both = np.concatenate([paired.pipeline_m, paired.baseline_m])
    chain = np.concatenate([paired.chain, paired.chain + c])
    differences = _differences(both, chain, swaps, quantity)
    observed = _differences(both, chain, np.zeros((1, c), dtype=np.int8), quantity)[0]
    # Equal differences may differ in their last bits.
    as_great = int(np.sum(np.abs(differences) >= abs(observed) * (1.0 - 1e-9)))
    return as_great / len(swaps) if exact else (1 + as_great) / (1 + permutations)


def _every(chains: int) -> Counts:
    return np.array(list(product((0, 1), repeat=chains)), dtype=np.int8)


def _differences(both: NDArray[np.float64], chain: Ints, swaps: Counts, quantity: Quantity) -> NDArray[np.float64]:
    kept = 1 - swaps
    one = quantity.of(both, chain, np.concatenate([kept, swaps], axis=1))
    return np.asarray(one - quantity.of(both, chain, np.concatenate([swaps, kept], axis=1)))
