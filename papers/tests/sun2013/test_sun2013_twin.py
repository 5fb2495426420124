"""The twin of [sun2013] and its Table 3."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.image import imread

from tickfix.simulation import walkable_grid
from tickfix_papers.sun2013 import twin
from tickfix_papers.sun2013.claims import Operations, operation_counts


def test_the_operation_counts_are_those_of_table_3() -> None:
    assert operation_counts(L=91, M=9, N=2, K=7) == {
        "KNN": Operations(1559, 821, 91),
        "WKNN": Operations(1571, 835, 91),
        "NCC (1)": Operations(11023, 5280, 182),
        "FNCC (5)": Operations(9476, 3642, 0),
        "FNCC (6)": Operations(6382, 3824, 0),
    }


def test_the_site_has_the_printed_numbers() -> None:
    floor, (tests, _) = twin.floor_plan(), twin.test_points()
    assert (floor.width_m, floor.height_m) == (24.9, 66.4)
    points = twin.reference_points()
    assert len(points) == 91
    assert len(np.unique(points, axis=0)) == 91
    assert len(twin.access_points()) == 9
    assert sum(ap.xy[1] <= 28.0 for ap in twin.access_points()) == 4
    assert len(tests) == 65
    assert twin.TEST_SAMPLES * len(tests) == 6500
    assert max(points[:, 1].max(), tests[:, 1].max()) < 28.0


def test_the_trajectory_keeps_its_gaps_and_can_be_walked() -> None:
    tests, headings = twin.test_points()
    gaps = np.diff(tests, axis=0)
    straight = np.isclose(headings[:-1], headings[1:])
    np.testing.assert_allclose(np.hypot(*gaps[straight].T), 0.6)
    np.testing.assert_allclose(np.arctan2(*gaps[straight].T), headings[:-1][straight])
    walkable_area = walkable_grid(twin.floor_plan())
    assert walkable_area.covers(np.stack([tests[:-1], tests[1:]], axis=1)).all()


def test_the_drawings_differ_in_the_walkways_only(tmp_path: Path) -> None:
    plan, with_walkways = (imread(path) for path in twin.draw_plans(tmp_path))
    assert plan.shape == (664, 249)
    differ = plan != with_walkways
    assert plan[differ].min() == 1.0
    assert with_walkways[differ].max() < 0.55
    # Each test point lies on a walkway, whose line is one pixel wide.
    column, row = np.floor(twin.test_points()[0] / twin.PIXEL_M).astype(int).T
    near = [differ[663 - r - 1 : 663 - r + 2, c - 1 : c + 2].any() for c, r in zip(column, row, strict=True)]
    assert all(near)
