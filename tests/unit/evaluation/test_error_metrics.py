"""The IPIN score, circular errors, floor probability and curves, against values computed by hand."""

from __future__ import annotations

import numpy as np

from tickfix.evaluation.error_metrics import (
    ErrorStatistics,
    bin_errors,
    circular_error,
    floor_probability,
    penalised_errors,
)


def test_the_ipin_score_adds_fifteen_metres_per_storey() -> None:
    penalised = penalised_errors(np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.array([0, 1, 0, 2, 0]))
    assert penalised.tolist() == [1.0, 17.0, 3.0, 34.0, 5.0]
    assert ErrorStatistics.of(penalised).p75_m == 17.0


def test_circular_errors_are_errors_that_occurred() -> None:
    errors = np.arange(20.0, 0.0, -1.0)
    assert circular_error(errors, 0.50) == 10.0  # ten of twenty are no greater
    assert circular_error(errors, 0.95) == 19.0
    assert circular_error(np.array([2.0, 9.0, 4.0]), 0.50) == 4.0  # ⌈1.5⌉ = 2nd
    assert circular_error(np.array([2.0, 9.0, 4.0]), 0.95) == 9.0
    assert circular_error(np.zeros(0), 0.5) is None


def test_the_floor_probability_is_the_share_of_right_floors() -> None:
    assert floor_probability(np.array([True, True, False, True])) == 0.75
    assert floor_probability(np.zeros(0, dtype=bool)) is None


def test_a_curve_has_the_mean_and_third_quartile_of_every_bin() -> None:
    found = bin_errors(np.array([0.0, 9.9, 10.0, 35.0, 2.0]), np.array([1.0, 2.0, 5.0, 7.0, 6.0]), 10.0)
    assert found.middle.tolist() == [5.0, 15.0, 35.0]
    assert found.mean_m.tolist() == [3.0, 5.0, 7.0]
    assert found.p75_m.tolist() == [4.0, 5.0, 7.0]  # of 1, 2, 6: at index 1.5
    assert found.n.tolist() == [3, 1, 1]
    assert len(bin_errors(np.zeros(0), np.zeros(0), 10.0).n) == 0
