"""``ncc`` and ``fncc``: the same coefficients as numpy's, the same points as each other, finite when nothing varies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tickfix.api import Context, RadioMap, Readings, frozen
from tickfix_fingerprint.cross_correlation import Fncc, FnccParams, Ncc, NccParams
from tickfix_fingerprint.rss_matrices import RssBlocks

NAMES = ("a", "b", "c", "d")
SECOND = 10**9


def radio_map(points: Sequence[Sequence[Mapping[str, float]]], chains: Sequence[int] = ()) -> RadioMap:
    """Return points on a line, 1 m apart, each with its samples ten seconds apart."""
    rows = [
        (p, NAMES.index(name), rssi, (100 * p + 10 * s) * SECOND, chains[s] if chains else 0)
        for p, samples in enumerate(points)
        for s, sample in enumerate(samples)
        for name, rssi in sample.items()
    ]
    columns = list(zip(*rows, strict=True)) if rows else [[], [], [], [], []]
    point = np.array(columns[0], np.int64)
    xy = np.stack([np.arange(len(points), dtype=np.float64), np.zeros(len(points))], axis=1)
    return RadioMap(
        floors=("F1",),
        transmitters=NAMES,
        point_floor=np.zeros(len(points), np.int64),
        point_xy=xy,
        sample_point=point,
        sample_transmitter=np.array(columns[1], np.int64),
        sample_rssi_dbm=np.array(columns[2], np.float64),
        sample_xy=xy[point] if rows else np.zeros((0, 2)),
        sample_t_ns=np.array(columns[3], np.int64),
        sample_chain=np.array(columns[4], np.int64),
    )


def window(scans: Sequence[Mapping[str, float]]) -> Readings:
    """Return the window of scans one second apart."""
    rows = [(n, name, rssi) for n, scan in enumerate(scans) for name, rssi in sorted(scan.items())]
    return Readings(
        t_ns=len(scans) * SECOND,
        transmitters=tuple(row[1] for row in rows),
        rssi_dbm=frozen([row[2] for row in rows]),
        heard_ns=frozen([(row[0] + 1) * SECOND for row in rows], np.int64),
        scan=frozen([row[0] for row in rows], np.int64),
        scan_t_ns=tuple((n + 1) * SECOND for n in range(len(scans))),
    )


def both(site: RadioMap, **params: Any) -> tuple[Ncc, Fncc]:
    """Return the two methods on one survey."""
    context = Context(radio_map=site)
    return Ncc(NccParams(**params), context), Fncc(FnccParams(**params), context)


RSSI = st.integers(-99, -30).map(float)
SCANS = st.lists(st.dictionaries(st.sampled_from(NAMES), RSSI), min_size=1, max_size=5)
SURVEYS = st.lists(SCANS, min_size=2, max_size=6)


@given(SURVEYS, SCANS, st.integers(1, 3), st.sampled_from(["blocks", "mean"]), st.sampled_from(["best", "mean"]))
def test_the_fast_form_chooses_the_points_of_the_plain_one(
    survey: Any, scans: Any, n: int, reference: str, pool: str
) -> None:
    plain, fast = both(radio_map(survey), n=n, reference=reference, pool=pool, min_readings=1)
    expected, found = plain.ranked(window(scans)), fast.ranked(window(scans))
    assert (expected is None) == (found is None)
    if expected is not None and found is not None:
        np.testing.assert_array_equal(found[0], expected[0])
        # The coefficient of eq. (6) is the root of a difference: near zero it keeps half the digits.
        np.testing.assert_allclose(found[1], expected[1], atol=2e-4)
        assert np.isfinite(found[1]).all()


@given(st.lists(st.lists(RSSI, min_size=4, max_size=4), min_size=2, max_size=2), st.lists(RSSI, min_size=8, max_size=8))
def test_a_coefficient_is_that_of_numpy(online: list[list[float]], survey: list[float]) -> None:
    samples = [dict(zip(NAMES, half, strict=True)) for half in (survey[:4], survey[4:])]
    scans = [dict(zip(NAMES, scan, strict=True)) for scan in online]
    for method in both(radio_map([samples]), n=2):
        found = method.ranked(window(scans))
        assert found is not None
        if np.ptp(online) == 0 or np.ptp(survey) == 0:
            assert found[1][0] == 0.0
        else:
            oracle = np.corrcoef(np.ravel(online), survey)[0, 1]
            np.testing.assert_allclose(found[1][0], oracle, atol=2e-4)


def test_the_literal_square_prefers_a_point_that_says_the_opposite() -> None:
    heard = {"a": -40.0, "b": -50.0, "c": -80.0, "d": -90.0}
    opposite = dict(zip(heard, reversed(heard.values()), strict=True))
    roughly = {"a": -40.0, "b": -85.0, "c": -60.0, "d": -90.0}
    site = Context(radio_map=radio_map([[roughly] * 2, [opposite] * 2]))
    places = [Fncc(FnccParams(k=1, literal=literal), site).nearest(window([heard] * 2)) for literal in (False, True)]
    assert [place[1][0] for place in places if place is not None] == [0.0, 1.0]


@pytest.mark.parametrize("reference", ["blocks", "mean"])
def test_a_collapsed_variance_finds_the_point_of_the_nearest_mean(reference: str) -> None:
    survey = [[dict.fromkeys(NAMES, rssi)] * 4 for rssi in (-40.0, -60.0, -80.0)]
    for method in both(radio_map(survey), k=1, reference=reference):
        found = method.locate(window([dict.fromkeys(NAMES, -61.0)] * 2))
        assert found is not None
        assert found.xy.tolist() == [1.0, 0.0]
        assert np.isfinite(found.covariance).all()


def test_all_samples_count_where_their_means_cannot_tell() -> None:
    steady = {"a": -50.0, "b": -70.0, "c": -60.0}
    swinging = [{"a": -40.0, "b": -80.0, "c": -60.0}, {"a": -60.0, "b": -60.0, "c": -60.0}]
    for method in both(radio_map([[steady] * 2, swinging]), k=1):
        found = method.nearest(window(swinging))
        assert found is not None
        assert found[1][0] == 1.0


def test_a_block_has_n_samples_in_their_order_and_what_is_missing_filled() -> None:
    samples = [{"a": -50.0, "b": -70.0}, {"a": -60.0}, {"a": -55.0}]
    blocks = RssBlocks(radio_map([samples]), 2, means=False, missing_dbm=-100.0, sample_s=4.0)
    assert blocks.point.tolist() == [0, 0]
    assert blocks.dense(0).tolist() == [[50.0, 40.0], [30.0, 30.0], [0.0, 0.0], [0.0, 0.0]]
    assert blocks.dense(1).tolist() == [[45.0, 45.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]


def test_readings_of_one_scan_that_are_a_second_apart_are_one_sample() -> None:
    site = radio_map([[{"a": -50.0}, {"b": -70.0}]])
    near = RadioMap(
        **{name: getattr(site, name) for name in RadioMap.__dataclass_fields__} | {"sample_t_ns": np.array([0, SECOND])}
    )
    blocks = RssBlocks(near, 1, means=False, missing_dbm=-100.0, sample_s=4.0)
    assert blocks.dense(0).ravel().tolist() == [50.0, 30.0, 0.0, 0.0]
    assert len(blocks.point) == 1


def test_a_site_where_nothing_was_heard_gives_no_fix() -> None:
    for method in both(radio_map([[], []]), min_readings=1):
        assert method.locate(window([{"a": -50.0}])) is None
