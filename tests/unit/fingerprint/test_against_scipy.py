"""knn and wknn against plain scipy, for every representation and similarity."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from tickfix.api import Context, RadioMap, Readings, Scan
from tickfix.toolkit.nearest_neighbours import Representation, Similarity
from tickfix_fingerprint.knn import Knn, KnnParams, Wknn, WknnParams

METRICS = {"euclidean": "euclidean", "manhattan": "cityblock", "cosine": "cosine", "sorensen": "braycurtis"}
MISSING = -100.0
K = 4


@pytest.fixture(scope="module")
def radio_map() -> RadioMap:
    """Forty points on one floor that hear ten of thirty transmitters each, one to three times."""
    rng = np.random.default_rng(8)
    rows = [
        (p, t, rng.uniform(-95, -35))
        for p in range(40)
        for t in rng.choice(30, 10, replace=False)
        for _ in range(rng.integers(1, 4))
    ]
    point = np.array([row[0] for row in rows])
    xy = rng.uniform(0, 50, (40, 2))
    return RadioMap(
        floors=("F",),
        transmitters=tuple(f"{n:02d}" for n in range(30)),
        point_floor=np.zeros(40, np.int64),
        point_xy=xy,
        sample_point=point,
        sample_transmitter=np.array([row[1] for row in rows]),
        sample_rssi_dbm=np.array([row[2] for row in rows]),
        sample_xy=xy[point],
        sample_t_ns=np.zeros(len(rows), np.int64),
        sample_chain=np.zeros(len(rows), np.int64),
    )


def represented(dbm: Any, representation: str) -> Any:
    """Return [torres-sospedra2015] section 3.1 in words of its own."""
    heard = np.where(np.isnan(dbm) | (dbm <= MISSING), MISSING, dbm)
    if representation == "positive":
        return heard - MISSING
    if representation == "exponential":
        return np.where(heard > MISSING, np.exp(heard / 24.0), 0.0)
    return ((heard - MISSING) / -MISSING) ** np.e


def neighbours(radio_map: RadioMap, window: Readings, representation: str, similarity: str) -> tuple[Any, Any]:
    """Return the k nearest points and their distances, the plain way."""
    points = np.full((len(radio_map), 30), np.nan)
    for p in range(len(radio_map)):
        for t in range(30):
            mine = (radio_map.sample_point == p) & (radio_map.sample_transmitter == t)
            if mine.any():
                points[p, t] = radio_map.sample_rssi_dbm[mine].mean()
    heard = np.full((1, 30), np.nan)
    for name, rssi in zip(window.transmitters, window.rssi_dbm, strict=True):
        if name in radio_map.transmitters:
            heard[0, int(name)] = rssi
    rows, here = represented(points, representation), represented(heard, representation)
    distances = cdist(rows, here, METRICS[similarity])[:, 0]
    order = np.argsort(distances, kind="stable")[:K]
    return order, distances[order]


def windows() -> list[Readings]:
    rng = np.random.default_rng(9)
    made = []
    for _ in range(25):
        chosen = rng.choice(34, 9, replace=False)  # a few of them unknown to the survey
        rssi = rng.uniform(-98, -35, 9)
        scan = Scan(transmitters=tuple(f"{n:02d}" for n in chosen), rssi_dbm=rssi, heard_ns=np.full(9, 10**9))
        made.append(Readings.of(scan))
    return made


def test_every_similarity_has_its_oracle() -> None:
    assert set(METRICS) == set(get_args(Similarity))


@pytest.mark.parametrize("similarity", get_args(Similarity))
@pytest.mark.parametrize("representation", get_args(Representation))
def test_wknn_averages_the_points_that_scipy_finds_nearest(
    radio_map: RadioMap, representation: Representation, similarity: Similarity
) -> None:
    params = WknnParams(k=K, representation=representation, similarity=similarity, missing_dbm=MISSING, min_readings=1)
    wknn = Wknn(params, Context(radio_map=radio_map))
    for window in windows():
        order, distances = neighbours(radio_map, window, representation, similarity)
        weights = 1.0 / (distances + 1e-6)
        fix = wknn.locate(window)
        assert fix is not None
        expected = weights @ radio_map.point_xy[order] / weights.sum()
        np.testing.assert_allclose(fix.xy, expected, rtol=1e-6, atol=1e-6)


def test_knn_averages_the_points_nearest_in_dbm(radio_map: RadioMap) -> None:
    knn = Knn(KnnParams(k=K, missing_dbm=MISSING, min_readings=1), Context(radio_map=radio_map))
    for window in windows():
        order, _ = neighbours(radio_map, window, "positive", "euclidean")
        fix = knn.locate(window)
        assert fix is not None
        np.testing.assert_allclose(fix.xy, radio_map.point_xy[order].mean(axis=0), rtol=1e-9)


def test_n_scans_are_compared_by_their_mean(radio_map: RadioMap) -> None:
    scans = [{"01": -50.0, "02": -60.0, "03": -45.0}, {"01": -58.0, "03": -47.0}, {"02": -70.0, "07": -66.0}]
    names = [name for scan in scans for name in scan]
    window = Readings(
        t_ns=3,
        transmitters=tuple(names),
        rssi_dbm=np.array([rssi for scan in scans for rssi in scan.values()]),
        heard_ns=np.array([n + 1 for n, scan in enumerate(scans) for _ in scan]),
        scan=np.array([n for n, scan in enumerate(scans) for _ in scan]),
        scan_t_ns=(1, 2, 3),
    )
    mean = {name: np.mean([scan[name] for scan in scans if name in scan]) for name in sorted(set(names))}
    one = Scan(transmitters=tuple(mean), rssi_dbm=np.array(list(mean.values())), heard_ns=np.full(len(mean), 3))
    context = Context(radio_map=radio_map)
    averaging, newest = Knn(KnnParams(k=K, n=3), context), Knn(KnnParams(k=K), context)
    assert averaging.window.scans == 3
    found, expected = averaging.locate(window), newest.locate(Readings.of(one))
    assert found is not None
    assert expected is not None
    np.testing.assert_array_equal(found.xy, expected.xy)
