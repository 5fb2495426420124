"""The magnetic field inside a building: the earth's, bent by steel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tickfix.api import Floats, Rng
from tickfix.simulation.fields import RandomField, draw_field


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
