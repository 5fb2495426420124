"""The floor of [wang2015] section 6.1, as far as the text tells it: corridors, a hall, 60 access points in a row.

The text prints that people walk in linear and non-linear corridors only, that 60 access points hang along them on the
ceiling, and that about ten of these are available at a reference point (Figures 13 and 14). It prints no dimension and
no coordinate: two long corridors joined by a short one at each end, and a hall between them, are ours.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from tickfix.api import Floats, Floor, Rng, frozen
from tickfix.simulation import AccessPoint, Building, Magnetism, build, declare_floor, rectangle, wall

FLOOR: Final = "F4"
SPACING_M: Final = 3.0
"""Of the reference points: one line of them in a corridor, a lattice in the hall."""
POWER_DBM: Final = -65.0
"""At 1 m; with it about ten of the access points are heard at a reference point, as Figure 14(b) shows."""
_CORRIDOR_M: Final = 2.4
_WEST, _EAST, _SOUTH, _NORTH = 1.2, 58.2, 8.2, 23.2
"""Middles of the four corridors, metres."""
_HALL: Final = (23.7, 32.7)
"""Its walls in the west and in the east; it reaches from corridor to corridor."""
_WIDTH_M, _HEIGHT_M = 59.4, 31.4
_ROOM_M: Final = 6.0

ROUTE: Final = ((_WEST, _SOUTH), (28.2, _SOUTH), (28.2, _NORTH), (_EAST, _NORTH), (_EAST, _SOUTH), (_WEST, _SOUTH))
"""The test walk: along the south, through the hall, round the eastern half and back along the whole south, 144 m."""
CALIBRATION: Final = (
    ((_WEST, _SOUTH), (_WEST, _NORTH), (_EAST, _NORTH)),
    ((_EAST, _NORTH), (_EAST, _SOUTH), (_WEST, _SOUTH)),
    ((_WEST, _SOUTH), (25.2, _SOUTH), (31.2, _NORTH), (_WEST, _NORTH), (_WEST, _SOUTH)),
)
"""Walks by which K of eq. (7), the drawing's north and the noise of fixes are calibrated."""


def floor_plan() -> Floor:
    """Return the floor: only corridors and hall are free, the rooms between them are obstacles with walls within."""
    half = _CORRIDOR_M / 2.0
    south, north = _SOUTH - half, _NORTH + half
    rooms = (
        (0.0, 0.0, _WIDTH_M, south),
        (0.0, north, _WIDTH_M, _HEIGHT_M),
        (_WEST + half, _SOUTH + half, _HALL[0], _NORTH - half),
        (_HALL[1], _SOUTH + half, _EAST - half, _NORTH - half),
    )
    walls = [
        wall((float(x), y0), (float(x), y1))
        for x0, y0, x1, y1 in rooms
        for x in np.arange(x0 + _ROOM_M, x1 - 1.0, _ROOM_M)
    ]
    middle = (_SOUTH + _NORTH) / 2.0
    walls += [wall((x0, middle), (x1, middle)) for x0, _, x1, _ in rooms[2:]]
    return declare_floor(
        FLOOR, rectangle(0.0, 0.0, _WIDTH_M, _HEIGHT_M), walls, [rectangle(*room) for room in rooms], level=4
    )


def reference_points() -> Floats:
    """Return the reference points (60, 2): every 3 m in the corridors, 3 m × 3 m in the hall."""
    along = _WEST + SPACING_M * np.arange(20)
    across = _SOUTH + SPACING_M * np.arange(1, 5)
    columns = [_WEST, *along[(along > _HALL[0]) & (along < _HALL[1])].tolist(), _EAST]
    points = [(x, y) for y in (_SOUTH, _NORTH) for x in along] + [(x, y) for x in columns for y in across]
    return frozen(np.array(points, np.float64))


def access_points() -> tuple[AccessPoint, ...]:
    """Return 60 access points, evenly along the middles of corridors and hall."""
    middle = (_HALL[0] + _HALL[1]) / 2.0
    rows = (
        ((_WEST, _SOUTH), (_EAST, _SOUTH), 22),
        ((_WEST, _NORTH), (_EAST, _NORTH), 22),
        ((_WEST, _SOUTH), (_WEST, _NORTH), 5),
        ((_EAST, _SOUTH), (_EAST, _NORTH), 5),
        ((middle, _SOUTH), (middle, _NORTH), 6),
    )
    places = [np.array(a) + (i + 0.5) / n * (np.array(b) - np.array(a)) for a, b, n in rows for i in range(n)]
    return tuple(
        AccessPoint(
            name=f"02:00:00:00:04:{i:02x}",
            floor=FLOOR,
            xy=(float(x), float(y)),
            power_dbm=POWER_DBM,
            channel=(0.05, 0.5, 0.95)[i % 3],
        )
        for i, (x, y) in enumerate(places)
    )


def draw_building(rng: Rng) -> Building:
    """Return the building; its shadowing and its magnetic field are drawn."""
    return build([floor_plan()], access_points(), rng, magnetism=Magnetism(north_rad=0.2))
