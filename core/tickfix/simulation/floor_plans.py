"""Floor plans declared by hand or drawn up as an office, and the number of walls that a straight line crosses."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from tickfix.api import Floats, Floor, Ints, Rng

_CHUNK: Final = 2_000_000
"""Pairs of way and wall looked at in one go: bounds the memory to some 100 MB."""


def count_wall_crossings(a: Floats, b: Floats, walls: Floats) -> Ints:
    """Count the walls that each straight way from ``a`` to ``b`` crosses.

    Args:
        a, b: (n, 2) metres.
        walls: (m, 2, 2) metres; a wall holds its first end but not its second, so that a way through the joint of two
            walls crosses one. Walls along the way are not crossed.

    Returns:
        (n,) int64.
    """
    count = np.zeros(len(a), dtype=np.int64)
    if len(walls) == 0:
        return count
    rows = max(1, _CHUNK // len(walls))
    for i in range(0, len(a), rows):
        count[i : i + rows] = _crossed(a[i : i + rows], b[i : i + rows], walls).sum(axis=1)
    return count


def _crossed(a: Floats, b: Floats, walls: Floats) -> Floats:
    rx, ry = (b - a).T[..., None]
    sx, sy = (walls[:, 1] - walls[:, 0]).T
    qx, qy = walls[:, 0, 0] - a[:, :1], walls[:, 0, 1] - a[:, 1:]
    area = rx * sy - ry * sx
    # Compared without dividing: t = way/area and u = wall/area lie in [0, 1] and [0, 1) when these signs agree.
    sign = np.sign(area)
    size = np.abs(area)
    way, wall = sign * (qx * sy - qy * sx), sign * (qx * ry - qy * rx)
    crossed: Floats = (size > 0) & (way >= 0) & (way <= size) & (wall >= 0) & (wall < size)
    return crossed


def barriers(floor: Floor) -> Floats:
    """Return what stands on a floor, walls and the edges of obstacles, as segments (m, 2, 2) in metres."""
    rings = [np.array(list(pairwise(np.vstack([ring, ring[:1]])))) for ring in floor.obstacles if len(ring) > 2]
    return np.concatenate([floor.walls, *rings])


Point = tuple[float, float]


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Floats:
    """Return the ring (4, 2) of a rectangle, metres, for an outline or an obstacle."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=np.float64)


def wall(a: Point, b: Point, doors: Sequence[float] = (), door_m: float = 1.0) -> Floats:
    """Return a straight wall with doors.

    Args:
        a, b: its ends, metres.
        doors: where the middles of the doors lie, metres from ``a`` along the wall.
        door_m: how wide each is.

    Returns:
        (m, 2, 2): the pieces between the doors.
    """
    start, end = np.array(a, dtype=np.float64), np.array(b, dtype=np.float64)
    length = float(np.hypot(*(end - start)))
    cuts = [0.0, *(cut for door in sorted(doors) for cut in (door - door_m / 2, door + door_m / 2)), length]
    if any(right < left for left, right in pairwise(cuts)):
        raise ValueError(f"doors at {list(doors)} m, {door_m} m wide: expected apart and within the wall of {length} m")
    along = np.array(cuts).reshape(-1, 2)
    pieces: Floats = start + (along / length)[..., None] * (end - start)
    return pieces[along[:, 1] > along[:, 0]]


def walls_around(ring: Floats) -> Floats:
    """Return the walls (n, 2, 2) along a ring (n, 2)."""
    return np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)


def declare_floor(
    name: str,
    outline: Floats,
    walls: Sequence[Floats] = (),
    obstacles: Sequence[Floats] = (),
    *,
    level: int = 0,
) -> Floor:
    """Declare a floor of a site of one's own; its outer walls are added.

    Args:
        name: unique within the building.
        outline: ring (n, 2), metres, south-west corner of the drawing at the origin.
        walls: pieces (m, 2, 2) each, as :func:`wall` makes them.
        obstacles: rings (n, 2) that one cannot walk through.
        level: number of the storey.
    """
    return Floor(
        name=name,
        level=level,
        width_m=float(outline[:, 0].max()),
        height_m=float(outline[:, 1].max()),
        outline=(outline,),
        obstacles=tuple(obstacles),
        walls=np.concatenate([walls_around(outline), *walls]),
    )


def office_floor(
    rng: Rng,
    *,
    name: str = "F1",
    level: int = 0,
    width_m: float = 60.0,
    height_m: float = 36.0,
    room_m: float = 6.5,
    corridor_m: float = 2.4,
) -> Floor:
    """Draw up an office: rooms along the façade, a ring of corridors, two blocks of rooms inside, a shaft in each.

    Args:
        rng: draws the widths of the rooms and where their doors are.
        name, level: of the floor.
        width_m, height_m: of the house.
        room_m: depth of the rooms at the façade, and roughly their width.
        corridor_m: width of the corridors.
    """
    if min(width_m / 2, height_m) < 2 * (room_m + corridor_m) + 6:
        raise ValueError(f"a house of {width_m} m × {height_m} m is too small for rooms and corridors around a core")
    d, c, w, h = room_m, corridor_m, width_m, height_m
    walls: list[Floats] = []
    for y, outer in ((d, 0.0), (h - d, h)):  # south and north
        # Corner rooms reach past the corner, else their door would not lie at the corridor.
        splits = _splits(rng, d + 2.2, w - d - 2.2, room_m)
        rooms = zip([d, *splits], [*splits, w - d], strict=True)
        walls.append(wall((0, y), (w, y), [_door(rng, a, b) for a, b in rooms]))
        walls += [wall((x, y), (x, outer)) for x in splits]
    for x, outer in ((d, 0.0), (w - d, w)):  # west and east
        splits = _splits(rng, d, h - d, room_m)
        walls.append(wall((x, d), (x, h - d), [_door(rng, a, b) - d for a, b in pairwise(splits)]))
        walls += [wall((x, y), (outer, y)) for y in splits[1:-1]]
    shafts = []
    for x0, x1 in ((d + c, (w - c) / 2), ((w + c) / 2, w - d - c)):  # the two blocks, a corridor between them
        y0, y1, middle = d + c, h - d - c, h / 2
        splits = _splits(rng, x0 + 2.5, x1, room_m)
        first = splits[0]
        shafts.append(rectangle(x0, y0, first, y1))
        walls += [wall((x1, y0), (x1, y1)), wall((first, middle), (x1, middle))]
        walls += [wall((x, y0), (x, y1)) for x in splits[1:-1]]
        doors = [[_door(rng, a, b) - first for a, b in pairwise(splits)] for _ in range(2)]
        walls += [wall((first, y0), (x1, y0), doors[0]), wall((first, y1), (x1, y1), doors[1])]
    return declare_floor(name, rectangle(0, 0, w, h), walls, shafts, level=level)


def _splits(rng: Rng, low: float, high: float, size: float) -> list[float]:
    """Return where walls divide [low, high] into rooms of about ``size``, both ends among them."""
    n = max(1, round((high - low) / size))
    share = np.cumsum(rng.uniform(0.8, 1.2, n))
    return [low, *(low + (high - low) * share[:-1] / share[-1]).tolist(), high]


def _door(rng: Rng, a: float, b: float) -> float:
    return float(rng.uniform(a + 0.8, b - 0.8))
