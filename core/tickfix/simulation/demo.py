"""The building, the survey and the walks of ``tickfix demo``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tickfix.simulation.building import Building, office_building
from tickfix.simulation.campaign import simulate_survey, simulate_walks
from tickfix.simulation.magnetism import Magnetism
from tickfix.simulation.recording import START_NS, SimulatedWalk

_DAY_NS = 86_400_000_000_000


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Demo:
    """A small office, surveyed by one person, walked a day later by others with other phones.

    Attributes:
        building: one floor, F1.
        survey: walks that cover it.
        walks: to be tracked.
    """

    building: Building
    survey: tuple[SimulatedWalk, ...]
    walks: tuple[SimulatedWalk, ...]


def demo_building(seed: int = 0) -> Building:
    """Return the demo's office, one floor of 48 m × 30 m."""
    return office_building(
        np.random.default_rng([seed, 0]),
        width_m=48.0,
        height_m=30.0,
        access_points=18,
        magnetism=Magnetism(north_rad=np.radians(12.0)),
    )


def demo(seed: int = 0) -> Demo:
    """Return the demo; the same seed gives the same bytes."""
    building = demo_building(seed)
    surveyed = tuple(simulate_survey(building, "F1", np.random.default_rng([seed, 1]), length_m=45.0))
    later = START_NS + _DAY_NS
    walked = tuple(simulate_walks(building, "F1", np.random.default_rng([seed, 2]), count=5, start_ns=later))
    return Demo(building=building, survey=surveyed, walks=walked)
