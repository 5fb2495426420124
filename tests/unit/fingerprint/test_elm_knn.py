"""``elm-knn``: least squares like scipy's, weights that sum to one, and the survey's own samples recognised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st

from tickfix.testing import world
from tickfix.toolkit.extreme_learning import classifier_output_weights, hidden_layer
from tickfix_fingerprint.elm_knn import ElmKnn, ElmKnnParams, distance_weights


@pytest.mark.parametrize(("n", "nodes", "ridge"), [(200, 30, 1e-3), (40, 30, 0.1), (20, 60, 1.0)])
def test_the_output_weights_are_those_of_least_squares_with_a_ridge(n: int, nodes: int, ridge: float) -> None:
    rng = np.random.default_rng(3)
    H = hidden_layer(rng.normal(size=(n, 7)), rng.uniform(-1, 1, (7, nodes)), rng.uniform(-1, 1, nodes))
    classes = rng.integers(0, 5, n)
    targets = np.concatenate([np.eye(5)[classes], np.zeros((nodes, 5))])
    oracle = scipy.linalg.lstsq(np.concatenate([H, np.sqrt(ridge) * np.eye(nodes)]), targets)[0]
    np.testing.assert_allclose(classifier_output_weights(H, classes, 5, ridge), oracle, atol=1e-8)


@given(st.lists(st.floats(0, 200), min_size=1, max_size=9))
def test_weights_sum_to_one_and_fall_with_the_distance(distances: list[float]) -> None:
    dis = np.sort(distances)
    w = distance_weights(dis)
    assert w.sum() == pytest.approx(1.0)
    assert (w >= 0).all()
    assert (np.diff(w) <= 1e-12).all()


def test_the_classifier_finds_a_neighbour_of_the_point_where_one_stands() -> None:
    params = ElmKnnParams(k=1)
    survey = world.survey()
    method = ElmKnn(params, world.context(), ElmKnn.train(params, survey, world.rng(1)))
    errors = []
    for floor, xy in zip(survey.radio_map.point_floor, survey.radio_map.point_xy, strict=True):
        name = survey.radio_map.floors[floor]
        fix = method.locate(world.readings(name, xy.tolist()))
        assert fix is not None
        errors.append(float(np.hypot(*(fix.xy - xy))) if fix.floor == name else np.inf)
    assert np.median(errors) <= 2.0
    assert np.mean(np.array(errors) <= 4.0) > 0.9


def test_only_the_most_frequent_access_points_are_asked() -> None:
    params = ElmKnnParams(access_points=5, hidden=20, min_readings=1)
    model = ElmKnn.fit_model(
        params, world.radio_map(), np.ones(len(world.radio_map().sample_point), bool), world.rng(1)
    )
    assert model["a"].shape == (5, 20)
    used = {world.radio_map().transmitters[n] for n in model["access_points"]}
    method = ElmKnn(params, world.context(), model)
    others = [name for name in world.radio_map().transmitters if name not in used]
    assert method.locate(world.make_readings(world.T0_NS, others, [-50.0] * len(others), [0.0] * len(others))) is None


def test_without_a_classifier_the_nearest_points_are_the_candidates() -> None:
    fix = ElmKnn(ElmKnnParams(k=1), world.context()).locate(world.readings("F1", (3.0, 3.0)))
    assert fix is not None
    assert np.hypot(*(fix.xy - [3.0, 3.0])) <= 2.0


def test_what_only_the_scan_before_heard_is_not_taken_for_missing() -> None:
    params = ElmKnnParams(k=1)
    method = ElmKnn(params, world.context(), ElmKnn.train(params, world.survey(), world.rng(1)))
    whole = world.readings("F1", (3.0, 3.0))
    strongest = int(np.argmax(whole.rssi_dbm))
    scan = np.where(np.arange(len(whole)) == strongest, 0, 1)
    split = replace(whole, scan=scan, scan_t_ns=(whole.t_ns - 10**9, whole.t_ns))
    found, expected = method.locate(split), method.locate(whole)
    assert found is not None
    assert expected is not None
    assert np.array_equal(found.xy, expected.xy)
