"""The twin of the floor of [sun2013] section 4.1: plan, access points, reference points, trajectory and drawings.

Metres, x across the 24.9 m, y along the 66.4 m. A ring of corridors around a core, rooms outside it; the experiment is
in the southern 28.0 m: in Room 1211, through its door, along the western corridor, round two corners, up the eastern.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image, ImageDraw

from tickfix.api import Floats, Floor
from tickfix.simulation import AccessPoint, declare_floor, rectangle, wall

FLOOR: Final = "F12"
WIDTH_M: Final = 24.9
LENGTH_M: Final = 66.4
WEST: Final = (7.2, 10.2)
EAST: Final = (14.7, 17.7)
SOUTH: Final = (7.0, 10.0)
NORTH: Final = (56.4, 59.4)
ROOM: Final = (16.0, 26.5)
DOOR_Y: Final = 18.0
SPACING_M: Final = 1.5
GAP_M: Final = 0.6
TEST_POINTS: Final = 65
PIXEL_M: Final = 0.1

WAY: Final = ((3.6, 24.0), (3.6, DOOR_Y), (8.7, DOOR_Y), (8.7, 8.5), (16.2, 8.5), (16.2, 18.8))
"""Corners of the trajectory from A to B."""

WALKWAYS: Final = (
    ((3.6, 17.0), (3.6, 25.5)),
    ((1.0, DOOR_Y), (8.7, DOOR_Y)),
    ((1.0, 24.0), (6.2, 24.0)),
    ((8.7, 8.5), (8.7, 28.0)),
    ((8.7, 8.5), (16.2, 8.5)),
    ((16.2, 8.5), (16.2, 28.0)),
)
"""The calibration model: the middles of the corridors, and the aisles of the room."""

_ACCESS_POINTS: Final = (
    *((3.6, 3.5), (21.3, 12.0), (3.6, 25.0), (16.2, 25.0)),
    *((8.7, 36.0), (21.3, 41.0), (3.6, 47.0), (16.2, 52.0), (12.45, 62.9)),
)


def floor() -> Floor:
    """Return the plan; of the rooms only 1211 has an open door."""
    west = [wall((0, y), (WEST[0], y)) for y in (*ROOM, 36.5, 46.5)]
    east = [wall((EAST[1], y), (WIDTH_M, y)) for y in (17.0, 27.0, 37.0, 47.0)]
    ends = [wall((0, y), (WIDTH_M, y)) for y in (SOUTH[0], NORTH[1])]
    rooms = [wall((x, a), (x, b)) for x in (8.3, 16.6) for a, b in ((0.0, SOUTH[0]), (NORTH[1], LENGTH_M))]
    corridors = [
        wall((WEST[0], SOUTH[0]), (WEST[0], NORTH[1]), [DOOR_Y - SOUTH[0]]),
        wall((EAST[1], SOUTH[0]), (EAST[1], NORTH[1])),
    ]
    core = rectangle(WEST[1], SOUTH[1], EAST[0], NORTH[0])
    walls = [*west, *east, *ends, *rooms, *corridors]
    return declare_floor(FLOOR, rectangle(0, 0, WIDTH_M, LENGTH_M), walls, [core], level=12)


def access_points() -> tuple[AccessPoint, ...]:
    """Return the nine access points, four of them in the experimental area."""
    return tuple(
        AccessPoint(name=f"02:00:00:00:00:{i:02x}", floor=FLOOR, xy=xy) for i, xy in enumerate(_ACCESS_POINTS, start=1)
    )


def reference_points() -> Floats:
    """Return the reference points (91, 2): two rows along the corridors, a lattice in the room."""
    south, room = SOUTH[0] + SPACING_M / 2, ROOM[0] + SPACING_M / 2
    western, southern, eastern = ((7.95, south), 2, 13), ((10.95, south), 3, 2), ((15.45, south), 2, 12)
    return np.concatenate([_lattice(*part) for part in (western, southern, eastern, ((0.6, room), 5, 7))])


def test_points() -> tuple[Floats, Floats]:
    """Return the test points (65, 2) from A to B, and which way one walks at each (65,), radians from +y."""
    corners = np.array(WAY)
    legs = np.diff(corners, axis=0)
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*legs.T))])
    at = GAP_M * np.arange(TEST_POINTS)
    xy = np.stack([np.interp(at, way_m, corners[:, i]) for i in range(2)], axis=1)
    leg = np.minimum(np.searchsorted(way_m, at, side="right") - 1, len(legs) - 1)
    return xy, np.arctan2(legs[leg, 0], legs[leg, 1])


def draw_plans(folder: Path) -> tuple[Path, Path]:
    """Write the plan without and with walkways as grey-scale images, structure and walkways dark: eq. (7)."""
    plan = floor()
    size = (round(WIDTH_M / PIXEL_M), round(LENGTH_M / PIXEL_M))
    image = Image.new("L", size, 255)
    draw = ImageDraw.Draw(image)
    for ring in plan.obstacles:
        draw.polygon(_pixels(ring, size[1]), fill=0)
    for segment in plan.walls:
        draw.line(_pixels(segment, size[1]), fill=0, width=2)
    paths = folder / "plan.png", folder / "plan-with-walkways.png"
    image.save(paths[0])
    for line in WALKWAYS:
        draw.line(_pixels(np.array(line), size[1]), fill=60, width=1)
    image.save(paths[1])
    return paths


def _lattice(corner: tuple[float, float], columns: int, rows: int) -> Floats:
    """Return the points (n, 2) of a lattice by its south-western corner."""
    row, column = np.indices((rows, columns)).reshape(2, -1)
    lattice: Floats = np.array(corner) + SPACING_M * np.stack([column, row], axis=1)
    return lattice


def _pixels(xy: Floats, rows: int) -> list[tuple[float, float]]:
    return [(float(x) / PIXEL_M, rows - 1 - float(y) / PIXEL_M) for x, y in xy]
