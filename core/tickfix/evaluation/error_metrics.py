"""Metrics of errors at truth samples.

Summary statistics, circular error, IPIN score, NEES and credible regions, errors by bins. docs/metrics.md has formula
and source of each.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from functools import cache
from typing import Final

import numpy as np

from tickfix.api import Belief, Bools, Component, Floats, Ints


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorStatistics:
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
    def of(errors_m: Floats) -> ErrorStatistics:
        """Return the figures of errors (n,), all finite.

        Raises:
            ValueError: when one of them is not finite.
        """
        if not np.isfinite(errors_m).all():
            raise ValueError("errors_m: found a value that is not finite; score only waypoints that have an estimate")
        if len(errors_m) == 0:
            return ErrorStatistics(n=0)
        median, p75, p90, p95 = (float(q) for q in np.percentile(errors_m, [50, 75, 90, 95]))
        return ErrorStatistics(
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


def circular_error(error_m: Floats, share: float) -> float | None:
    """Return the radius of the smallest circle around the truth that held ``share`` of the estimates, None of none.

    It is the order statistic e_(⌈share·n⌉), an error that occurred: CE50 and CE95 of ISO/IEC 18305 for 0.5 and 0.95.
    Unlike the median and p95 of :class:`~tickfix.evaluation.error_metrics.ErrorStatistics` nothing is interpolated.
    """
    if len(error_m) == 0:
        return None
    # Without the margin 0.95 · 20 = 19.000000000000004 would ask for the 20th of 20.
    rank = max(1, math.ceil(share * len(error_m) - 1e-9))
    return float(np.sort(error_m)[rank - 1])


def floor_probability(floor_right: Bools) -> float | None:
    """Return the floor detection probability: the share of estimates on the right floor, None of none."""
    return float(np.mean(floor_right)) if len(floor_right) else None


FLOOR_PENALTY_M: Final = 15.0


def penalised_errors(error_m: Floats, storeys_off: Ints) -> Floats:
    """Return (n,) e + 15 m · |storeys off| [potorti2017]."""
    return np.asarray(error_m + FLOOR_PENALTY_M * storeys_off)


REGION_LEVELS: Final = (0.50, 0.90, 0.95)
"""Contents of the regions that are reported."""

_MIN_VARIANCE_M2: Final = 1e-6
_QUADRATURE_POINTS: Final = 512


def nees(belief: Belief, floor: str, xy: Floats) -> float:
    """Return the normalised estimation error squared (x − x̂)ᵀ P⁻¹ (x − x̂) of the truth ``xy`` (2,) on ``floor``.

    [barshalom2001] section 5.4. Under an honest Gaussian it is χ² with 2 degrees of freedom: mean 2, median 2 ln 2.
    NaN where the floor is wrong. Variances count as at least (1 mm)², so that a claim of perfection stays finite.
    """
    return math.nan if belief.floor != floor else _mahalanobis(belief.xy, belief.covariance, xy)


def ellipse_level(nees_values: Floats) -> Floats:
    """Return (n,) the content 1 − exp(−NEES/2) of the smallest ellipse around the mean that reaches the truth.

    1 where NEES is NaN: a truth on another floor lies in no ellipse.
    """
    level = -np.expm1(-np.asarray(nees_values) / 2.0)
    return np.asarray(np.where(np.isnan(nees_values), 1.0, level))


def density_level(belief: Belief, floor: str, xy: Floats) -> float:
    """Return the content of the smallest highest-density region that reaches the truth ``xy`` (2,) on ``floor``.

    It is P(f(X) > f(truth)) for X of the belief with density f over floors and places [hyndman1996]: the truth lies in
    the region of content p if and only if this is ≤ p. For one Gaussian the region is the ellipse. For a mixture the
    probability is a sum over 512 points per component, laid out on a spiral instead of drawn.
    """
    if not belief.mixture:
        return float(ellipse_level(np.array([nees(belief, floor, xy)]))[0])
    weights = np.array([component.weight for component in belief.mixture])
    here = _density(belief.mixture, floor, xy[np.newaxis])[0]
    above = []
    for component in belief.mixture:
        points = component.xy + _quadrature_points() @ _covariance_root(component.covariance).T
        above.append(float(np.mean(_density(belief.mixture, component.floor, points) > here)))
    return float(np.clip(weights @ np.array(above) / weights.sum(), 0.0, 1.0))


def _mahalanobis(mean: Floats, covariance: Floats, xy: Floats) -> float:
    variance, directions = np.linalg.eigh(covariance)
    along = (xy - mean) @ directions
    return float(np.sum(along**2 / np.maximum(variance, _MIN_VARIANCE_M2)))


def _density(mixture: tuple[Component, ...], floor: str, xy: Floats) -> Floats:
    """Return (n,) the weighted densities of the components on ``floor`` at places (n, 2)."""
    total = np.zeros(len(xy))
    for component in mixture:
        if component.floor != floor:
            continue
        variance, directions = np.linalg.eigh(component.covariance)
        variance = np.maximum(variance, _MIN_VARIANCE_M2)
        squared = (((xy - component.xy) @ directions) ** 2 / variance).sum(axis=1)
        total += component.weight * np.exp(-squared / 2.0) / (2.0 * np.pi * math.sqrt(variance.prod()))
    return total


def _covariance_root(covariance: Floats) -> Floats:
    variance, directions = np.linalg.eigh(covariance)
    return np.asarray(directions * np.sqrt(np.maximum(variance, _MIN_VARIANCE_M2)))


@cache
def _quadrature_points() -> Floats:
    """Return (512, 2) points spread like a standard Gaussian: equal shares each, turned by the golden angle."""
    share = (np.arange(_QUADRATURE_POINTS) + 0.5) / _QUADRATURE_POINTS
    radius = np.sqrt(-2.0 * np.log1p(-share))
    angle = np.arange(_QUADRATURE_POINTS) * np.pi * (3.0 - math.sqrt(5.0))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BinnedErrors:
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


def bin_errors(abscissa: Floats, error_m: Floats, width: float) -> BinnedErrors:
    """Return mean and third quartile of finite errors (n,) by bins of ``width`` of their ``abscissa`` (n,) ≥ 0."""
    bins = np.floor(np.asarray(abscissa) / width).astype(np.int64)
    kept = np.unique(bins)
    groups = [error_m[bins == b] for b in kept]
    return BinnedErrors(
        middle=np.asarray((kept + 0.5) * width, dtype=np.float64),
        mean_m=np.array([float(np.mean(group)) for group in groups]),
        p75_m=np.array([float(np.percentile(group, 75)) for group in groups]),
        n=np.array([len(group) for group in groups], dtype=np.int64),
    )
