"""Correction for many comparisons."""

from __future__ import annotations

from collections.abc import Sequence


def holm(p_values: Sequence[float]) -> tuple[float, ...]:
    """Return the p-values adjusted by Holm's step-down rule, in their order.

    Sorted p_(1) ≤ … ≤ p_(m) become max over j ≤ i of min(1, (m − j + 1) p_(j)): deciding by them at 5 % claims a
    difference where there is none in at most 5 % of all families of comparisons, however the comparisons depend on
    each other. S. Holm, *A simple sequentially rejective multiple test procedure* (1979).
    """
    m = len(p_values)
    adjusted = [0.0] * m
    least = 0.0
    for rank, i in enumerate(sorted(range(m), key=lambda i: p_values[i])):
        least = max(least, min(1.0, (m - rank) * p_values[i]))
        adjusted[i] = least
    return tuple(adjusted)
