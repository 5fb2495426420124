"""Challengers compared while they run, by hand-computed cases and by the coverage of the interval."""

from __future__ import annotations

import numpy as np
import pytest

from tickfix.api import Belief, Estimate, Status, Truth
from tickfix.live.live_comparison import AnytimeMean, LiveComparison
from tickfix.live.protocol import EncodedEstimate


@pytest.mark.parametrize(("law", "share"), [("normal", 0.05), ("heavy", 0.05), ("skewed", 0.12)])
def test_the_mean_stays_inside_however_often_one_looks(law: str, share: float) -> None:
    rng, left, naive_left = np.random.default_rng(5), 0, 0
    for _ in range(400):
        laws = {"normal": rng.normal, "heavy": rng.laplace}
        values = rng.exponential(1.0, 400) - 0.7 if law == "skewed" else laws[law](0.3, 1.0, 400)
        mean, outside, naive = AnytimeMean(), False, False
        for n, value in enumerate(values.tolist(), 1):
            mean.add(value)
            if mean.interval is not None:
                outside |= not mean.interval[0] <= 0.3 <= mean.interval[1]
                naive |= abs(mean.mean - 0.3) > 1.96 * float(values[:n].std(ddof=1)) / n**0.5
        left += outside
        naive_left += naive
    assert left <= share * 400
    assert naive_left > 0.25 * 400, "a plain interval would do, and this one is not needed"


def test_the_interval_finds_a_difference_in_the_end() -> None:
    mean, rng = AnytimeMean(), np.random.default_rng(1)
    for value in rng.normal(-0.5, 1.0, 200).tolist():
        mean.add(value)
    assert mean.interval is not None
    assert mean.interval[1] < 0.0
    assert mean.mean == pytest.approx(-0.5, abs=0.2)


def estimates(pipeline: str, tick: int, x_m: float, device: str = "d", floor: str = "F") -> EncodedEstimate:
    belief = Belief(floor=floor, xy=np.array([x_m, 0.0]), covariance=np.eye(2))
    estimate = Estimate(
        device=device,
        pipeline=pipeline,
        epoch=0,
        tick=tick,
        t_ns=tick * 200_000_000,
        status=Status.TRACKING,
        belief=belief,
        innovation_m=2.0 * x_m,
    )
    return EncodedEstimate.of(estimate)


def truth(t_s: float, device: str = "d") -> Truth:
    return Truth(t_ns=round(t_s * 1e9), floor="F", xy=np.zeros(2), device=device)


def test_a_waypoint_scores_what_had_been_said_by_then() -> None:
    comparison = LiveComparison(["a", "b"], "a")
    for tick, (a, b) in enumerate([(1.0, 4.0), (2.0, 5.0), (9.0, 9.0)], 5):
        comparison.estimates([estimates("a", tick, a), estimates("b", tick, b)])
    comparison.truth(truth(1.25))  # ticks 5 and 6 are at 1.0 and 1.2 s
    report = comparison.report()
    assert report["a"]["error_m"] == 2.0
    assert report["b"]["error_m"] == 5.0
    assert report["b"]["walks"] == 0
    assert report["b"]["divergence_m"] == pytest.approx((3 + 3 + 0) / 3)
    assert report["a"]["innovation_m"] == pytest.approx(2 * (1 + 2 + 9) / 3)
    comparison.finish("d")
    assert comparison.report()["b"]["difference_m"] == 3.0
    assert comparison.report()["b"]["walks"] == 1


def test_a_waypoint_counts_only_where_all_have_said_something_and_a_wrong_floor_costs() -> None:
    comparison = LiveComparison(["a", "b"], "a")
    comparison.estimates([estimates("a", 5, 1.0)])
    comparison.truth(truth(1.0))
    assert comparison.report()["a"]["waypoints"] == 0
    comparison.estimates([estimates("b", 5, 1.0, floor="G")])
    comparison.truth(truth(1.0))
    assert comparison.report()["b"]["error_m"] == 16.0
    comparison.truth(truth(1.0, device="never heard of"))
    comparison.finish("never heard of")


def test_each_walk_gives_one_difference_however_many_waypoints_it_has() -> None:
    comparison = LiveComparison(["a", "b"], "a")
    for n in range(22):
        device = f"d{n}"
        for tick in range(5, 5 + 3 * (n + 1)):
            comparison.estimates([estimates("a", tick, 1.0, device), estimates("b", tick, 1.0 + 0.1 * n, device)])
            comparison.truth(truth(0.2 * tick, device))
        comparison.finish(device)
    report = comparison.report()["b"]
    assert report["walks"] == 22
    assert report["difference_m"] == pytest.approx(0.1 * 10.5)
    low, high = report["interval_m"]
    assert low < 1.05 < high
