"""A seeded simulator: buildings, people who walk in them, and the phones they hold.

It is what the demo and the tests run on, and the base of twins of real sites: declare floors and access points, choose
settings, walk routes. Everything is drawn from the generator passed in; the same seed gives the same bytes.
"""

from tickfix.simulation.building import Building, assemble_building, office_building, place_access_points
from tickfix.simulation.campaign import DemoScenario, demo_building, simulate_demo, simulate_survey, simulate_walks
from tickfix.simulation.fields import MagneticField, Magnetism
from tickfix.simulation.floor_plans import declare_floor, office_floor, rectangle, wall, walls_around
from tickfix.simulation.pedestrian import PhoneHold, Trajectory, TrueSteps, Walker, draw_walker, walk_route
from tickfix.simulation.phone_sensors import Phone, draw_phone, perfect_phone
from tickfix.simulation.radio_channel import (
    AccessPoint,
    Propagation,
    Radio,
    Receiver,
    SimulatedScan,
    draw_receiver,
    simulate_scans,
)
from tickfix.simulation.routes import (
    Route,
    WalkableGrid,
    random_route,
    round_corners,
    route_through,
    survey_routes,
    walkable_grid,
)
from tickfix.simulation.walk_recording import (
    START_NS,
    LoggingSettings,
    SimulatedWalk,
    simulate_stationary_scans,
    simulate_walk,
)

__all__ = [
    "START_NS",
    "AccessPoint",
    "Building",
    "DemoScenario",
    "LoggingSettings",
    "MagneticField",
    "Magnetism",
    "Phone",
    "PhoneHold",
    "Propagation",
    "Radio",
    "Receiver",
    "Route",
    "SimulatedScan",
    "SimulatedWalk",
    "Trajectory",
    "TrueSteps",
    "WalkableGrid",
    "Walker",
    "assemble_building",
    "declare_floor",
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
    "round_corners",
    "route_through",
    "simulate_demo",
    "simulate_scans",
    "simulate_stationary_scans",
    "simulate_survey",
    "simulate_walk",
    "simulate_walks",
    "survey_routes",
    "walk_route",
    "walkable_grid",
    "wall",
    "walls_around",
]
