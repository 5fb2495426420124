"""Surveys and sets of walks: who walks where, with which phone, when."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tickfix.api import Rng
from tickfix.simulation.building import Building
from tickfix.simulation.people import Walker, draw_walker
from tickfix.simulation.phone import Phone, draw_phone
from tickfix.simulation.recording import START_NS, Logging, SimulatedWalk, simulate_walk
from tickfix.simulation.routes import Route, random_route, survey_routes
from tickfix.simulation.scanning import Receiver, draw_receiver
from tickfix.simulation.walkable import walkable

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
    logging: Logging | None = None,
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
    who, walk_rng = rng.spawn(2)
    walker, phone, receiver = walker or draw_walker(who), phone or draw_phone(who), receiver or draw_receiver(who)
    routes = survey_routes(walkable(building.floor(floor)), spacing_m, length_m)
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
    logging: Logging | None = None,
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
    ground = None if routes is not None else walkable(building.floor(floor))
    for i, walk_rng in enumerate(rng.spawn(count if routes is None else len(routes))):
        who, way, way_rng = walk_rng.spawn(3)
        if routes is not None:
            route = routes[i]
        elif ground is not None:
            route = random_route(ground, way, length_m)
        walk = simulate_walk(
            building,
            route,
            way_rng,
            name=f"walk-{floor}-{i + 1:02d}",
            walker=draw_walker(who),
            phone=draw_phone(who),
            receiver=draw_receiver(who),
            logging=logging,
            start_ns=start_ns,
        )
        start_ns = int(walk.t_ns[-1]) + _BREAK_NS
        yield walk
