"""The rule of the hold-out, against a second, naive reading of its text."""

from __future__ import annotations

from hashlib import sha256

import pytest
from hypothesis import given
from hypothesis import strategies as st
from surveys import walk

from tickfix.api import Recording, SiteError
from tickfix.site.waypoints import assign_chains, is_held_out


def brute_force(recordings: list[Recording]) -> dict[str, str]:
    chain: dict[str, str] = {}
    for floor in {r.floor for r in recordings}:
        ordered = [r for r in recordings if r.floor == floor]
        ordered.sort(key=lambda r: (min(t.t_ns for t in r.truth), r.name))
        for i, later in enumerate(ordered):
            chain[later.name] = later.name
            best = None
            for earlier in ordered[:i]:
                dx, dy = later.truth[0].xy - earlier.truth[-1].xy
                gap_s = (later.truth[0].t_ns - earlier.truth[-1].t_ns) / 1e9
                if (
                    (dx * dx + dy * dy) ** 0.5 <= 0.5
                    and 0 <= gap_s <= 60
                    and (best is None or earlier.truth[-1].t_ns > best.truth[-1].t_ns)
                ):
                    best = earlier
            if best is not None:
                chain[later.name] = chain[best.name]
    return chain


KNOWN = 833

walks = st.lists(
    st.tuples(
        st.integers(0, 300), st.integers(1, 60), st.integers(0, 3), st.integers(0, 3), st.sampled_from(["F1", "F2"])
    ),
    max_size=12,
).map(
    lambda rows: [
        walk(f"{n * 7919 % 13}w", [(t, a * 0.3, 0.0), (t + d, b * 0.3, 0.0)], floor=floor)
        for n, (t, d, a, b, floor) in enumerate(rows)
    ]
)


@given(walks, st.randoms(use_true_random=False))
def test_chains_are_what_the_rule_says_in_whatever_order_walks_come(recordings: list[Recording], random) -> None:
    expected = brute_force(recordings)
    random.shuffle(recordings)
    assert assign_chains(recordings) == expected


def test_a_walk_joins_the_latest_ending_walk_that_is_near_and_recent_enough() -> None:
    recordings = [
        walk("first", [(0, 0, 0), (10, 5, 5)]),
        walk("longer", [(1, 9, 9), (20, 5.3, 5)]),
        walk("next", [(30, 5.2, 5), (40, 8, 8)]),
        walk("at-60-s", [(100, 8.5, 8), (110, 0, 0)]),
        walk("too-late", [(170.001, 0, 0), (180, 1, 1)]),
        walk("too-far", [(181, 1.51, 1), (190, 2, 2)]),
        walk("elsewhere", [(191, 2, 2), (195, 3, 3)], floor="F2"),
        walk("no-truth", []),
    ]
    assert assign_chains(recordings) == {
        "first": "first",
        "longer": "longer",
        "next": "longer",
        "at-60-s": "longer",
        "too-late": "too-late",
        "too-far": "too-far",
        "elsewhere": "elsewhere",
    }


@given(st.text(alphabet="0123456789abcdef", min_size=1, max_size=24), st.floats(0, 1))
def test_a_chain_is_held_out_by_the_hash_of_its_first_walks_name(name: str, share: float) -> None:
    assert is_held_out(name, share) == (int(sha256(name.encode()).hexdigest(), 16) % 1000 < 1000 * share)


def test_known_names_are_held_out_at_known_shares() -> None:
    assert int(sha256(b"5dd9e7aac5b77e0006b1732b").hexdigest(), 16) % 1000 == KNOWN
    assert not is_held_out("5dd9e7aac5b77e0006b1732b", KNOWN / 1000)
    assert is_held_out("5dd9e7aac5b77e0006b1732b", (KNOWN + 1) / 1000)


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan")])
def test_a_share_that_is_none_is_refused(share: float) -> None:
    with pytest.raises(SiteError, match="expected a share from 0 to 1"):
        is_held_out("walk", share)
