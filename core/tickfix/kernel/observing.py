"""A fingerprint on one device: the scans of each tick → observations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from tickfix.api.events import TICK_NS, Scan
from tickfix.api.packing import pack
from tickfix.api.values import Observation, Readings
from tickfix.kernel.snapshot import FoldSnapshot, WaitingSnapshot
from tickfix.kernel.stages import (
    Caller,
    Failure,
    Stage,
    checked_observation,
    kept_snapshot,
    packed_state,
    unpacked_state,
)
from tickfix.kernel.timeline import Timeline

AHEAD_NS: Final = 5_000_000_000
"""How far after its scan a fix may be dated: it waits for its tick until then."""


@dataclass(frozen=True, slots=True)
class Observed:
    """What a fingerprint made of a tick's scans."""

    observations: tuple[Observation, ...] = ()
    failure: Failure | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Waiting:
    """An observation whose fix describes an instant to come; its scan and the state before it make it again."""

    observation: Observation
    scan: Scan
    before: Any


@dataclass(frozen=True, slots=True)
class Sighted:
    """What a fingerprint carries from tick to tick; ``state`` is None until it has begun."""

    state: Any = None
    waiting: tuple[Waiting, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """What a fingerprint will be asked: a state, and windows each of which goes on from the state after the one before.

    Whoever has time may compute the answers beforehand: they are pure functions of what stands here.
    """

    stage: Stage
    state: Any
    windows: tuple[Readings, ...]


class ObservationFold:
    """The fold of a tick's scans into observations.

    A fix counts at the tick that closes its interval. One that describes an instant after its scan waits until then.
    """

    def __init__(self, stage: Stage, timeline: Timeline, call: Caller) -> None:
        """Keep what the steps need."""
        self._stage = stage
        self._timeline = timeline
        self._call = call

    def step(self, carried: Sighted, tick: int) -> tuple[Sighted, Observed]:
        """Fold one tick."""
        state, found = carried.state, list(carried.waiting)
        failure: Failure | None = None
        for scan in self._timeline.scans(tick):
            wanted = self._wants_safely(scan)
            if isinstance(wanted, Failure):
                failure = wanted
                continue
            if not wanted:
                continue
            before = self._begun() if state is None else state
            result = before if isinstance(before, Failure) else self._located(before, scan)
            if isinstance(result, Failure):
                failure = result
                state = None if isinstance(before, Failure) else before
            else:
                state = result[0]
                found.append(Waiting(result[1], scan, before))
        due = [w for w in found if w.observation.fix is None or w.observation.fix.t_ns <= tick * TICK_NS]
        waiting = tuple(w for w in found if w not in due)
        return Sighted(state, waiting), Observed(tuple(w.observation for w in due), failure)

    def question(self, tick: int, carried: Sighted, scan: Scan) -> Question | None:
        """Return what the fingerprint will be asked once ``scan`` is in the timeline, None where it is not wanted.

        Args:
            tick: the newest checkpoint before the scan's tick; all scans after it will be folded again.
            carried: the state there.
            scan: not in the timeline yet.
        """
        if self._wants_safely(scan) is not True:
            return None
        before = self._begun() if carried.state is None else carried.state
        if isinstance(before, Failure):
            return None
        fingerprint = self._stage.algorithm
        windows = self._timeline.windows_with(scan, tick, fingerprint.window)
        return Question(self._stage, before, windows)

    def snapshot(self, tick: int, carried: Sighted) -> FoldSnapshot | None:
        """Return the checkpoint after ``tick`` as a value, None where the stage's state cannot be packed.

        Observations may hold functions, so their scans stand in for them.
        """

        def packed() -> FoldSnapshot:
            waiting = tuple(WaitingSnapshot(w.scan, pack(w.before)) for w in carried.waiting)
            return FoldSnapshot(self._stage.key, tick, packed_state(carried.state), waiting=waiting)

        return kept_snapshot(self._call, self._stage, packed)

    def restored(self, kept: FoldSnapshot) -> Sighted:
        """Return the state that ``kept`` holds; the timeline must have been restored."""
        again = []
        for waiting in kept.waiting:
            before = unpacked_state(waiting.state, self._stage)
            result = self._located(before, waiting.scan)
            if not isinstance(result, Failure):
                again.append(Waiting(result[1], waiting.scan, before))
        return Sighted(unpacked_state(kept.state, self._stage), tuple(again))

    def _begun(self) -> Any:
        begin = self._stage.algorithm.start
        return self._call(self._stage, lambda begun: self._call.state(self._stage, begun), begin)

    def _located(self, state: Any, scan: Scan) -> Any:
        return self._call(self._stage, partial(self._check, scan), self._locate, state, scan)

    def _locate(self, state: Any, scan: Scan) -> Any:
        fingerprint = self._stage.algorithm
        return fingerprint.step(state, self._timeline.window(scan, fingerprint.window))

    def _check(self, scan: Scan, result: Any) -> tuple[Any, Observation]:
        state, observation = result
        observation = checked_observation(observation)
        if observation.fix is not None and observation.fix.t_ns > scan.t_ns + AHEAD_NS:
            raise ValueError(
                f"returned a fix dated {1e-9 * (observation.fix.t_ns - scan.t_ns):.1f} s after its scan, "
                f"at most {1e-9 * AHEAD_NS:g} s are allowed"
            )
        return self._call.state(self._stage, state), observation

    def _wants(self, scan: Scan) -> bool:
        return scan.source in self._stage.algorithm.window.sources

    def _wants_safely(self, scan: Scan) -> Any:
        return self._call(self._stage, bool, self._wants, scan)
