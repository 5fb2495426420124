"""Challengers compared while they run, by hand-computed cases and by the coverage of the interval."""

from __future__ import annotations

import numpy as np
import pytest

from tickfix.api import Belief, Estimate, Status, Truth
from tickfix.drivers.live.anytime import AnytimeMean
from tickfix.drivers.live.contest import Contest
from tickfix.drivers.live.saying import Saying


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


def said(pipeline: str, tick: int, x_m: float, device: str = "d", floor: str = "F") -> Saying:
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
    return Saying.of(estimate)


def truth(t_s: float, device: str = "d") -> Truth:
    return Truth(t_ns=round(t_s * 1e9), floor="F", xy=np.zeros(2), device=device)


def test_a_waypoint_scores_what_had_been_said_by_then() -> None:
    contest = Contest(["a", "b"], "a")
    for tick, (a, b) in enumerate([(1.0, 4.0), (2.0, 5.0), (9.0, 9.0)], 5):
        contest.said([said("a", tick, a), said("b", tick, b)])
    contest.truth(truth(1.25))  # ticks 5 and 6 are at 1.0 and 1.2 s
    report = contest.report()
    assert report["a"]["error_m"] == 2.0
    assert report["b"]["error_m"] == 5.0
    assert report["b"]["walks"] == 0
    assert report["b"]["apart_m"] == pytest.approx((3 + 3 + 0) / 3)
    assert report["a"]["innovation_m"] == pytest.approx(2 * (1 + 2 + 9) / 3)
    contest.finish("d")
    assert contest.report()["b"]["difference_m"] == 3.0
    assert contest.report()["b"]["walks"] == 1


def test_a_waypoint_counts_only_where_all_have_said_something_and_a_wrong_floor_costs() -> None:
    contest = Contest(["a", "b"], "a")
    contest.said([said("a", 5, 1.0)])
    contest.truth(truth(1.0))
    assert contest.report()["a"]["waypoints"] == 0
    contest.said([said("b", 5, 1.0, floor="G")])
    contest.truth(truth(1.0))
    assert contest.report()["b"]["error_m"] == 16.0
    contest.truth(truth(1.0, device="never heard of"))
    contest.finish("never heard of")


def test_each_walk_gives_one_difference_however_many_waypoints_it_has() -> None:
    contest = Contest(["a", "b"], "a")
    for n in range(22):
        device = f"d{n}"
        for tick in range(5, 5 + 3 * (n + 1)):
            contest.said([said("a", tick, 1.0, device), said("b", tick, 1.0 + 0.1 * n, device)])
            contest.truth(truth(0.2 * tick, device))
        contest.finish(device)
    report = contest.report()["b"]
    assert report["walks"] == 22
    assert report["difference_m"] == pytest.approx(0.1 * 10.5)
    low, high = report["interval_m"]
    assert low < 1.05 < high
