"""Folds never tear a chain, never hold a walk that is spared, and hold every other walk once."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tickfix.api import Recording, SiteError, Truth
from tickfix.evaluation.comparison.evaluation_sites import assign_folds
from tickfix.site.waypoints import assign_chains, is_held_out

S = 1_000_000_000


def walks(count: int, chained: set[int], floor: str = "F1") -> list[Recording]:
    """Walks of ten seconds, ten minutes apart; one that is chained begins where and when the one before it ended."""
    made: list[Recording] = []
    end_ns, place = 0, 0.0
    for i in range(count):
        if i in chained and made:
            begin_ns, x = end_ns + S, place
        else:
            begin_ns, x = end_ns + 600 * S, 100.0 * i
        end_ns, place = begin_ns + 10 * S, x + 5.0
        truth = tuple(
            Truth(t_ns=t_ns, floor=floor, xy=np.array([at, 0.0])) for t_ns, at in ((begin_ns, x), (end_ns, place))
        )
        made.append(Recording(name=f"{floor}-{i:03d}", floor=floor, events=truth))
    return made


@given(st.integers(12, 40), st.sets(st.integers(1, 39), max_size=8), st.integers(2, 3))
def test_every_walk_that_is_not_spared_is_in_one_fold_with_its_chain(count: int, chained: set[int], k: int) -> None:
    recordings = walks(count, chained)
    chain_of = assign_chains(recordings)
    kept = {name for name, chain in chain_of.items() if not is_held_out(chain, 0.3)}
    if len({chain_of[name] for name in kept}) < k:
        return
    parts = assign_folds(recordings, k)["F1"]
    assert sorted(name for part in parts for name in part) == sorted(kept)
    fold_of = {name: i for i, part in enumerate(parts) for name in part}
    for name in kept:
        assert fold_of[name] == fold_of[chain_of[name]]
    sizes = [len({chain_of[name] for name in part}) for part in parts]
    assert max(sizes) - min(sizes) <= 1
    assert assign_folds(list(reversed(recordings)), k) == assign_folds(recordings, k)


def test_floors_are_dealt_apart_and_walks_without_truth_left_out() -> None:
    extra = Recording(name="blind", floor="F1", events=())
    both = assign_folds([*walks(20, set()), extra, *walks(20, set(), "F2")], 2)
    assert list(both) == ["F1", "F2"]
    assert both["F1"] == assign_folds(walks(20, set()), 2)["F1"]


def test_too_few_folds_or_chains_are_refused() -> None:
    with pytest.raises(SiteError, match="found 1 folds, expected at least 2"):
        assign_folds(walks(5, set()), 1)
    with pytest.raises(SiteError, match=r"floor 'F1' has \d chains of walks, expected at least 9"):
        assign_folds(walks(9, set()), 9)


def test_nothing_is_spared_on_request() -> None:
    assert sum(map(len, assign_folds(walks(10, set()), 2, holdout_share=0.0)["F1"])) == 10
