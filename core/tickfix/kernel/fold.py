"""Folding one stage over ticks, with checkpoints to rewind to."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, Final, Generic, TypeVar

from tickfix.api.packing import nbytes

S = TypeVar("S")
O = TypeVar("O")  # noqa: E741 - output

_MEASURE_EVERY: Final = 8
"""At every so many-th tick a state is measured, which takes a while: states grow slowly once a stage has begun."""


class Fold(Generic[S, O]):
    """States and outputs of a stage, tick by tick.

    States are immutable, so a checkpoint is a reference. Where they are large, only every n-th is kept: a rewind then
    starts further back and computes the same states again.

    Args:
        start: returns the state before the first tick. A step from there on, ``(state, tick) → (state, output)``, is a
            pure function of its arguments and of what was measured.
        horizon: ticks that can still change.
        budget_bytes: memory for checkpoints.
    """

    def __init__(
        self,
        start: Callable[[], S],
        *,
        horizon: int,
        budget_bytes: int,
    ) -> None:
        """Begin before the first tick; :meth:`begin` says which that is."""
        self._start = start
        self._horizon = horizon
        self._budget_bytes = budget_bytes
        self._stride = 1
        self._checkpoints: dict[int, S] = {}
        self.outputs: dict[int, O] = {}
        self.folded_to: int | None = None

    def begin(self, tick: int) -> None:
        """Start anew, ``tick`` being the first to fold."""
        self.resume(tick - 1, self._start())

    def resume(self, tick: int, state: S) -> None:
        """Go on from the state after ``tick``."""
        self.outputs.clear()
        self._checkpoints = {tick: state}
        self.folded_to = tick

    @property
    def oldest(self) -> tuple[int, S]:
        """The oldest checkpoint: its tick and the state after it."""
        return next(iter(self._checkpoints.items()))

    def rewind(self, tick: int) -> None:
        """Forget ``tick`` and all after it, back to the checkpoint before it."""
        if self.folded_to is None or tick > self.folded_to:
            return
        self._checkpoints = {k: state for k, state in self._checkpoints.items() if k < tick}
        self.folded_to = max(self._checkpoints)
        for k in [k for k in self.outputs if k > self.folded_to]:
            del self.outputs[k]

    def pending_ticks(self, tick: int) -> Iterator[tuple[int, S]]:
        """Yield each tick to fold, up to and including ``tick``, and the state before it; :meth:`record` follows."""
        assert self.folded_to is not None  # noqa: S101 - begin comes first
        while self.folded_to < tick:
            yield self.folded_to + 1, self._checkpoints[self.folded_to]

    def record(self, tick: int, state: S, output: O) -> None:
        """Keep what a tick was folded to; it is the one after the last."""
        before = tick - 1
        if before % self._stride and before != next(iter(self._checkpoints)):
            del self._checkpoints[before]  # the oldest stays: every rewind needs one to go back to
        self._checkpoints[tick], self.outputs[tick] = state, output
        self.folded_to = tick
        if tick % _MEASURE_EVERY == 0:
            self._adjust_stride(state)

    def advance(self, tick: int, step: Callable[[S, int], tuple[S, O]]) -> None:
        """Fold up to and including ``tick``."""
        for k, state in self.pending_ticks(tick):
            kept, output = step(state, k)
            self.record(k, kept, output)

    def before(self, tick: int) -> tuple[int, S] | None:
        """Return the newest checkpoint before ``tick``: its tick and the state after it; None where there is none."""
        known = max((k for k in self._checkpoints if k < tick), default=None)
        return None if known is None else (known, self._checkpoints[known])

    def refold_from(self, tick: int) -> int:
        """Return the first tick to fold again after a rewind to ``tick``."""
        if tick - 1 in self._checkpoints:
            return tick
        return max((k for k in self._checkpoints if k < tick), default=min(self._checkpoints)) + 1

    def forget(self, tick: int) -> int:
        """Drop checkpoints that no rewind to ``tick`` or later needs; return the first tick to fold again."""
        refold_from = self.refold_from(tick)
        _drop_ticks_before(refold_from - 1, self._checkpoints)
        return refold_from

    def drop_outputs(self, tick: int) -> None:
        """Drop the outputs before ``tick``."""
        _drop_ticks_before(tick, self.outputs)

    def _adjust_stride(self, state: S) -> None:
        measured = 0
        with suppress(Exception):  # a state is a stage's, and may break when it is looked at
            measured = nbytes(state)
        affordable = max(1, self._budget_bytes // max(1, measured))
        self._stride = min(self._horizon, -(-self._horizon // affordable)) or 1


def _drop_ticks_before(tick: int, ticks: dict[int, Any]) -> None:
    """Drop what stands before ``tick`` in a mapping whose keys ascend."""
    while ticks and (first := next(iter(ticks))) < tick:
        del ticks[first]


def earliest(*ticks: int | None) -> int | None:
    """Return the smallest of the ticks that are not None."""
    return min((t for t in ticks if t is not None), default=None)
