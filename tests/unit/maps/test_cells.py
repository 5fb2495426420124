"""What cells tell beforehand is what exact geometry says, to the last case: on edges, in corners and along walls."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from tickfix.api import Bools, Context, Floats, Floor
from tickfix_maps.segment_index import GRID_MARGIN_M, CellGrid, SegmentIndex
from tickfix_maps.walls import Walls, WallsParams

exact = st.integers(0, 24).map(lambda n: n / 4)
"""Quarters of a metre, so that touching, collinear and overlapping cases are frequent and exact."""
anywhere = st.floats(-4.0, 10.0, allow_nan=False)
segment = st.tuples(exact, exact, exact, exact)
drawing = st.lists(segment.filter(lambda s: s[:2] != s[2:]), min_size=1, max_size=8)
short = st.tuples(exact, exact, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)).map(
    lambda m: (m[0], m[1], m[0] + m[2], m[1] + m[3])
)
moves = st.lists(st.one_of(segment, short, st.tuples(*[anywhere] * 4)), min_size=1, max_size=30)


def index_of(rows: list[tuple[float, ...]]) -> Floats:
    return np.array(rows).reshape(-1, 2, 2)


def every_pair(a: Floats, b: Floats, segments: Floats) -> Bools:
    """Test every move against every segment, as the definition reads: on both sides of each other, or touching."""
    a, b, p, q = a[:, None], b[:, None], segments[None, :, 0], segments[None, :, 1]

    def side(o: Floats, d: Floats, x: Floats) -> Floats:
        return np.sign((d - o)[..., 0] * (x - o)[..., 1] - (d - o)[..., 1] * (x - o)[..., 0])

    straddle = (side(a, b, p) * side(a, b, q) <= 0) & (side(p, q, a) * side(p, q, b) <= 0)
    overlap = (np.minimum(a, b) <= np.maximum(p, q)) & (np.minimum(p, q) <= np.maximum(a, b))
    crossed: Bools = (straddle & overlap.all(axis=-1)).any(axis=1)
    return crossed


@settings(max_examples=300)
@given(segments=drawing, moves=moves)
def test_crossings_are_those_of_every_pair(segments: list[tuple[float, ...]], moves: list[tuple[float, ...]]) -> None:
    walls, ways = index_of(segments), index_of(moves)
    a, b = ways[:, 0], ways[:, 1]
    found = SegmentIndex(walls).crosses(a, b)
    assert found.tolist() == every_pair(a, b, walls).tolist()


def test_crossings_of_a_crowd_are_those_of_every_pair() -> None:
    rng = np.random.default_rng(0)
    corners = rng.uniform(0.0, 30.0, (60, 2))
    walls = np.stack([corners, corners + rng.normal(0.0, 4.0, corners.shape)], axis=1)
    walls[::2, 1, 0] = walls[::2, 0, 0]  # every other one stands upright
    a = rng.uniform(-3.0, 33.0, (20_000, 2))
    for length_m in (0.02, 0.3, 1.5, 8.0):
        b = a + rng.normal(0.0, length_m, a.shape)
        found = SegmentIndex(walls).crosses(a, b)
        assert found.any()
        assert (found == every_pair(a, b, walls)).all()


def test_a_move_is_told_the_same_alone_and_in_company() -> None:
    rng = np.random.default_rng(1)
    walls = index_of([(0, 0, 6, 0), (6, 0, 6, 6), (3, 0, 3, 5), (1, 1, 2, 2)])
    index = SegmentIndex(walls)
    a = rng.uniform(-1.0, 7.0, (9000, 2))
    b = a + rng.normal(0.0, 0.4, a.shape)
    b[::50] += 5.0
    together = index.crosses(a, b)
    alone = [bool(index.crosses(a[n : n + 1], b[n : n + 1])[0]) for n in range(0, 9000, 9)]
    assert together[::9].tolist() == alone


@settings(max_examples=150)
@given(segments=drawing, points=st.lists(st.tuples(anywhere, anywhere), min_size=1, max_size=30))
def test_no_point_is_nearer_to_a_wall_than_its_cell_says(
    segments: list[tuple[float, ...]], points: list[tuple[float, float]]
) -> None:
    cells, xy = CellGrid(index_of(segments)), np.array(points)
    clearance_m = cells.clearance_m()[cells.index_of(xy.T)]
    distance_m = shapely.distance(shapely.points(xy), shapely.MultiLineString(list(index_of(segments))))
    assert (clearance_m <= distance_m + 1e-9).all()
    assert (clearance_m >= np.minimum(distance_m, GRID_MARGIN_M) - 2.0 * np.sqrt(2.0) * cells.side_m - 1e-9).all()


@settings(max_examples=100)
@given(
    ring=st.lists(st.tuples(exact, exact), min_size=3, max_size=7, unique=True),
    hole=st.lists(st.tuples(exact, exact), min_size=3, max_size=5, unique=True),
    points=st.lists(st.one_of(st.tuples(exact, exact), st.tuples(anywhere, anywhere)), min_size=1, max_size=40),
)
def test_where_one_can_stand_is_what_the_area_says_of_each_point(
    ring: list[tuple[float, float]], hole: list[tuple[float, float]], points: list[tuple[float, float]]
) -> None:
    mapped = Walls(
        WallsParams(), Context(floor=Floor(name="F", outline=(np.array(ring),), obstacles=(np.array(hole),)))
    )
    outline, obstacle = (shapely.make_valid(shapely.Polygon(corners)) for corners in (ring, hole))
    xy = np.array(points)
    expected = shapely.contains_xy(outline.difference(obstacle), xy)
    assert mapped.contains(xy).tolist() == expected.tolist()


@pytest.mark.parametrize("size_m", [10.0, 900.0])
def test_a_large_floor_has_coarser_cells_not_more_of_them(size_m: float) -> None:
    cells = CellGrid(index_of([(0.0, 0.0, size_m, size_m)]))
    assert cells.occupied.size < 2.1e6
    assert cells.side_m == pytest.approx(max(0.1, (size_m + 2 * GRID_MARGIN_M) / np.sqrt(2e6)))
