"""Errors against something that grows during a walk: time since the start, way walked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tickfix.api import Floats, Ints


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Curve:
    """Errors by bins [i·w, (i+1)·w) of the abscissa; bins without errors are left out.

    Attributes:
        middle: (b,) centres of the bins, in the abscissa's unit.
        mean_m, p75_m: (b,) of the errors in each.
        n: (b,) how many.
    """

    middle: Floats
    mean_m: Floats
    p75_m: Floats
    n: Ints


def curve(abscissa: Floats, error_m: Floats, width: float) -> Curve:
    """Return mean and third quartile of finite errors (n,) by bins of ``width`` of their ``abscissa`` (n,) ≥ 0."""
    bins = np.floor(np.asarray(abscissa) / width).astype(np.int64)
    kept = np.unique(bins)
    groups = [error_m[bins == b] for b in kept]
    return Curve(
        middle=np.asarray((kept + 0.5) * width, dtype=np.float64),
        mean_m=np.array([float(np.mean(group)) for group in groups]),
        p75_m=np.array([float(np.percentile(group, 75)) for group in groups]),
        n=np.array([len(group) for group in groups], dtype=np.int64),
    )
