"""Intervals over seeds against scipy, and what they decide."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tickfix_papers.reproduction_report import Claim, SeedInterval
from tickfix_papers.seed_statistics import decide_claim, exact_value, mean, paired_difference, percent_reduction

VALUES = st.lists(st.floats(-1e3, 1e3).map(lambda x: round(x, 3)), min_size=2, max_size=30)


def claim(low: float, high: float, *, above: float = -np.inf, below: float = np.inf, why: str = "") -> Claim:
    interval = SeedInterval(mean=(low + high) / 2, low=low, high=high, seeds=10)
    return decide_claim("A is better than B", interval, paper="", ours="", above=above, below=below, why=why)


@given(VALUES.filter(lambda values: np.ptp(values) > 0.01))
def test_the_interval_is_that_of_students_t(values: list[float]) -> None:
    found = mean(values)
    low, high = stats.t.interval(0.95, len(values) - 1, loc=np.mean(values), scale=stats.sem(values))
    assert found.mean == pytest.approx(np.mean(values))
    assert (found.low, found.high) == (pytest.approx(low), pytest.approx(high))
    assert found.seeds == len(values)


def test_about_95_of_100_intervals_hold_the_truth() -> None:
    rng = np.random.default_rng(1)
    found = [mean(rng.normal(3.0, 2.0, 10)) for _ in range(4000)]
    assert np.mean([interval.low < 3.0 < interval.high for interval in found]) == pytest.approx(0.95, abs=0.01)


@pytest.mark.parametrize("values", [[], [1.0], [1.0, np.nan], [[1.0, 2.0], [3.0, 4.0]]])
def test_too_few_or_no_numbers_are_refused(values: list[float]) -> None:
    with pytest.raises(ValueError, match="at least two"):
        mean(values)


def test_what_seeds_have_in_common_cancels_in_a_difference() -> None:
    common = np.random.default_rng(2).normal(0.0, 100.0, 10)
    found = paired_difference(common + 1.0, common)
    assert (found.low, found.high) == (pytest.approx(1.0), pytest.approx(1.0))


def test_a_reduction_is_in_per_cent_of_what_was_before() -> None:
    found = percent_reduction([2.0, 4.0], [1.0, 3.0])
    assert found.mean == pytest.approx((50.0 + 25.0) / 2)


def test_a_claim_holds_only_if_the_whole_interval_is_on_its_side() -> None:
    assert claim(0.1, 0.3, above=0.0).holds
    assert claim(0.1, 0.3, above=0.0, why="never told").reason == ""
    assert claim(0.1, 0.3, above=0.0, below=0.4).holds
    undecided, reversed_, outside = (
        claim(-0.1, 0.3, above=0.0),
        claim(-0.3, -0.1, above=0.0),
        claim(5, 6, above=0, below=4),
    )
    assert not undecided.holds
    assert undecided.reason.startswith("undecided")
    assert (reversed_.holds, reversed_.reason) == (False, "the opposite holds")
    assert (outside.holds, outside.reason) == (False, "outside what is claimed")


def test_no_difference_is_not_better() -> None:
    found = claim(0.0, 0.0, above=0.0, why="Both are the same.")
    assert (found.holds, found.reason) == (False, "no difference at all. Both are the same.")


def test_figures_are_printed_with_half_their_interval() -> None:
    assert SeedInterval(mean=2.614, low=2.5, high=2.728, seeds=10).text() == "2.61 ± 0.11"
    assert SeedInterval(mean=2.614, low=2.5, high=2.728, seeds=10).text(1, "m") == "2.6 ± 0.1 m"
    assert exact_value(91.0).text(0) == "91"
    assert mean([0.1 + 0.2, 0.3, 0.3]).text() == "0.30"
