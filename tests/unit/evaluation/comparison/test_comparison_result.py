"""Trials become figures, comparisons, and the object that --json prints."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from tickfix.api import ConfigError
from tickfix.evaluation.comparison.comparison_result import METRICS, ComparisonResult, compare_trials
from tickfix.evaluation.comparison.pooled_metrics import Scope, chain_names, pool_samples
from tickfix.evaluation.comparison.trials import Trial
from tickfix.evaluation.paired_comparison import Conclusion

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
def result(trials: list[Trial]) -> ComparisonResult:
    return compare_trials(trials, baseline="A", provenance={"seeds": [0, 1]})


def test_a_pipeline_against_itself_is_identical_and_a_worse_one_is_found(result: ComparisonResult) -> None:
    verdicts = {c.pipeline: c for c in result.verdicts()}
    assert verdicts["same"].conclusion is Conclusion.IDENTICAL
    assert verdicts["same"].verdict == "same and A do not differ at all (8 walks)"
    assert verdicts["B"].conclusion is Conclusion.WORSE  # seven of eight walks by 1 m, the other is better by 1 m
    assert verdicts["B"].interval.difference_m == pytest.approx(0.75, abs=0.1)
    assert (verdicts["B"].walks, verdicts["B"].chains, verdicts["B"].samples) == (8, 8, 144)
    assert {walk for walk, _ in verdicts["B"].worse_walks} == {f"w{i}" for i in range(7)}


def test_seeds_are_repetitions_of_a_walk_and_no_walks_of_their_own(
    result: ComparisonResult, trials: list[Trial]
) -> None:
    once = compare_trials([trial for trial in trials if trial.seed == 0], baseline="A")
    (many,), (few,) = ([c for c in r.verdicts() if c.pipeline == "B"] for r in (result, once))
    assert many.walks == few.walks == 8
    assert many.samples == 2 * few.samples
    assert result.metrics["A"]["seed_deviation_m"] > 0.0
    assert once.metrics["A"]["seed_deviation_m"] is None


def test_every_metric_is_compared_in_its_scopes(result: ComparisonResult) -> None:
    compared = {(c.metric, c.scope) for c in result.comparisons}
    expected = {(metric, scope) for metric in METRICS for scope in ("all", "covered")}
    assert compared == expected | {("mean", "interpolated"), ("rmse", "interpolated")}


def test_the_scopes_have_the_points_that_the_page_promises(trial_of: Any) -> None:
    trial = trial_of("w", A=[None, *along(9, 1.0)], B=[*along(9, 1.0), None])
    assert len(pool_samples([trial], Scope.ALL)) == 8  # each lacks one end
    assert len(pool_samples([trial], Scope.COVERED)) == 5  # 2 … 6 m; the survey ended at 3 m and reaches 3 m further
    seldom = trial_of("w", every=3, A=[None, *along(9, 1.0)], B=[*along(9, 1.0), None])
    between = pool_samples([seldom], Scope.INTERPOLATED)
    assert between.t_s.tolist() == [1.0]  # waypoints at 0, 0.6, 1.2 and 1.8 s
    assert between.travelled_m == pytest.approx([5.0])


def test_walks_that_follow_each_other_are_one_chain(trial_of: Any) -> None:
    first = trial_of("one", A=along(5, 1.0))
    second = trial_of("two", began_ns=10**9, A=[(float(6 - k), 0.0) for k in range(1, 6)])
    assert set(chain_names([first, second]).values()) == {"one", "two"}  # it begins 4 m away
    third = trial_of("three", site="other", A=along(5, 1.0))
    samples = pool_samples([first, second, third], Scope.ALL)
    assert samples.walks == ("three", "one", "two")
    assert samples.chain[-1] == samples.walk[-1] == 0


def test_walks_of_one_name_on_two_sites_are_two_walks(trial_of: Any) -> None:
    both = [trial_of("w", site=site, A=along(5, 1.0)) for site in ("north", "south")]
    assert pool_samples(both, Scope.ALL).walks == ("north: w", "south: w")
    assert [part.site for part in compare_trials(both, baseline="A").sites] == ["north", "south"]


def test_the_object_is_that_of_replay_and_more(result: ComparisonResult) -> None:
    document = json.loads(json.dumps(result.as_json(), allow_nan=False))
    assert set(document) == {
        *("pipelines", "walks", "intake"),
        *("baseline", "metric", "comparisons", "sites", "provenance"),
    }
    walk = document["walks"][1]
    assert (walk["name"], walk["seed"], walk["site"], walk["chain"]) == ("w0", 1, "site", "w0")
    assert set(walk["pipelines"]["A"]) == {
        *("n", "mean_m", "median_m", "p75_m", "p90_m", "p95_m", "max_m", "rmse_m"),
        *("availability", "floor_probability", "published", "settled", "covered"),
    }
    metrics = document["pipelines"]["B"]["metrics"]
    assert metrics["all"]["mean_m"] == document["pipelines"]["B"]["mean_m"]
    assert metrics["tracks"]["availability"] == 1.0
    assert metrics["cost"]["tick_us"] == pytest.approx(2.0)
    assert document["intake"] == {"accepted": 160}


def test_names_that_are_not_there_are_refused(trials: list[Trial]) -> None:
    with pytest.raises(ConfigError, match=r"--baseline: found 'C'; expected one of A, B, same"):
        compare_trials(trials, baseline="C")
    with pytest.raises(ConfigError, match=r"--metric: found 'max'; expected one of mean, median"):
        compare_trials(trials, baseline="A", metric="max")
    with pytest.raises(ConfigError, match="no walks"):
        compare_trials([], baseline="A")


def test_a_run_in_which_nothing_is_scored_has_no_verdicts_and_no_nan(trial_of: Any) -> None:
    result = compare_trials([trial_of("w", A=[None, None], B=along(2, 1.0))], baseline="A")
    assert result.verdicts() == ()
    json.dumps(result.as_json(), allow_nan=False)
