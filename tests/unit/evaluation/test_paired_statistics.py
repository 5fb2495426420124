"""Figures of weighted errors are those of the errors repeated as often as they count."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tickfix.evaluation.error_metrics import ErrorStatistics
from tickfix.evaluation.paired_statistics import STATISTICS


@pytest.mark.parametrize("name", STATISTICS)
@given(st.data())
def test_weights_repeat_errors(name: str, data: Any) -> None:
    chains = data.draw(st.integers(1, 5))
    errors = np.array(data.draw(st.lists(st.floats(0, 100), min_size=chains, max_size=20)))
    chain = np.array([i % chains for i in range(len(errors))])
    weights = np.array(data.draw(st.lists(st.integers(0, 3), min_size=chains, max_size=chains)))
    weights[data.draw(st.integers(0, chains - 1))] += 1
    found = STATISTICS[name].of(errors, chain, np.stack([weights, np.ones(chains, dtype=int)]))
    repeated = ErrorStatistics.of(np.repeat(errors, weights[chain]))
    assert found == pytest.approx([getattr(repeated, f"{name}_m"), getattr(ErrorStatistics.of(errors), f"{name}_m")])


def test_many_weightings_give_what_each_gives_alone() -> None:
    rng = np.random.default_rng(2)
    errors, chain = rng.random(2500), rng.integers(0, 40, 2500)
    weights = rng.multinomial(40, np.full(40, 1 / 40), size=2000)  # more than one block
    together = STATISTICS["p90"].of(errors, chain, weights)
    assert together[[0, 999, 1999]].tolist() == [
        float(STATISTICS["p90"].of(errors, chain, weights[[i]])[0]) for i in (0, 999, 1999)
    ]
