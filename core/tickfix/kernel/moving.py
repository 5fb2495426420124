"""Dead reckoning on one device: the samples of each tick → motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tickfix.api.values import Motion
from tickfix.kernel.snapshot import FoldSnapshot
from tickfix.kernel.stages import Caller, Failure, Stage, checked_motion, kept_snapshot, packed_state, unpacked_state
from tickfix.kernel.timeline import Timeline


@dataclass(frozen=True, slots=True)
class Moved:
    """What dead reckoning made of a tick; ``measured_ns`` is its newest motion sample's time."""

    motion: Motion
    measured_ns: int | None = None
    failure: Failure | None = None


class MotionFold:
    """The fold of a tick's samples into motion."""

    def __init__(self, stage: Stage, timeline: Timeline, call: Caller) -> None:
        """Keep what the steps need."""
        self._stage = stage
        self._timeline = timeline
        self._call = call

    def step(self, state: Any, tick: int) -> tuple[Any, Moved]:
        """Fold one tick; None is the state before the first."""
        stage, call, pdr = self._stage, self._call, self._stage.algorithm
        samples = self._timeline.motion(tick)
        newest = [int(s.t_ns[-1]) for name, s in samples.sensors.items() if name != "pressure"]
        measured_ns = max(newest, default=None)
        if state is None:
            state = call(stage, lambda begun: call.state(stage, begun), pdr.start)
        result = state if isinstance(state, Failure) else call(stage, self._check, pdr.step, state, samples)
        if isinstance(result, Failure):
            unknown = Motion.unknown(samples.t0_ns, samples.t1_ns)
            return None if isinstance(state, Failure) else state, Moved(unknown, measured_ns, result)
        return result[0], Moved(result[1], measured_ns)

    def snapshot(self, tick: int, state: Any) -> FoldSnapshot | None:
        """Return the checkpoint after ``tick`` as a value, None where the stage's state cannot be packed."""
        key = self._stage.key
        return kept_snapshot(self._call, self._stage, lambda: FoldSnapshot(key, tick, packed_state(state)))

    def restored(self, kept: FoldSnapshot) -> Any:
        """Return the state that ``kept`` holds."""
        return unpacked_state(kept.state, self._stage)

    def _check(self, result: Any) -> tuple[Any, Motion]:
        state, motion = result
        return self._call.state(self._stage, state), checked_motion(motion)
