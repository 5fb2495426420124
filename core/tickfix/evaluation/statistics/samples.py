"""Errors of two pipelines at the same points, and the chains of walks that the points come from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tickfix.api import Bools, Floats, Ints, frozen


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Paired:
    """Two pipelines at n points.

    Points of one walk depend on each other, and so do walks that followed each other without a break; chains of walks
    are what is drawn and flipped as a whole.

    Attributes:
        baseline_m, pipeline_m: (n,) float64, errors, all finite.
        walk, chain: (n,) int64, numbers of the walk and of its chain, from 0 on, none left out.
    """

    baseline_m: Floats
    pipeline_m: Floats
    walk: Ints
    chain: Ints

    def __post_init__(self) -> None:
        """Freeze the arrays.

        Raises:
            ValueError: when lengths differ or an error is not finite.
        """
        for name in ("baseline_m", "pipeline_m"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        for name in ("walk", "chain"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.int64))
        lengths = {len(self.baseline_m), len(self.pipeline_m), len(self.walk), len(self.chain)}
        if len(lengths) > 1:
            raise ValueError(f"found {sorted(lengths)} values, expected as many of each")
        if not (np.isfinite(self.baseline_m).all() and np.isfinite(self.pipeline_m).all()):
            raise ValueError("found an error that is not finite; compare only where both pipelines have an estimate")

    def __len__(self) -> int:
        """Return n."""
        return len(self.baseline_m)

    @property
    def walks(self) -> int:
        """Number of walks."""
        return int(self.walk.max()) + 1 if len(self) else 0

    @property
    def chains(self) -> int:
        """Number of chains."""
        return int(self.chain.max()) + 1 if len(self) else 0

    @property
    def identical(self) -> bool:
        """Whether the two never differ."""
        return bool(np.array_equal(self.baseline_m, self.pipeline_m))


def numbered(labels: Bools | Ints | list[str]) -> Ints:
    """Return for each label (n,) its number in sorted order: (n,) int64."""
    if len(labels) == 0:
        return np.zeros(0, np.int64)
    _, numbers = np.unique(np.asarray(labels), return_inverse=True)
    return np.asarray(numbers.reshape(-1), dtype=np.int64)
