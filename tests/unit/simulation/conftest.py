"""One office and one perfect walk through it, shared by the tests."""

from __future__ import annotations

import numpy as np
import pytest

from tickfix.simulation import (
    Building,
    Magnetism,
    PhoneHold,
    SimulatedWalk,
    WalkableGrid,
    Walker,
    office_building,
    perfect_phone,
    random_route,
    simulate_walk,
    walkable_grid,
)

NORTH_RAD = 0.3


@pytest.fixture(scope="session")
def building() -> Building:
    """An office of one floor in an undisturbed field whose north is not the map's."""
    magnetism = Magnetism(north_rad=NORTH_RAD, disturbance_ut=0.0)
    return office_building(np.random.default_rng(7), width_m=48.0, height_m=30.0, access_points=12, magnetism=magnetism)


@pytest.fixture(scope="session")
def grid(building: Building) -> WalkableGrid:
    """Where one can walk in it."""
    return walkable_grid(building.floors[0])


@pytest.fixture(scope="session")
def perfect(building: Building, grid: WalkableGrid) -> SimulatedWalk:
    """A walk whose phone makes no error and is held still, level with the way walked, pitched by 40°."""
    rng = np.random.default_rng(11)
    walker = Walker(hold=PhoneHold(pitch_rad=0.7, sway_rad=0.0, wander_rad=0.0), pauses_per_m=0.03, swing_jitter=0.0)
    route = random_route(grid, rng, 70.0)
    return simulate_walk(building, route, rng, name="perfect", walker=walker, phone=perfect_phone())
