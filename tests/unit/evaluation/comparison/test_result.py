"""Trials become figures, comparisons, and the object that --json prints."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from tickfix.api import ConfigError
from tickfix.evaluation.comparison.points import Scope, chain_names, points_of
from tickfix.evaluation.comparison.result import METRICS, Result, result_of
from tickfix.evaluation.comparison.trial import Trial
from tickfix.evaluation.statistics.verdict import Answer

HOUR_NS = 3_600_000_000_000


def along(count: int, off_m: float, rng: Any = None) -> list[tuple[float, float]]:
    """Places beside a walk along x, off by a distance, more or less where ``rng`` says."""
    return [(float(k), off_m * (1.0 if rng is None else 0.8 + 0.4 * rng.random())) for k in range(1, count + 1)]


@pytest.fixture
def trials(trial_of: Any) -> list[Trial]:
    """Eight walks with two seeds: B errs by 1 m more than A, on the last walk by 1 m less."""
    made = []
    for i in range(8):
        for seed in (0, 1):
            rng = np.random.default_rng([i, seed])
            off = 1.0 if i == 7 else 3.0
            a, b = along(25, 2.0, rng), along(25, off, rng)
            made.append(trial_of(f"w{i}", seed=seed, began_ns=i * HOUR_NS, every=3, A=a, B=b, same=a))
    return made


@pytest.fixture
def result(trials: list[Trial]) -> Result:
    return result_of(trials, baseline="A", provenance={"seeds": [0, 1]})


def test_a_pipeline_against_itself_is_identical_and_a_worse_one_is_found(result: Result) -> None:
    verdicts = {c.pipeline: c for c in result.verdicts()}
    assert verdicts["same"].answer is Answer.IDENTICAL
    assert verdicts["same"].verdict == "same and A do not differ at all (8 walks)"
    assert verdicts["B"].answer is Answer.WORSE  # seven of eight walks by 1 m, the other is better by 1 m
    assert verdicts["B"].interval.difference_m == pytest.approx(0.75, abs=0.1)
    assert (verdicts["B"].walks, verdicts["B"].chains, verdicts["B"].points) == (8, 8, 144)
    assert {walk for walk, _ in verdicts["B"].worse_on} == {f"w{i}" for i in range(7)}


def test_seeds_are_repetitions_of_a_walk_and_no_walks_of_their_own(result: Result, trials: list[Trial]) -> None:
    once = result_of([trial for trial in trials if trial.seed == 0], baseline="A")
    (many,), (few,) = ([c for c in r.verdicts() if c.pipeline == "B"] for r in (result, once))
    assert many.walks == few.walks == 8
    assert many.points == 2 * few.points
    assert result.figures["A"]["seed_spread_m"] > 0.0
    assert once.figures["A"]["seed_spread_m"] is None


def test_every_metric_is_compared_in_its_scopes(result: Result) -> None:
    compared = {(c.metric, c.scope) for c in result.comparisons}
    expected = {(metric, scope) for metric in METRICS for scope in ("all", "covered")}
    assert compared == expected | {("mean", "interpolated"), ("rmse", "interpolated")}


def test_the_scopes_have_the_points_that_the_page_promises(trial_of: Any) -> None:
    trial = trial_of("w", A=[None, *along(9, 1.0)], B=[*along(9, 1.0), None])
    assert len(points_of([trial], Scope.ALL)) == 8  # each lacks one end
    assert len(points_of([trial], Scope.COVERED)) == 5  # 2 … 6 m; the survey ended at 3 m and reaches 3 m further
    seldom = trial_of("w", every=3, A=[None, *along(9, 1.0)], B=[*along(9, 1.0), None])
    between = points_of([seldom], Scope.INTERPOLATED)
    assert between.t_s.tolist() == [1.0]  # waypoints at 0, 0.6, 1.2 and 1.8 s
    assert between.travelled_m == pytest.approx([5.0])


def test_walks_that_follow_each_other_are_one_chain(trial_of: Any) -> None:
    first = trial_of("one", A=along(5, 1.0))
    second = trial_of("two", began_ns=10**9, A=[(float(6 - k), 0.0) for k in range(1, 6)])
    assert set(chain_names([first, second]).values()) == {"one", "two"}  # it begins 4 m away
    third = trial_of("three", ground="other", A=along(5, 1.0))
    points = points_of([first, second, third], Scope.ALL)
    assert points.walks == ("three", "one", "two")
    assert points.chain[-1] == points.walk[-1] == 0


def test_walks_of_one_name_on_two_sites_are_two_walks(trial_of: Any) -> None:
    both = [trial_of("w", ground=ground, A=along(5, 1.0)) for ground in ("north", "south")]
    assert points_of(both, Scope.ALL).walks == ("north: w", "south: w")
    assert [part.ground for part in result_of(both, baseline="A").grounds] == ["north", "south"]


def test_the_object_is_that_of_replay_and_more(result: Result) -> None:
    document = json.loads(json.dumps(result.as_json(), allow_nan=False))
    assert set(document) == {
        *("pipelines", "walks", "intake"),
        *("baseline", "metric", "comparisons", "grounds", "provenance"),
    }
    walk = document["walks"][1]
    assert (walk["name"], walk["seed"], walk["ground"], walk["chain"]) == ("w0", 1, "site", "w0")
    assert set(walk["pipelines"]["A"]) == {
        *("n", "mean_m", "median_m", "p75_m", "p90_m", "p95_m", "max_m", "rmse_m"),
        *("availability", "floor_hit", "published", "settled", "covered"),
    }
    figures = document["pipelines"]["B"]["figures"]
    assert figures["all"]["mean_m"] == document["pipelines"]["B"]["mean_m"]
    assert figures["tracks"]["availability"] == 1.0
    assert figures["cost"]["tick_us"] == pytest.approx(2.0)
    assert document["intake"] == {"accepted": 160}


def test_names_that_are_not_there_are_refused(trials: list[Trial]) -> None:
    with pytest.raises(ConfigError, match=r"--baseline: found 'C'; expected one of A, B, same"):
        result_of(trials, baseline="C")
    with pytest.raises(ConfigError, match=r"--metric: found 'max'; expected one of mean, median"):
        result_of(trials, baseline="A", metric="max")
    with pytest.raises(ConfigError, match="no walks"):
        result_of([], baseline="A")


def test_a_run_in_which_nothing_is_scored_has_no_verdicts_and_no_nan(trial_of: Any) -> None:
    result = result_of([trial_of("w", A=[None, None], B=along(2, 1.0))], baseline="A")
    assert result.verdicts() == ()
    json.dumps(result.as_json(), allow_nan=False)
