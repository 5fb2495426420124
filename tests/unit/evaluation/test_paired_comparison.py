"""Verdicts are sentences that say no more than is known."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tickfix.evaluation.paired_comparison import Conclusion, PairedComparison, compare_with_baseline
from tickfix.evaluation.paired_statistics import STATISTICS, PairedErrors


def judged(differences: list[float], chain: list[int] | None = None) -> PairedComparison:
    n = len(differences)
    paired = PairedErrors(
        baseline_m=np.full(n, 5.0),
        pipeline_m=5.0 + np.array(differences),
        walk=np.arange(n),
        chain=np.arange(n) if chain is None else np.array(chain),
    )
    names = [f"w{i}" for i in range(n)]
    (found,) = compare_with_baseline(
        {"B": paired}, baseline="A", metric="mean", scope="all", statistic=STATISTICS["mean"], walks=names
    )
    return found


def test_a_clear_difference_is_told_with_interval_test_and_walks() -> None:
    better = judged([-1.0, -1.2, -0.8, -1.1, -0.9, -1.0, -1.0, -1.3, 0.1, -0.7, -1.1, -1.0])
    assert better.conclusion is Conclusion.BETTER
    assert better.verdict.startswith("B is 0.92 m better than A in mean (95 % CI 0.")
    assert better.verdict.endswith(", p < 0.001, 12 walks); worse on 1 of them")
    assert better.worse_walks == (("w8", pytest.approx(0.1)),)
    worse = judged([1.0] * 6 + [1.1])
    assert worse.verdict == "B is 1.01 m worse than A in mean (95 % CI 1.00–1.06 m, p = 0.016, 7 walks)"


def test_an_unclear_difference_says_how_many_walks_would_tell() -> None:
    found = judged([-2.0, 2.1, -1.5, 1.0, -0.6, 0.4, -1.0, 1.2])
    assert found.conclusion is Conclusion.INCONCLUSIVE
    assert found.verdict.startswith("cannot tell: B is 0.05 m better than A in mean (95 % CI ")
    assert found.walks_needed is not None
    assert found.verdict.endswith(f"about {found.walks_needed} walks would be needed")
    assert found.walks_needed > 1000


def test_too_few_chains_cannot_tell_however_great_the_difference() -> None:
    assert "5 independent chains of walks are too few" in judged([-3.0, -3.1, -3.2, -3.0, -2.9]).verdict
    alone = judged([-3.0, -3.1], [0, 0])
    assert alone.verdict == ("cannot tell: B is 3.05 m better than A in mean, but 2 walks of one chain have no spread")
    assert alone.as_json()["interval_m"] is None


def test_the_object_has_what_was_promised_and_no_nan() -> None:
    document = json.loads(json.dumps(judged([-1.0, 0.5, 0.2, 0.1, -0.3, 0.4, 0.2]).as_json(), allow_nan=False))
    assert set(document) >= {"pipeline", "metric", "difference_m", "interval_m", "p", "walks", "verdict"}
    assert document["interval_m"][0] < document["difference_m"] < document["interval_m"][1]
    assert [one["walk"] for one in document["worse_walks"]] == ["w1", "w5", "w2", "w6", "w3"]


def test_without_points_there_is_no_comparison() -> None:
    none = PairedErrors(baseline_m=np.zeros(0), pipeline_m=np.zeros(0), walk=np.zeros(0), chain=np.zeros(0))
    assert (
        compare_with_baseline({"B": none}, baseline="A", metric="mean", scope="all", statistic=STATISTICS["mean"]) == ()
    )
