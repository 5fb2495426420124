"""The figures that describe a set of errors."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from tickfix.api import Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Figures of n horizontal errors, metres; all but ``n`` are None when there are none.

    Percentiles interpolate linearly between order statistics: of the sorted errors e_0 … e_{n−1} the q-th is the value
    at index q/100·(n−1) (definition 7 of Hyndman and Fan, *Sample quantiles in statistical packages*, 1996).

    Attributes:
        n: number of errors.
        mean_m, median_m, p75_m, p90_m, p95_m, max_m: as named.
        rmse_m: root of the mean of the squares.
    """

    n: int
    mean_m: float | None = None
    median_m: float | None = None
    p75_m: float | None = None
    p90_m: float | None = None
    p95_m: float | None = None
    max_m: float | None = None
    rmse_m: float | None = None

    @staticmethod
    def of(errors_m: Floats) -> Figures:
        """Return the figures of errors (n,), all finite.

        Raises:
            ValueError: when one of them is not finite.
        """
        if not np.isfinite(errors_m).all():
            raise ValueError("errors_m: found a value that is not finite; score only waypoints that have an estimate")
        if len(errors_m) == 0:
            return Figures(n=0)
        median, p75, p90, p95 = (float(q) for q in np.percentile(errors_m, [50, 75, 90, 95]))
        return Figures(
            n=len(errors_m),
            mean_m=float(np.mean(errors_m)),
            median_m=median,
            p75_m=p75,
            p90_m=p90,
            p95_m=p95,
            max_m=float(np.max(errors_m)),
            rmse_m=float(np.sqrt(np.mean(np.square(errors_m)))),
        )

    def as_json(self) -> dict[str, float | int | None]:
        """Return the figures by name."""
        return asdict(self)
