"""Folding with checkpoints gives what folding from the beginning gives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tickfix.kernel.batch import StepCoroutine
from tickfix.kernel.fold import Fold, earliest

HORIZON = 10


def advance(fold: Fold[Any, Any], tick: int, step: Callable[[Any, int], tuple[Any, Any]]) -> None:
    """Advance a fold by a step that asks for nothing."""

    def coroutine(state: Any, k: int) -> StepCoroutine[tuple[Any, Any]]:
        yield from ()
        return step(state, k)

    assert list(fold.advance(tick, coroutine)) == []


@settings(max_examples=200)
@given(
    moves=st.lists(st.tuples(st.sampled_from(["advance", "change"]), st.integers(0, HORIZON)), max_size=40),
    budget=st.sampled_from([0, 64, 300, 700, 10_000]),
)
def test_any_budget_and_any_rewinding_give_what_folding_anew_gives(moves: list[tuple[str, int]], budget: int) -> None:
    measured = dict.fromkeys(range(-5, 500), 0)

    def step(state: tuple[int, ...], tick: int) -> tuple[tuple[int, ...], int]:
        state = ((31 * state[0] + measured[tick] + tick) % 1_000_003,)
        return state, state[0]

    fold = Fold(lambda: (7,), horizon=HORIZON, budget_bytes=budget)
    fold.begin(0)
    now, settled = -1, -1
    said: dict[int, int] = {}
    for what, n in moves:
        if what == "advance":
            now += n
            advance(fold, now, step)
        else:
            changed = max(settled + 1, now - n)
            measured[changed] += 1
            fold.rewind(changed)
            advance(fold, now, step)
        for k in range(settled + 1, now - HORIZON):
            said[k] = fold.outputs[k]
            settled = k
        fold.drop_outputs(fold.forget(settled + 1))
    state, expected = (7,), {}
    for k in range(now + 1):
        state, expected[k] = step(state, k)
    assert {**said, **{k: v for k, v in fold.outputs.items() if k > settled}} == expected


def test_checkpoints_of_large_states_are_fewer_than_ticks() -> None:
    large = np.zeros(10_000)
    fold = Fold(lambda: large, horizon=50, budget_bytes=5 * large.nbytes)
    fold.begin(0)
    for k in range(200):
        advance(fold, k, lambda state, tick: (state, tick))
        fold.forget(k - 50)
    assert len(fold._checkpoints) <= 8


def test_the_earliest_of_no_ticks_is_none() -> None:
    assert earliest(None, None) is None
    assert earliest(None, 3, 2) == 2
