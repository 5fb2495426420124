"""Surveys and sets of walks (who walks where, with which phone, when), and the scenario of ``tickfix demo``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tickfix.api import Rng
from tickfix.simulation.building import Building, office_building
from tickfix.simulation.fields import Magnetism
from tickfix.simulation.pedestrian import Walker, draw_walker
from tickfix.simulation.phone_sensors import Phone, draw_phone
from tickfix.simulation.radio_channel import Receiver, draw_receiver
from tickfix.simulation.routes import Route, random_route, survey_routes, walkable_grid
from tickfix.simulation.walk_recording import START_NS, LoggingSettings, SimulatedWalk, simulate_walk

_BREAK_NS = 120_000_000_000
"""Between two recordings: longer than the minute within which walks count as one chain."""


def simulate_survey(
    building: Building,
    floor: str,
    rng: Rng,
    *,
    spacing_m: float = 3.0,
    length_m: float = 80.0,
    walker: Walker | None = None,
    phone: Phone | None = None,
    receiver: Receiver | None = None,
    logging: LoggingSettings | None = None,
    start_ns: int = START_NS,
) -> Iterator[SimulatedWalk]:
    """Survey a floor, one walk at a time: corridors and rooms, all walked by one surveyor with one phone.

    Args:
        building, floor: what to survey.
        rng: draws the surveyor and the phone, where not given, and the walks.
        spacing_m: every place is passed within about this distance.
        length_m: of a walk; the next one begins where it ends.
        walker, phone, receiver, logging: settings.
        start_ns: of the first walk; the others follow with breaks.
    """
    person_rng, walk_rng = rng.spawn(2)
    walker, phone, receiver = (
        walker or draw_walker(person_rng),
        phone or draw_phone(person_rng),
        receiver or draw_receiver(person_rng),
    )
    routes = survey_routes(walkable_grid(building.floor(floor)), spacing_m, length_m)
    for i, route in enumerate(routes):
        walk = simulate_walk(
            building,
            route,
            walk_rng.spawn(1)[0],
            name=f"survey-{floor}-{i + 1:02d}",
            walker=walker,
            phone=phone,
            receiver=receiver,
            logging=logging,
            start_ns=start_ns,
        )
        start_ns = int(walk.t_ns[-1]) + _BREAK_NS
        yield walk


def simulate_walks(
    building: Building,
    floor: str,
    rng: Rng,
    *,
    count: int = 5,
    length_m: float = 90.0,
    routes: Sequence[Route] | None = None,
    logging: LoggingSettings | None = None,
    start_ns: int = START_NS,
) -> Iterator[SimulatedWalk]:
    """Send people through a floor, each on a route of their own with a phone of their own.

    Args:
        building, floor: where.
        rng: draws people, phones and routes; the first n walks are the same however many follow.
        count: of walks; ignored where routes are given.
        length_m: of each, at least.
        routes: to walk, instead of random ones.
        logging: settings.
        start_ns: of the first walk; the others follow with breaks.
    """
    grid = None if routes is not None else walkable_grid(building.floor(floor))
    for i, walk_rng in enumerate(rng.spawn(count if routes is None else len(routes))):
        person_rng, route_rng, recording_rng = walk_rng.spawn(3)
        if routes is not None:
            route = routes[i]
        elif grid is not None:
            route = random_route(grid, route_rng, length_m)
        walk = simulate_walk(
            building,
            route,
            recording_rng,
            name=f"walk-{floor}-{i + 1:02d}",
            walker=draw_walker(person_rng),
            phone=draw_phone(person_rng),
            receiver=draw_receiver(person_rng),
            logging=logging,
            start_ns=start_ns,
        )
        start_ns = int(walk.t_ns[-1]) + _BREAK_NS
        yield walk


_DAY_NS = 86_400_000_000_000


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DemoScenario:
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


def simulate_demo(seed: int = 0) -> DemoScenario:
    """Return the demo; the same seed gives the same bytes."""
    building = demo_building(seed)
    surveyed = tuple(simulate_survey(building, "F1", np.random.default_rng([seed, 1]), length_m=45.0))
    later = START_NS + _DAY_NS
    walked = tuple(simulate_walks(building, "F1", np.random.default_rng([seed, 2]), count=5, start_ns=later))
    return DemoScenario(building=building, survey=surveyed, walks=walked)
