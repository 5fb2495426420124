"""Walls against shapely, on any drawing that hypothesis thinks of: touching, crossing, collinear, of no length."""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from tickfix.api import Context, Floats, Floor
from tickfix_maps.walls import Walls, WallsParams

grid = st.integers(0, 12).map(float)
"""Whole metres, so that touching and collinear cases are frequent and exact."""
near = st.floats(-3.0, 15.0, allow_nan=False).map(lambda x: round(x, 3))
segments = st.lists(st.tuples(grid, grid, grid, grid), max_size=12)
moves = st.lists(
    st.one_of(st.tuples(grid, grid, grid, grid), st.tuples(near, near, near, near)), min_size=1, max_size=25
)


def built(floor: Floor) -> Walls:
    return Walls(WallsParams(), Context(floor=floor))


def points(rows: list[tuple[float, ...]]) -> tuple[Floats, Floats]:
    table = np.array(rows)
    return table[:, :2], table[:, 2:]


def way(a: Floats, b: Floats) -> shapely.Geometry:
    return shapely.Point(a) if (a == b).all() else shapely.LineString([a, b])


@settings(max_examples=300)
@given(segments=segments, moves=moves)
def test_crossings_are_those_of_shapely(segments: list[tuple[float, ...]], moves: list[tuple[float, ...]]) -> None:
    walls = np.array(segments).reshape(-1, 2, 2)
    a, b = points(moves)
    found = built(Floor(name="F", walls=walls)).crosses(a, b)
    for n in range(len(a)):
        distances = [way(*wall).distance(way(a[n], b[n])) for wall in walls if (wall[0] != wall[1]).any()]
        nearest = min(distances, default=np.inf)
        if nearest == 0.0 or nearest > 1e-9:
            assert found[n] == (nearest == 0.0), (a[n], b[n], nearest)


@settings(max_examples=100)
@given(
    corners=st.tuples(grid, grid, grid, grid).filter(lambda c: abs(c[0] - c[2]) > 1 and abs(c[1] - c[3]) > 1),
    hole=st.tuples(grid, grid, grid, grid).filter(lambda c: c[0] != c[2] and c[1] != c[3]),
    xy=st.lists(st.tuples(near, near), min_size=1, max_size=20),
)
def test_one_can_stand_inside_the_outline_and_outside_of_obstacles(
    corners: tuple[float, ...], hole: tuple[float, ...], xy: list[tuple[float, float]]
) -> None:
    outline, obstacle = (shapely.box(*np.sort([c[::2], c[1::2]], axis=1).T.ravel()) for c in (corners, hole))
    floor = Floor(
        name="F",
        outline=(np.array(outline.exterior.coords)[:-1],),
        obstacles=(np.array(obstacle.exterior.coords)[:-1],),
    )
    area, where, mapped = outline.difference(obstacle), np.array(xy), built(floor)
    found = mapped.contains(where)
    for n, point in enumerate(where):
        if area.boundary.distance(shapely.Point(point)) > 1e-9:
            assert found[n] == area.contains(shapely.Point(point))
    if area.area > 1.0:
        free = mapped.nearest_free(where)
        assert mapped.contains(free).all()
        assert (free[found] == where[found]).all()


def test_a_long_move_over_many_walls_is_found_from_either_end() -> None:
    x = np.arange(0.0, 400.0, 2.0)
    walls = np.stack([np.column_stack([x, 0 * x]), np.column_stack([x, 0 * x + 1.0])], axis=1)
    mapped = built(Floor(name="F", walls=walls))
    a, b = np.array([[-1.0, 0.5], [398.5, 0.5], [-1.0, 1.5]]), np.array([[0.5, 0.5], [397.5, 0.5], [500.0, 1.5]])
    assert mapped.crosses(a, b).tolist() == mapped.crosses(b, a).tolist() == [True, True, False]
