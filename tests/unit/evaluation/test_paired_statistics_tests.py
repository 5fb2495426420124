"""The permutation test, Holm's correction and the number of walks, against values computed by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tickfix.evaluation.paired_statistics import (
    STATISTICS,
    PairedErrors,
    detectable_m,
    holm_correction,
    number_labels,
    permutation_p_value,
    walks_needed,
)

MEAN = STATISTICS["mean"]


def pair(differences: list[float], chain: list[int] | None = None) -> PairedErrors:
    """A baseline of 10 m everywhere, one walk a point."""
    n = len(differences)
    return PairedErrors(
        baseline_m=np.full(n, 10.0),
        pipeline_m=10.0 + np.array(differences),
        walk=np.arange(n),
        chain=np.arange(n) if chain is None else np.array(chain),
    )


def test_few_chains_are_swapped_in_every_way() -> None:
    rng = np.random.default_rng(0)
    assert (
        permutation_p_value(pair([-1.0, -2.0, -3.0, -4.0]), MEAN, rng) == 2 / 16
    )  # only none and all swapped are as great
    # Sums as great as 1 + 2 + 3 − 1 = 5: none swapped, the last, the first and the last; and their opposites.
    assert permutation_p_value(pair([1.0, 2.0, 3.0, -1.0]), MEAN, rng) == 6 / 16
    # One chain of four: it is swapped as a whole.
    assert permutation_p_value(pair([-1.0, -2.0, -3.0, -4.0], [0, 0, 0, 0]), MEAN, rng) == 1.0


@pytest.mark.parametrize("chains", [6, 9, 12])
def test_few_chains_agree_with_the_exact_test_of_scipy(chains: int) -> None:
    differences = np.random.default_rng(chains).normal(0.5, 1.0, chains)
    ours = permutation_p_value(pair(differences.tolist()), MEAN, np.random.default_rng(0))
    theirs = stats.permutation_test((differences,), np.mean, permutation_type="samples", n_resamples=np.inf).pvalue
    assert ours == pytest.approx(theirs)


def test_many_chains_agree_with_another_implementation() -> None:
    differences = np.random.default_rng(1).normal(0.3, 1.0, 40)
    ours = permutation_p_value(pair(differences.tolist()), MEAN, np.random.default_rng(2))
    theirs = stats.permutation_test(
        (differences,), np.mean, permutation_type="samples", n_resamples=20000, random_state=3
    ).pvalue
    assert ours == pytest.approx(theirs, abs=0.015)


def test_equal_pipelines_have_p_one() -> None:
    for statistic in STATISTICS.values():
        assert permutation_p_value(pair([0.0] * 30), statistic, np.random.default_rng(0)) == 1.0


def test_holm_multiplies_step_by_step_and_keeps_the_order() -> None:
    assert holm_correction([0.01, 0.04, 0.03]) == pytest.approx((0.03, 0.06, 0.06))
    assert holm_correction([0.5, 0.6]) == (1.0, 1.0)
    assert holm_correction([]) == ()
    assert holm_correction([0.02]) == (0.02,)


def test_the_number_of_walks_grows_with_the_square_of_the_ratio() -> None:
    # z₀.₉₇₅ + z₀.₈₀ = 1.95996 + 0.84162 = 2.80158
    assert detectable_m(0.1) == pytest.approx(0.280158, abs=1e-6)
    assert walks_needed(25, 0.1, -0.2) == 50  # 25 · 1.40079² = 49.06
    assert walks_needed(25, 0.1, 0.280159) == 25
    assert walks_needed(25, 0.1, 0.0) is None


def test_numbers_follow_the_order_of_labels() -> None:
    assert number_labels(["b", "a", "b", "c"]).tolist() == [1, 0, 1, 2]
    assert number_labels([]).tolist() == []


def test_errors_that_are_not_finite_or_of_unequal_number_are_refused() -> None:
    with pytest.raises(ValueError, match="not finite"):
        pair([np.nan])
    with pytest.raises(ValueError, match="as many"):
        PairedErrors(baseline_m=np.ones(2), pipeline_m=np.ones(1), walk=np.zeros(2), chain=np.zeros(2))
