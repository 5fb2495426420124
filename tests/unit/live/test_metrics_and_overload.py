"""Quantiles of durations, and telling overload from a hiccup."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tickfix.live.metrics import DurationHistogram
from tickfix.live.scheduler import OverloadDetector

S = 1_000_000_000


@given(st.lists(st.floats(0.002, 1e7), min_size=1, max_size=200), st.floats(0.01, 1.0))
def test_quantiles_are_exact_to_six_percent_and_never_too_small(durations: list[float], q: float) -> None:
    histogram = DurationHistogram()
    for ms in durations:
        histogram.add(ms)
    true = float(np.quantile(durations, q, method="inverted_cdf"))
    assert true <= histogram.quantile_ms(q) * (1 + 1e-9)
    assert histogram.quantile_ms(q) <= true * 10 ** (1 / 40) * (1 + 1e-9)


def test_an_empty_histogram_and_durations_out_of_range_are_no_error() -> None:
    histogram = DurationHistogram()
    assert histogram.summary() == {"p50": 0.0, "p99": 0.0, "max": 0.0, "count": 0}
    histogram.add(-1.0)
    histogram.add(1e30)
    assert histogram.summary()["count"] == 2
    assert histogram.summary()["max"] == 1e30


def test_cumulative_counts_end_at_bounds_of_buckets_and_leave_nothing_out() -> None:
    histogram = DurationHistogram()
    for ms in (0.05, 0.9, 1.5, 3.0, 3.0, 700.0, 20_000.0):
        histogram.add(ms)
    found = dict(histogram.cumulative())
    assert [round(bound_ms, 3) for bound_ms in list(found)[:4]] == [0.1, 0.2, 0.501, 1.0]
    assert [n for bound_ms, n in found.items() if bound_ms in (min(found), max(found))] == [1, 6]
    for bound_ms, n in found.items():
        assert n == sum(ms <= bound_ms for ms in (0.05, 0.9, 1.5, 3.0, 3.0, 700.0, 20_000.0))
    assert histogram.sum_ms == 0.05 + 0.9 + 1.5 + 3.0 + 3.0 + 700.0 + 20_000.0


def test_a_hiccup_is_no_overload_and_a_pause_no_recovery() -> None:
    overload = OverloadDetector(1.0)
    assert not overload.update(5 * S, 0)
    assert not overload.update(0, 1 * S)
    assert not overload.update(5 * S, 2 * S)
    assert not overload.update(5 * S, 4 * S)
    assert overload.update(5 * S, 5 * S)
    assert overload.active
    assert not overload.update(S // 10, 6 * S)
    assert not overload.update(S // 2, 8 * S)  # better, but not well
    assert not overload.update(S // 10, 9 * S)
    assert overload.update(S // 10, 12 * S)
    assert not overload.active
    assert overload.episodes == 1
