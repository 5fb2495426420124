"""A tiny world to test algorithms in: the same every time, small enough to know by heart.

Floor ``F1`` is 20 m × 12 m with an obstacle and a wall that a door leads through; ``F2`` is the same without the wall.
Twelve transmitters on each fall off with distance. A person walks round and round the obstacle at 1.2 m/s.
"""

from tickfix.testing.world.chance import rng
from tickfix.testing.world.maps import OpenMap, PlainMap, plain_maps
from tickfix.testing.world.phone import SENSORS, samples
from tickfix.testing.world.plan import HEIGHT_M, WIDTH_M, floors
from tickfix.testing.world.radio import heard_at, radio_map, readings, scan, window_of
from tickfix.testing.world.surveyed import context, survey
from tickfix.testing.world.walks import SPEED_MPS, T0_NS, Tick, first_fix, observation, place, walk

__all__ = [
    "HEIGHT_M",
    "SENSORS",
    "SPEED_MPS",
    "T0_NS",
    "WIDTH_M",
    "OpenMap",
    "PlainMap",
    "Tick",
    "context",
    "first_fix",
    "floors",
    "heard_at",
    "observation",
    "place",
    "plain_maps",
    "radio_map",
    "readings",
    "rng",
    "samples",
    "scan",
    "survey",
    "walk",
    "window_of",
]
