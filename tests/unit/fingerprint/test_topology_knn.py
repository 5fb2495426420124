"""``topology-knn``: neighbours as in [wang2015] Figure 2, and as many points as they allow."""

from __future__ import annotations

import numpy as np

from tickfix.api import Floats
from tickfix.testing import world
from tickfix_fingerprint.topology_knn import TopologyKnn, TopologyKnnParams, derive_topology


def lattice(columns: int, rows: int) -> Floats:
    """Return points 2 m apart, row by row from the south-west."""
    return np.array([(2.0 * x, 2.0 * y) for y in range(rows) for x in range(columns)])


def test_gsss_counts_the_neighbours_of_a_lattice() -> None:
    xy = lattice(3, 3)
    topology = derive_topology(xy, np.zeros(9, np.int64), 100.0)
    assert topology.gsss.tolist() == [3, 5, 3, 5, 8, 5, 3, 5, 3]
    assert topology.neighbours[4].tolist() == [5, 8, 7, 6, 3, 0, 1, 2]
    assert set(topology.region.tolist()) == {0}


def test_a_corridor_of_one_line_has_at_most_two_neighbours() -> None:
    topology = derive_topology(lattice(6, 1), np.zeros(6, np.int64), 100.0)
    assert topology.gsss.tolist() == [1, 2, 2, 2, 2, 1]


def test_floors_and_places_apart_are_sub_regions_of_their_own() -> None:
    part = lattice(3, 2)
    xy = np.concatenate([part, part + np.array([20.0, 0.0]), part])
    floor = np.repeat([0, 0, 1], 6)
    region = derive_topology(xy, floor, 100.0).region.reshape(3, 6)
    assert len(np.unique(region)) == 3
    assert (region == region[:, :1]).all()


def test_no_sub_region_is_wider_than_it_may_be() -> None:
    xy = lattice(20, 2)
    topology = derive_topology(xy, np.zeros(40, np.int64), 10.0)
    for number in np.unique(topology.region):
        assert np.ptp(xy[topology.region == number], axis=0).max() <= 10.0
    linked = topology.neighbours >= 0
    own = np.repeat(topology.region[:, None], 8, axis=1)
    assert (topology.region[topology.neighbours[linked]] == own[linked]).all()


def test_a_lone_point_and_no_point_are_no_trouble() -> None:
    assert derive_topology(np.zeros((1, 2)), np.zeros(1, np.int64), 5.0).gsss.tolist() == [0]
    assert derive_topology(np.zeros((0, 2)), np.zeros(0, np.int64), 5.0).gsss.tolist() == []


def method(**params: float) -> TopologyKnn:
    """Return the method on the kit's lattice: points 2 m apart, ten by six on each floor."""
    return TopologyKnn(TopologyKnnParams(region_m=100.0, **params), world.context())


def test_inside_a_lattice_three_points_of_one_square_are_chosen() -> None:
    algorithm = method(square_centre_tolerance=0.0)
    xy = world.radio_map().point_xy
    at = int(np.flatnonzero((xy == [9.0, 5.0]).all(axis=1))[0])
    r = np.exp(-np.hypot(*(xy - [9.3, 6.8]).T))
    points_around = sorted(xy[algorithm.points_around(at, r)].tolist())
    assert points_around == [[9.0, 5.0], [9.0, 7.0], [11.0, 7.0]]


def test_near_the_centre_of_a_square_all_four_are_chosen() -> None:
    xy = world.radio_map().point_xy
    at = int(np.flatnonzero((xy == [9.0, 5.0]).all(axis=1))[0])
    r = np.exp(-np.hypot(*(xy - [9.9, 5.9]).T))
    assert len(method(square_centre_tolerance=0.5).points_around(at, r)) == 4
    assert len(method(square_centre_tolerance=0.0).points_around(at, r)) == 3


def test_where_few_neighbours_are_a_line_is_chosen() -> None:
    algorithm = method(line_gsss=8)
    r = np.exp(-np.hypot(*(world.radio_map().point_xy - [9.9, 5.0]).T))
    points_around = algorithm.points_around(int(r.argmax()), r)
    assert len(points_around) == 2


def test_a_fix_lies_among_the_points_around_it() -> None:
    fix = TopologyKnn(TopologyKnnParams(), world.context()).locate(world.readings("F1", (9.4, 5.4)))
    assert fix is not None
    assert np.hypot(*(fix.xy - [9.4, 5.4])) <= 3.0


def test_coefficients_are_those_over_the_access_points_of_the_sub_region() -> None:
    algorithm = TopologyKnn(TopologyKnnParams(region_m=8.0, n=1), world.context())
    blocks, region = algorithm._fncc.blocks, algorithm.topology.region
    window = world.readings("F1", (9.4, 5.4))
    heard = dict(zip(window.transmitters, window.rssi_dbm - algorithm.params.missing_dbm, strict=True))
    rss = np.array([heard.get(transmitter, 0.0) for transmitter in algorithm.radio_map.transmitters])
    dense = np.array([blocks.dense(b)[:, 0] for b in range(len(blocks.sums))])
    for number in np.unique(region):
        own = region[blocks.point] == number
        available = (dense[own] > 0.0).any(axis=0)
        best = np.full(len(region), -1.0)
        for row, point in zip(dense[own], blocks.point[own], strict=True):
            best[point] = max(best[point], np.corrcoef(row[available], rss[available])[0, 1])
        mine = region == number
        np.testing.assert_allclose(algorithm._coefficients(window, int(number))[mine], best[mine], atol=1e-9)
