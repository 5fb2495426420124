"""Comparisons from Python are those of the command line; fingerprints keep scikit-learn's manners."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import tickfix
from tickfix.api import ConfigError, SiteError
from tickfix.config import load_config
from tickfix.evaluation.walk_runs import WalkOptions, pool_runs, prepare, run_walks
from tickfix.registry import discover
from tickfix.simulation import DemoScenario
from tickfix.site import FingerprintTable

RSSI = np.array([[-40.0, -70.0, -80.0], [-70.0, -40.0, -75.0], [-80.0, -75.0, -40.0]])
PLACES = np.array([[0.0, 0.0], [10.0, 0.0], [5.0, 8.0]])


@pytest.fixture(scope="module")
def comparison(office: DemoScenario, site: tickfix.Site) -> tickfix.Comparison:
    walks = [walk.recording for walk in office.walks[:2]]
    return tickfix.compare(
        {"few": {"fingerprint": {"use": "wknn"}, "filter": "fixes"}, "kalman": "kalman"}, walks, site
    )


def test_its_figures_are_those_of_a_replay(
    comparison: tickfix.Comparison, office: DemoScenario, site: tickfix.Site
) -> None:
    config = load_config(None, discover()).only(["wifi", "kalman"])
    runs = list(run_walks(prepare(site, config), [w.recording for w in office.walks[:2]], WalkOptions()))
    summary, _ = pool_runs(runs)
    assert comparison.pipelines == ("few", "kalman")
    frame = comparison.to_pandas()
    for ours, theirs in (("few", "wifi"), ("kalman", "kalman")):
        assert frame.loc[ours, "mean_m"] == summary.pipelines[theirs].error_statistics.mean_m
        assert np.mean(comparison.errors[ours]) == pytest.approx(frame.loc[ours, "mean_m"])
        assert comparison.result.summary.pipelines[ours].published == summary.pipelines[theirs].published
    assert len(comparison.verdicts) == 1
    assert "kalman" in repr(comparison)


def test_it_shows_and_reports_itself(comparison: tickfix.Comparison, tmp_path: Path) -> None:
    assert "<th>few</th>" in comparison._repr_html_()
    page = comparison.report(tmp_path / "made" / "ab")
    assert page.read_text("utf-8").startswith("<!DOCTYPE html>")
    document = json.loads((page.parent / "report.json").read_text("utf-8"))
    assert document["baseline"] == "few"


def test_walks_that_were_held_out_are_the_default(office: DemoScenario) -> None:
    site = tickfix.survey([walk.recording for walk in office.survey[:6]], holdout=0.5, pipelines="wifi")
    with pytest.raises(SiteError, match="was simulated and has no file"):
        tickfix.compare("wifi", None, site)


def test_mistakes_are_named(office: DemoScenario, site: tickfix.Site) -> None:
    walk = office.walks[0].recording
    with pytest.raises(ConfigError, match="several walks called 'walk-F1-01'"):
        tickfix.compare("wifi", [walk, walk], site)
    surveyed = office.survey[0].recording
    with pytest.warns(tickfix.TickfixWarning, match=f"{surveyed.name}: part of the survey"):
        tickfix.compare("wifi", [surveyed], site)
    with pytest.raises(ConfigError, match="no walks"):
        tickfix.compare("wifi", [], site)


def test_fit_predict_and_score_on_arrays() -> None:
    nearest = tickfix.FingerprintEstimator("wknn", k=1)
    assert nearest.fit(RSSI, PLACES) is nearest
    assert nearest.predict(RSSI + 1.0).tolist() == PLACES.tolist()
    assert nearest.score(RSSI, PLACES) == 0.0
    assert nearest.score(RSSI[:2], PLACES[1::-1]) == pytest.approx(-10.0)
    assert np.isnan(nearest.predict([[np.nan, -40.0, np.nan]])).all()  # fewer than min_readings
    assert nearest.predict_floor(RSSI[:1]).tolist() == ["F1"]


def test_it_can_be_cloned_and_changed() -> None:
    estimator = tickfix.FingerprintEstimator("wknn", k=2, seed=3)
    assert estimator.get_params() == {"algorithm": "wknn", "seed": 3, "k": 2}
    twin = tickfix.FingerprintEstimator(**estimator.get_params())
    assert twin.set_params(k=1).fit(RSSI, PLACES).predict(RSSI).tolist() == PLACES.tolist()
    with pytest.raises(ConfigError, match="fit or fit_site"):
        estimator.predict(RSSI)
    with pytest.raises(ConfigError, match="k: found 0"):
        estimator.set_params(k=0)
    with pytest.raises(ConfigError, match="2 columns; expected 3"):
        twin.predict(RSSI[:, :2])


def test_tables_are_matched_by_the_ids_of_their_transmitters() -> None:
    train = FingerprintTable.of(RSSI, PLACES, transmitters=["c", "a", "b"])
    shuffled = FingerprintTable.of(RSSI[:, ::-1], PLACES, transmitters=["b", "a", "c"])
    evaluation = tickfix.evaluate_fingerprint("wknn", train, shuffled, k=1)
    assert evaluation.error_m.tolist() == [0.0, 0.0, 0.0]
    assert evaluation.floor_right.all()
    same = tickfix.evaluate_fingerprint("wknn", (RSSI, PLACES), (RSSI, PLACES), k=1)
    frame = pd.DataFrame(RSSI, columns=["c", "a", "b"]).assign(x_m=PLACES[:, 0], y_m=PLACES[:, 1])
    from_frame = tickfix.evaluate_fingerprint("wknn", frame, frame, k=1)
    assert same.mean == from_frame.mean == 0.0


@pytest.mark.parametrize("algorithm", ["knn", "wknn", "ncc", "fncc", "elm-knn", "topology-knn"])
def test_every_fingerprint_can_be_evaluated_on_walks(algorithm: str, office: DemoScenario, site: tickfix.Site) -> None:
    evaluation = tickfix.evaluate_fingerprint(algorithm, site.radio_map, office.walks[0].recording)
    assert len(evaluation) > 20
    assert evaluation.located.all()
    assert evaluation.mean < 6.0
    assert f"{algorithm}: mean error" in repr(evaluation)


def test_a_site_brings_its_trained_models(office: DemoScenario, site: tickfix.Site) -> None:
    walks = [walk.recording for walk in office.walks[:2]]
    assert tickfix.evaluate_fingerprint("wknn", site, walks).mean < 4.0
