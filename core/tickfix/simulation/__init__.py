"""A seeded simulator: buildings, people who walk in them, and the phones they hold.

It is what the demo and the tests run on, and the base of twins of real sites: declare floors and access points, choose
settings, walk routes. Everything is drawn from the generator passed in; the same seed gives the same bytes.
"""

from tickfix.simulation.building import Building, build, office_building, place_access_points
from tickfix.simulation.campaign import simulate_survey, simulate_walks
from tickfix.simulation.demo import Demo, demo, demo_building
from tickfix.simulation.magnetism import MagneticField, Magnetism
from tickfix.simulation.people import Hold, Walker, draw_walker
from tickfix.simulation.phone import Phone, draw_phone, perfect_phone
from tickfix.simulation.plans import declare_floor, office_floor, rectangle, wall, walls_around
from tickfix.simulation.radio import AccessPoint, Propagation, Radio
from tickfix.simulation.recording import START_NS, Logging, SimulatedWalk, simulate_walk
from tickfix.simulation.routes import Route, random_route, route_through, survey_routes
from tickfix.simulation.scanning import Heard, Receiver, draw_receiver
from tickfix.simulation.standing import simulate_stand
from tickfix.simulation.walkable import Walkable, walkable
from tickfix.simulation.walker import Steps, Trajectory, walk

__all__ = [
    "START_NS",
    "AccessPoint",
    "Building",
    "Demo",
    "Heard",
    "Hold",
    "Logging",
    "MagneticField",
    "Magnetism",
    "Phone",
    "Propagation",
    "Radio",
    "Receiver",
    "Route",
    "SimulatedWalk",
    "Steps",
    "Trajectory",
    "Walkable",
    "Walker",
    "build",
    "declare_floor",
    "demo",
    "demo_building",
    "draw_phone",
    "draw_receiver",
    "draw_walker",
    "office_building",
    "office_floor",
    "perfect_phone",
    "place_access_points",
    "random_route",
    "rectangle",
    "route_through",
    "simulate_stand",
    "simulate_survey",
    "simulate_walk",
    "simulate_walks",
    "survey_routes",
    "walk",
    "walkable",
    "wall",
    "walls_around",
]
