"""Whether uncertainty keeps its promise: NEES, and the regions that should hold the truth as often as they say."""

from __future__ import annotations

import math
from functools import cache
from typing import Final

import numpy as np

from tickfix.api import Belief, Component, Floats

LEVELS: Final = (0.50, 0.90, 0.95)
"""Contents of the regions that are reported."""

_LEAST_VARIANCE_M2: Final = 1e-6
_POINTS: Final = 512


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
        points = component.xy + _spiral() @ _root(component.covariance).T
        above.append(float(np.mean(_density(belief.mixture, component.floor, points) > here)))
    return float(np.clip(weights @ np.array(above) / weights.sum(), 0.0, 1.0))


def _mahalanobis(mean: Floats, covariance: Floats, xy: Floats) -> float:
    variance, directions = np.linalg.eigh(covariance)
    along = (xy - mean) @ directions
    return float(np.sum(along**2 / np.maximum(variance, _LEAST_VARIANCE_M2)))


def _density(mixture: tuple[Component, ...], floor: str, xy: Floats) -> Floats:
    """Return (n,) the weighted densities of the components on ``floor`` at places (n, 2)."""
    total = np.zeros(len(xy))
    for component in mixture:
        if component.floor != floor:
            continue
        variance, directions = np.linalg.eigh(component.covariance)
        variance = np.maximum(variance, _LEAST_VARIANCE_M2)
        squared = (((xy - component.xy) @ directions) ** 2 / variance).sum(axis=1)
        total += component.weight * np.exp(-squared / 2.0) / (2.0 * np.pi * math.sqrt(variance.prod()))
    return total


def _root(covariance: Floats) -> Floats:
    variance, directions = np.linalg.eigh(covariance)
    return np.asarray(directions * np.sqrt(np.maximum(variance, _LEAST_VARIANCE_M2)))


@cache
def _spiral() -> Floats:
    """Return (512, 2) points spread like a standard Gaussian: equal shares each, turned by the golden angle."""
    share = (np.arange(_POINTS) + 0.5) / _POINTS
    radius = np.sqrt(-2.0 * np.log1p(-share))
    angle = np.arange(_POINTS) * np.pi * (3.0 - math.sqrt(5.0))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
