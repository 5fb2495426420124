"""Every fingerprint method locates the public fingerprint sets: finite answers, better than the middle of the site."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest


@pytest.fixture(scope="module")
def benchmark() -> ModuleType:
    path = Path(__file__).resolve().parents[2] / "benchmarks" / "fingerprints.py"
    spec = importlib.util.spec_from_file_location("benchmark_fingerprints", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("number", range(6))
def test_every_method_beats_the_middle_of_the_site(data_dir: Path, benchmark: ModuleType, number: int) -> None:
    for needed in ("uji-library", "wifi-rss-rtt"):
        if not (data_dir / needed).is_dir():
            pytest.skip(f"no {needed} in {data_dir}")
    _, survey, queries = list(benchmark.sets(data_dir))[number]
    centre, *scores = benchmark.compare(survey, queries, 60)
    assert {"knn", "wknn", "ncc", "fncc", "elm-knn", "topology-knn"} <= {score.method for score in scores}
    for score in scores:
        assert np.isfinite(score.errors_m).all(), score.method
        assert score.without_fix == 0, score.method
        assert score.right_floor > 0.9, score.method
        # The square without its sign is barely better than nothing in the office: that is why it is a preset only.
        share = 1.0 if "literal" in score.method else 0.75
        assert score.errors_m.mean() < share * centre.errors_m.mean(), score.method


def test_the_two_forms_of_the_correlation_choose_the_same_points(data_dir: Path, benchmark: ModuleType) -> None:
    survey, queries = (benchmark.library(data_dir / "uji-library", "01", name) for name in ("trn01", "tst01"))
    errors = {score.method: score.errors_m for score in benchmark.compare(survey, queries, 60)}
    np.testing.assert_array_equal(errors["ncc"], errors["fncc"])
