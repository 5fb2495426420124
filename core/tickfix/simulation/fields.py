"""Stationary Gaussian random fields (random Fourier features), and the magnetic field of a building.

The earth's, disturbed by steel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tickfix.api import Floats, Rng, frozen


@dataclass(frozen=True, slots=True, eq=False)
class RandomField:
    """k independent, stationary Gaussian random functions of a place in d dimensions.

    Each is a sum of f plane waves whose wave vectors are drawn from the spectral density of the wished covariance
    (random Fourier features, Rahimi and Recht 2007): no grid, no interpolation, any place at any time.

    Attributes:
        sigma: standard deviation of every function, in the unit of what it describes.
        waves: (k, f, d) float64, rad/m.
        phases: (k, f) float64, rad.
    """

    sigma: float
    waves: Floats
    phases: Floats

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "waves", frozen(self.waves))
        object.__setattr__(self, "phases", frozen(self.phases))

    def at(self, points: Floats) -> Floats:
        """Return all functions at each point: (…, d) metres → (…, k)."""
        return self.each_at(
            np.broadcast_to(points[..., None, :], (*points.shape[:-1], len(self.phases), points.shape[-1]))
        )

    def each_at(self, points: Floats) -> Floats:
        """Return each function at a point of its own: (…, k, d) metres → (…, k)."""
        angle: Floats = self.phases + sum(points[..., i, None] * self.waves[..., i] for i in range(points.shape[-1]))
        amplitude = self.sigma * np.sqrt(2.0 / self.phases.shape[1])
        total: Floats = amplitude * np.cos(angle).sum(axis=-1)
        return total


def draw_field(
    rng: Rng,
    *,
    functions: int,
    sigma: float,
    length_m: float,
    covariance: Literal["exponential", "gaussian"] = "exponential",
    dimensions: int = 3,
    waves: int = 128,
) -> RandomField:
    """Draw a :class:`RandomField` in which the correlation falls with the distance d between two places.

    Args:
        rng: what is drawn, is drawn from here.
        functions: k.
        sigma: standard deviation.
        length_m: ℓ, the distance at which the correlation has fallen to 1/e (``gaussian``: to exp(−1/2)).
        covariance: ``"exponential"`` exp(−d/ℓ), rough, as Gudmundson (1991) measured for shadowing, or ``"gaussian"``
            exp(−d²/2ℓ²), smooth.
        dimensions: d.
        waves: f; the more, the closer to Gaussian.
    """
    vectors = rng.standard_normal((functions, waves, dimensions)) / length_m
    if covariance == "exponential":
        # exp(−d/ℓ) is the characteristic function of the multivariate Cauchy, a normal over the root of a χ² of one.
        vectors /= np.abs(rng.standard_normal((functions, waves, 1)))
    return RandomField(sigma, vectors, rng.uniform(0.0, 2.0 * np.pi, (functions, waves)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Magnetism:
    """How the field of a building is drawn.

    Attributes:
        intensity_ut: of the earth's field, µT.
        dip_rad: how far it points below the horizon (positive in the northern hemisphere).
        north_rad: heading of magnetic north on the map, clockwise from the map's +y.
        disturbance_ut: standard deviation of each component of the building's own field, µT.
        length_m: over which this field changes: distance at which its correlation is exp(−1/2).
    """

    intensity_ut: float = 48.0
    dip_rad: float = 1.13
    north_rad: float = 0.0
    disturbance_ut: float = 4.0
    length_m: float = 2.5


@dataclass(frozen=True, slots=True, eq=False)
class MagneticField:
    """The field of one building, east-north-up along the map's axes, µT."""

    settings: Magnetism
    disturbance: RandomField

    def at(self, points: Floats) -> Floats:
        """Return the field (n, 3) in µT at places (n, 3) in metres."""
        s = self.settings
        level = s.intensity_ut * np.cos(s.dip_rad)
        earth = [level * np.sin(s.north_rad), level * np.cos(s.north_rad), -s.intensity_ut * np.sin(s.dip_rad)]
        field: Floats = self.disturbance.at(points) + np.array(earth)
        return field


def draw_magnetic_field(settings: Magnetism, rng: Rng) -> MagneticField:
    """Draw the disturbance of a building; it is smooth, since its sources stand a metre and more away."""
    disturbance = draw_field(
        rng, functions=3, sigma=settings.disturbance_ut, length_m=settings.length_m, covariance="gaussian", waves=64
    )
    return MagneticField(settings, disturbance)
