"""``regions``: the walkable area divided by grid and walls, every free place in exactly one sub-region."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

from tickfix.api import Context, Floor
from tickfix_maps.regions import Regions, RegionsParams

OUTLINE = np.array([(0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (0.0, 10.0)])


def regions(*walls: Sequence[Sequence[float]], region_m: float = 10.0) -> Regions:
    """Return the map of a hall of 20 × 10 m with walls."""
    segments = np.array(walls, np.float64).reshape(-1, 2, 2)
    floor = Floor(name="F1", width_m=20.0, height_m=10.0, outline=(OUTLINE,), walls=segments)
    return Regions(RegionsParams(region_m=region_m), Context(floor=floor))


def test_a_hall_is_cut_into_squares_that_are_adjacent() -> None:
    hall = regions()
    assert hall.region_of(np.array([(2.0, 5.0), (18.0, 5.0)])).tolist() == [0, 1]
    assert hall.adjacent.tolist() == [[0, 1]]


def test_a_wall_through_a_square_makes_two_sub_regions_without_a_way_between() -> None:
    hall = regions([(5.0, 0.0), (5.0, 10.0)], region_m=30.0)
    west, east = hall.region_of(np.array([(2.0, 5.0), (18.0, 5.0)]))
    assert west != east
    assert len(hall.adjacent) == 0


def test_a_door_joins_what_its_wall_would_divide() -> None:
    hall = regions([(5.0, 0.0), (5.0, 4.0)], [(5.0, 6.0), (5.0, 10.0)], region_m=30.0)
    west, east = hall.region_of(np.array([(2.0, 5.0), (18.0, 5.0)]))
    assert west == east


def test_squares_that_a_wall_divides_are_not_adjacent() -> None:
    assert len(regions([(10.0, 0.0), (10.0, 10.0)]).adjacent) == 0


def test_squares_that_share_a_corner_only_are_not_adjacent() -> None:
    hall = regions(region_m=5.0)
    corners = hall.region_of(np.array([(2.0, 2.0), (7.0, 7.0)])).tolist()
    assert corners not in hall.adjacent.tolist()


def test_a_floor_without_outline_has_no_sub_regions() -> None:
    bare = Regions(RegionsParams(), Context(floor=Floor(name="F1")))
    assert bare.outlines == ()
    assert bare.region_of(np.zeros((2, 2))).tolist() == [-1, -1]
    assert bare.adjacent.shape == (0, 2)


@given(st.lists(st.tuples(st.floats(0.1, 19.9), st.floats(0.1, 9.9)), min_size=1, max_size=20))
def test_every_free_place_lies_in_its_sub_region(points: list[tuple[float, float]]) -> None:
    hall = regions([(5.0, 2.0), (12.0, 8.0)], region_m=6.0)
    xy = np.array(points)
    free = shapely.contains_xy(hall.free, xy)
    for place, number in zip(xy[free], hall.region_of(xy[free]), strict=True):
        assert hall.outlines[number].distance(shapely.Point(place)) <= 1e-9
    assert sum(outline.area for outline in hall.outlines) <= hall.free.area + 1e-6
