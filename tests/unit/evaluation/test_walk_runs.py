"""Figures, summaries and tables."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from tickfix.api import TICK_NS, Truth
from tickfix.evaluation.error_metrics import ErrorStatistics
from tickfix.evaluation.report.terminal import pooled_table, walk_table
from tickfix.evaluation.scoring import Coverage
from tickfix.evaluation.tracks import digest, pooled_digest
from tickfix.evaluation.walk_runs import RunSummary, WalkResult, evaluate_walk, summarise

ERRORS = st.lists(st.floats(0, 1e4), min_size=1, max_size=60).map(np.array)
COVERAGE = Coverage([("F1", np.array([[0.0, 0.0], [3.0, 0.0]]))])


def test_the_figures_of_five_errors_are_those_computed_by_hand() -> None:
    error_statistics = ErrorStatistics.of(np.array([4.0, 1.0, 3.0, 2.0, 10.0]))
    assert error_statistics.as_json() == {
        "n": 5,
        "mean_m": 4.0,
        "median_m": 3.0,
        "p75_m": 4.0,
        "p90_m": pytest.approx(7.6),  # at index 0.9·4 = 3.6, between 4 and 10
        "p95_m": pytest.approx(8.8),
        "max_m": 10.0,
        "rmse_m": pytest.approx(26.0**0.5),
    }


def test_no_errors_have_no_figures_rather_than_nan() -> None:
    error_statistics = ErrorStatistics.of(np.zeros(0)).as_json()
    assert error_statistics.pop("n") == 0
    assert set(error_statistics.values()) == {None}


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_error_that_is_not_finite_is_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="not finite"):
        ErrorStatistics.of(np.array([1.0, bad]))


@given(ERRORS)
def test_percentiles_are_ordered_and_means_lie_within_the_range(errors: Any) -> None:
    f = ErrorStatistics.of(errors)
    ordered = [f.median_m, f.p75_m, f.p90_m, f.p95_m, f.max_m]
    assert ordered == sorted(ordered)  # type: ignore[type-var]
    assert f.mean_m is not None
    assert f.rmse_m is not None
    assert f.max_m == errors.max()
    assert errors.min() - 1e-9 <= f.mean_m <= f.rmse_m * (1 + 1e-9) + 1e-9
    assert f.rmse_m <= f.max_m * (1 + 1e-9) + 1e-9


@given(ERRORS, st.randoms(use_true_random=False))
def test_the_order_of_errors_changes_no_figure(errors: Any, random: Any) -> None:
    shuffled = errors.tolist()
    random.shuffle(shuffled)
    assert ErrorStatistics.of(np.array(shuffled)).as_json() == pytest.approx(ErrorStatistics.of(errors).as_json())


def result(track_of: Any, name: str, **places: Any) -> WalkResult:
    """A walk along x from 1 m, a metre a tick, with a waypoint at each tick."""
    tracks = {pipeline: track_of(where, pipeline=pipeline) for pipeline, where in places.items()}
    count = max(map(len, places.values()), default=0)
    truth = [Truth(t_ns=k * TICK_NS, floor="F1", xy=np.array([float(k), 0.0])) for k in range(1, count + 1)]
    return evaluate_walk(name, "F1", truth, published=tracks, settled=tracks, coverage=COVERAGE)


@pytest.fixture
def run(track_of: Any) -> RunSummary:
    first = result(track_of, "one", wifi=[None, (2, 4), (3, 2)], fusion=[(1, 0), (2, 0), (3, 1)])
    second = result(track_of, "two", wifi=[(1, 6)] + [None] * 8, fusion=[(1, 3)] + [(50, 0)] * 8)
    third = result(track_of, "three", wifi=[None] * 6 + [(7, 8)], fusion=[None] * 6 + [(7, 4)])
    return summarise([first, second, third], {"accepted": 40, "late": 2})


def test_the_summary_pools_the_waypoints_of_all_walks(run: RunSummary) -> None:
    wifi, fusion = run.pipelines["wifi"], run.pipelines["fusion"]
    # Scored are the second and third of the first walk, the first of the second, the last of the third.
    assert (wifi.error_statistics.n, wifi.error_statistics.mean_m, wifi.error_statistics.max_m) == (4, 5.0, 8.0)
    assert (fusion.error_statistics.n, fusion.error_statistics.mean_m, fusion.error_statistics.max_m) == (4, 2.0, 4.0)
    assert wifi.error_statistics.rmse_m == pytest.approx((120 / 4) ** 0.5)
    assert (wifi.availability, fusion.availability) == (4 / 19, 13 / 19)
    # The survey ended at x = 3 m: x = 7 m is out of its reach.
    assert (wifi.covered_share, wifi.covered.n, wifi.covered.mean_m) == (0.75, 3, 4.0)
    assert (fusion.covered_share, fusion.covered.n, fusion.covered.mean_m) == (0.75, 3, pytest.approx(4 / 3))
    assert wifi.floor_probability == 1.0


def test_walks_keep_their_own_figures_and_digests(run: RunSummary, track_of: Any) -> None:
    one, two, _ = run.walks
    assert (one.name, one.floor, one.waypoints, one.scored) == ("one", "F1", 3, 2)
    assert (two.waypoints, two.scored) == (9, 1)
    assert one.pipelines["wifi"].error_statistics.mean_m == 3.0
    assert one.pipelines["wifi"].published == digest(track_of([None, (2, 4), (3, 2)]))
    assert run.pipelines["wifi"].settled == pooled_digest([walk.pipelines["wifi"].settled for walk in run.walks])


def test_the_json_object_has_exactly_the_promised_keys_and_no_nan(run: RunSummary) -> None:
    document = json.loads(json.dumps(run.as_json(), allow_nan=False))
    error_statistics = ["n", "mean_m", "median_m", "p75_m", "p90_m", "p95_m", "max_m", "rmse_m"]
    assert list(document) == ["pipelines", "walks", "intake"]
    assert document["intake"] == {"accepted": 40, "late": 2}
    assert list(document["pipelines"]) == ["wifi", "fusion"]
    for objects in (document["pipelines"], *(walk["pipelines"] for walk in document["walks"])):
        for pipeline in objects.values():
            assert list(pipeline) == [
                *error_statistics,
                "availability",
                "floor_probability",
                "published",
                "settled",
                "covered",
            ]
            assert list(pipeline["covered"]) == ["share", *error_statistics]
            assert len(pipeline["published"]) == len(pipeline["settled"]) == 64
    assert list(document["walks"][0]) == ["name", "floor", "waypoints", "scored", "pipelines"]


def test_a_run_in_which_nothing_is_scored_has_none_for_every_figure(track_of: Any) -> None:
    summary = summarise([result(track_of, "w", a=[None], b=[(1, 0)]), result(track_of, "v", a=[], b=[])], {})
    a, b = summary.pipelines["a"], summary.pipelines["b"]
    assert (a.error_statistics.n, a.error_statistics.mean_m, a.covered_share, a.floor_probability, a.covered.p95_m) == (
        0,
        None,
        None,
        None,
        None,
    )
    assert (a.availability, b.availability) == (0.0, 1.0)
    assert summary.walks[1].pipelines["a"].availability is None
    json.dumps(summary.as_json(), allow_nan=False)
    assert "–" in shown(summary)


def test_a_run_without_walks_has_no_pipelines() -> None:
    assert summarise([], {}).as_json() == {"pipelines": {}, "walks": [], "intake": {}}


def test_walks_of_different_pipelines_are_not_pooled(track_of: Any) -> None:
    with pytest.raises(ValueError, match="walk v: found pipelines b"):
        summarise([result(track_of, "w", a=[(0, 0)]), result(track_of, "v", b=[(0, 0)])], {})


def test_the_order_of_pipelines_changes_no_figure(track_of: Any) -> None:
    places = {"a": [(1, 0), None, (3, 3)], "b": [(1, 1), (2, 0), (3, 0)]}
    forward = summarise([result(track_of, "w", **places)], {}).as_json()
    backward = summarise([result(track_of, "w", **dict(reversed(places.items())))], {}).as_json()
    assert forward == backward
    assert list(backward["pipelines"]) == ["b", "a"]


def shown(summary: RunSummary, **options: Any) -> str:
    console = Console(width=100, record=True, file=open("/dev/null", "w"), color_system="standard")  # noqa: SIM115, PTH123
    with console.file:
        console.print(pooled_table(summary), walk_table(summary))
        return console.export_text(**options)


def test_the_tables_fit_into_a_hundred_columns_without_cutting_a_number(run: RunSummary) -> None:
    text = shown(run)
    assert max(map(len, text.splitlines())) <= 100
    assert "…" not in text
    assert "4 of 19 waypoints of 3 walks scored, 75.0 % of them covered by the survey" in text
    assert [line.split() for line in text.splitlines() if line.strip().startswith("wifi")] == [
        ["wifi", "5.00", "5.00", "6.50", "7.40", "7.70", "8.00", "5.48", "4.00", "100.0", "%", "21.1", "%"]
    ]


def test_the_best_of_each_column_is_bold_and_a_tie_of_all_is_not(run: RunSummary) -> None:
    text = shown(run, styles=True)
    assert "\x1b[1m2.00\x1b[0m" in text
    assert "\x1b[1m5.00" not in text
    assert "\x1b[1m100.0 %" not in text
    assert "\x1b[1m68.4 %\x1b[0m" in text


def test_a_name_with_markup_is_shown_as_it_is(track_of: Any) -> None:
    summary = summarise([result(track_of, "[red]w", **{"pf[particles=50]": [(1, 0)]})], {})
    text = shown(summary)
    assert "pf[particles=50]" in text
    assert "[red]w" in text
