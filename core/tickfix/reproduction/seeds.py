"""One experiment over many seeds: the same results in the same order, whatever the number of processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from tickfix.drivers.workers import spread
from tickfix.reproduction.report import Show

Result = TypeVar("Result")


def over_seeds(
    run: Callable[[int], Result], seeds: Sequence[int], show: Show, label: str, *, processes: int | None = None
) -> tuple[Result, ...]:
    """Return ``run(seed)`` for each seed, in their order.

    Args:
        run: one repetition; everything random in it must come from generators that the seed makes.
        seeds: each once.
        show: told after each repetition.
        label: of the work, for ``show``.
        processes: how many work at once, by default as many as there are cores.
    """
    show(label, 0, len(seeds))
    results: list[Result] = []
    for result in spread(run, seeds, processes=processes):
        results.append(result)
        show(label, len(results), len(seeds))
    return tuple(results)
