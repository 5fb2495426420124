"""Folding one stage over ticks, with checkpoints to rewind to.

Events come late, so the past must be folded again, and stages are opaque: a filter cannot be run backwards. What can be
done with any pure step is to keep states (checkpoints), go back to one before the change and step forward again. The
result is the same to the bit wherever the checkpoint lies; how many are kept decides only how much is computed again.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, Final, Generic, TypeVar

from tickfix.api.packing import nbytes
from tickfix.kernel.batch import StepCoroutine
from tickfix.kernel.snapshot import FoldSnapshot
from tickfix.kernel.stages import KernelSetup, Stage, StageCaller, checked_snapshot, unpacked_state
from tickfix.kernel.timeline import ChangedTicks

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
        """Restart from the start state; ``tick`` is the first to fold."""
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
        # The newest state is always kept, since the next step starts from it; it is thinned out one tick later, once it
        # is no longer the newest. Kept ticks are multiples of the stride, not every n-th since the last: so a rewind
        # and its refolding keep the same ticks as before. The oldest stays: every rewind needs one to go back to.
        if before % self._stride and before != next(iter(self._checkpoints)):
            del self._checkpoints[before]
        self._checkpoints[tick], self.outputs[tick] = state, output
        self.folded_to = tick
        if tick % _MEASURE_EVERY == 0:
            self._adjust_stride(state)

    def advance(self, tick: int, step: Callable[[S, int], StepCoroutine[tuple[S, O]]]) -> StepCoroutine[None]:
        """Fold up to and including ``tick``."""
        for k, state in self.pending_ticks(tick):
            kept, output = yield from step(state, k)
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
        # A stride that grows affects only what is recorded from now on; the denser checkpoints of before age out with
        # the horizon. It never exceeds the horizon, so that a rewind within it goes back by two horizons at most.
        measured = 0
        with suppress(Exception):  # a state is a stage's, and may break when it is looked at
            measured = nbytes(state)
        affordable = max(1, self._budget_bytes // max(1, measured))
        self._stride = min(self._horizon, -(-self._horizon // affordable)) or 1


def _drop_ticks_before(tick: int, ticks: dict[int, Any]) -> None:
    """Drop what stands before ``tick`` in a mapping whose keys ascend."""
    while ticks and (first := next(iter(ticks))) < tick:
        del ticks[first]


class StageFold(Fold[S, O], ABC):
    """The fold of one stage of one device: how it steps, what changes it, and what a snapshot keeps of it.

    An epoch runs its folds in order, those that others read first.

    Args:
        key: names it in snapshots: the stage's, or the pipeline's whose belief it is.
        stage: what is folded.
        start: see :class:`Fold`.
    """

    def __init__(self, key: str, stage: Stage, setup: KernelSetup, start: Callable[[], S]) -> None:
        """Begin before the first tick."""
        super().__init__(start, horizon=setup.horizon_ticks, budget_bytes=setup.fold_bytes)
        self.key = key
        self._stage = stage
        self._call: StageCaller = setup.call

    @abstractmethod
    def fold_to(self, tick: int, first: int) -> StepCoroutine[None]:
        """Fold up to and including ``tick``; ``first`` is the epoch's first tick."""

    @abstractmethod
    def changed_since(self, changes: ChangedTicks, upstream: int | None) -> int | None:
        """Return the earliest tick to fold again, None for none.

        Args:
            changes: of the timeline.
            upstream: the earliest tick that a fold before this one, or a fix, changed.
        """

    @abstractmethod
    def packed(self, tick: int, state: S) -> FoldSnapshot:
        """Return the checkpoint after ``tick`` as a value; raises where the stage's state cannot be packed."""

    def snapshot(self) -> FoldSnapshot | None:
        """Return the oldest checkpoint as a value, None (and a failure of the stage) where it cannot be packed."""
        return checked_snapshot(self._call, self._stage, lambda: self.packed(*self.oldest))

    def restore(self, kept: FoldSnapshot | None, oldest: int) -> None:
        """Go on from a snapshot's checkpoint; a stage that it does not hold starts after tick ``oldest``."""
        if kept is None:
            self.begin(oldest + 1)
        else:
            self.resume(kept.tick, self.unpacked(kept))

    def unpacked(self, kept: FoldSnapshot) -> S:
        """Return the state that ``kept`` holds; the timeline must have been restored."""
        state: S = unpacked_state(kept.state, self._stage)
        return state


def earliest(*ticks: int | None) -> int | None:
    """Return the smallest of the ticks that are not None."""
    return min((t for t in ticks if t is not None), default=None)
