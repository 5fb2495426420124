"""The room of [jiang2015] section 8.1: its plan, the route, the fingerprint points and, chosen by us, the radio.

Places are drawn up in the room's own frame, 8.5 m wide and 12 m long, and then turned into the floor's.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from tickfix.api import Floats, Floor, Rng
from tickfix.simulation import AccessPoint, Building, Route, build, declare_floor, walkable
from tickfix.simulation.routes import round_corners

FLOOR: Final = "F8"
_WIDTH_M, _LENGTH_M = 8.5, 12.0
_TURNED_RAD: Final = np.radians(30.0)
_CORNERS: Final = np.array(
    [
        [7.5, 0.9],
        [7.5, 11.2],
        [0.95, 11.2],
        [0.95, 8.2],
        [7.5, 8.2],
        [7.5, 4.8],
        [0.95, 4.8],
        [0.95, 0.9],
        [7.5, 0.9],
        [7.5, 11.2],
        [0.95, 11.2],
    ]
)
_RADIUS_M: Final = 1.0
_POINTS_X, _POINTS_Y = np.arange(0.5, 8.5, 1.5), np.arange(1.0, 12.0, 2.0)
_RADIO_X, _RADIO_Y = (-9.0, 1.5, 7.0, 17.5), (-8.0, 6.0, 20.0)
_CHANNELS: Final = (0.02, 0.4, 0.98)


def plan() -> Floor:
    """Return the floor: one room with four walls."""
    corners = np.array([[0.0, 0.0], [_WIDTH_M, 0.0], [_WIDTH_M, _LENGTH_M], [0.0, _LENGTH_M]])
    return declare_floor(FLOOR, _turned(corners))


def route() -> Route:
    """Return the fixed route: straights through the aisles and curves between them, never due south for long."""
    return Route(FLOOR, round_corners(walkable(plan()), _turned(_CORNERS), _RADIUS_M))


def fingerprint_points() -> Floats:
    """Return the 36 points (36, 2), metres."""
    x, y = np.meshgrid(_POINTS_X, _POINTS_Y)
    return _turned(np.column_stack([x.ravel(), y.ravel()]))


def building(rng: Rng) -> Building:
    """Return the room with twelve access points around and in it; shadowing and magnetic disturbance are drawn."""
    places = [(x, y) for y in _RADIO_Y for x in _RADIO_X]
    points = [
        AccessPoint(
            name=f"02:00:00:00:08:{i:02x}",
            floor=FLOOR,
            xy=(float(xy[0]), float(xy[1])),
            channel=_CHANNELS[i % len(_CHANNELS)],
        )
        for i, xy in enumerate(_turned(np.array(places)))
    ]
    return build([plan()], points, rng)


def _turned(xy: Floats) -> Floats:
    """Return places (n, 2) of the room in the floor's frame: turned clockwise, the drawing's corner at the origin."""
    sin, cos = np.sin(_TURNED_RAD), np.cos(_TURNED_RAD)
    turned: Floats = xy @ np.array([[cos, -sin], [sin, cos]]) + np.array([0.0, _WIDTH_M * sin])
    return turned
