"""Routes and floors."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely

from tickfix.simulation import (
    WalkableGrid,
    declare_floor,
    office_floor,
    random_route,
    rectangle,
    route_through,
    survey_routes,
    walkable_grid,
    wall,
)
from tickfix.simulation.floor_plans import barriers, count_wall_crossings


def touches(grid: WalkableGrid, xy: np.ndarray) -> bool:
    walls = shapely.multilinestrings(list(shapely.linestrings(barriers(grid.floor))))
    return bool(shapely.intersects(walls, shapely.linestrings(xy)))


@pytest.mark.parametrize("seed", range(4))
def test_a_random_route_never_touches_a_wall_on_any_office(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = walkable_grid(office_floor(rng, width_m=60, height_m=36))
    route = random_route(grid, rng, 100.0)
    assert not touches(grid, route.xy)
    assert route.length_m >= 95.0


def test_a_route_keeps_its_margin_from_walls(grid: WalkableGrid) -> None:
    route = random_route(grid, np.random.default_rng(3), 150.0)
    walls = shapely.multilinestrings(list(shapely.linestrings(barriers(grid.floor))))
    assert shapely.distance(walls, shapely.linestrings(route.xy)) > 0.99 * grid.margin_m


def test_survey_routes_pass_every_place_and_no_wall(grid: WalkableGrid) -> None:
    routes = survey_routes(grid, spacing_m=3.0, length_m=60.0)
    assert not any(touches(grid, route.xy) for route in routes)
    lines = shapely.multilinestrings([shapely.LineString(route.xy) for route in routes])
    apart = shapely.distance(lines, shapely.points(grid.xy))
    assert np.mean(apart < 3.0) > 0.98
    for before, after in pairwise(routes):
        assert np.allclose(before.xy[-1], after.xy[0])


def test_every_room_of_an_office_can_be_reached() -> None:
    floor = office_floor(np.random.default_rng(5))
    grid = walkable_grid(floor)
    shafts = sum(shapely.Polygon(ring).area for ring in floor.obstacles)
    share = len(grid.xy) * grid.cell_m**2 / (floor.width_m * floor.height_m - shafts)
    assert share > 0.78


def test_a_route_through_a_declared_floor_takes_the_door() -> None:
    floor = declare_floor("hall", rectangle(0, 0, 20, 10), [wall((10, 0), (10, 10), doors=[8.0])])
    route = route_through(walkable_grid(floor), np.array([[2.0, 2.0], [18.0, 2.0]]))
    at_wall = np.interp(10.0, route.xy[:, 0], route.xy[:, 1])
    assert 7.5 < at_wall < 8.5
    assert route.length_m < 24.0


def test_corners_are_rounded(grid: WalkableGrid) -> None:
    route = random_route(grid, np.random.default_rng(1), 200.0)
    heading = np.unwrap(np.arctan2(*np.diff(route.xy, axis=0).T))
    turns = np.abs(np.diff(heading))
    assert turns.sum() > 10.0
    assert np.mean(turns > 0.3) < 0.1


def test_a_door_outside_its_wall_is_refused() -> None:
    with pytest.raises(ValueError, match="doors at"):
        wall((0, 0), (3, 0), doors=[2.9])


def test_cells_too_large_for_the_margin_are_refused(grid: WalkableGrid) -> None:
    with pytest.raises(ValueError, match=r"cell_m: found 0\.5 m"):
        walkable_grid(grid.floor, margin_m=0.3, cell_m=0.5)


def test_crossings_agree_with_shapely() -> None:
    rng = np.random.default_rng(2)
    a, b, walls = rng.uniform(0, 10, (50, 2)), rng.uniform(0, 10, (50, 2)), rng.uniform(0, 10, (40, 2, 2))
    expected = shapely.intersects(
        shapely.linestrings(np.stack([a, b], axis=1))[:, None], shapely.linestrings(walls)[None]
    ).sum(axis=1)
    assert np.array_equal(count_wall_crossings(a, b, walls), expected)


def test_a_way_through_the_joint_of_two_walls_crosses_one() -> None:
    walls = np.array([[[0.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [2.0, 0.0]]])
    assert count_wall_crossings(np.array([[1.0, -1.0]]), np.array([[1.0, 1.0]]), walls).tolist() == [1]
