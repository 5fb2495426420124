"""One pipeline on one device: what its stages made of a tick → filter step → estimate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

from tickfix.api.events import TICK_NS, Fix
from tickfix.api.values import Belief, Estimate, Observation, Prior, Report, Status
from tickfix.kernel.moving import Moved
from tickfix.kernel.observing import Observed
from tickfix.kernel.randomness import Streams
from tickfix.kernel.snapshot import FoldSnapshot
from tickfix.kernel.stages import Caller, Failure, Pipeline, kept_snapshot, packed_state, unpacked_state
from tickfix.kernel.together import Answer, Asked, Asking, seen

COASTING_NS: Final = 10_000_000_000
"""Without an observation used for longer than this, an estimate is ``coasting``."""


@dataclass(frozen=True, slots=True)
class Carried:
    """What a tracker carries from tick to tick; ``state`` is the filter's, None until it has begun."""

    state: Any = None
    belief: Belief | None = None
    motion_ns: int | None = None
    used_ns: int | None = None


def external(fix: Fix) -> Observation:
    """Return a fix that another process computed as the observation it is."""
    return Observation(t_ns=fix.t_ns, source=fix.source, fix=fix)


class Tracker:
    """Makes the step that folds motion and observations into estimates.

    Args:
        device, epoch, pipeline: what is followed, since when, and how.
        known: a start that somebody told; without one the filter begins at its first observation.
        moved, observed: what the other stages made of a tick.
    """

    def __init__(
        self,
        device: str,
        epoch: int,
        pipeline: Pipeline,
        streams: Streams,
        call: Caller,
        *,
        known: Fix | None,
        first: Callable[[], int | None],
        moved: Callable[[int], Moved],
        observed: Callable[[int], Observed],
    ) -> None:
        """Keep what the steps need."""
        self._device = device
        self._epoch = epoch
        self._pipeline = pipeline
        self.key = pipeline.key
        self._stage = pipeline.filter
        self._filter = pipeline.filter.algorithm
        self._streams = streams
        self._call = call
        self._known = known
        self._first = first
        self._moved = moved
        self._observed = observed

    def step(self, carried: Carried, tick: int) -> Asking[tuple[Carried, Estimate]]:
        """Fold one tick; a stage that fails leaves the filter's state as it was."""
        moved, observed = self._moved(tick), self._observed(tick)
        failures = [f for f in (moved.failure, observed.failure) if f is not None]
        report = Report()
        state, belief = carried.state, carried.belief
        answer: Answer | None
        if state is None:
            answer = self._begin(tick, observed.observations)
        else:
            rng = partial(self._streams.at, self._epoch, tick, "filter")
            answer = yield Asked(self._stage, state, moved.motion, observed.observations, rng)
        if isinstance(answer, Failure):
            failures.append(answer)
        elif answer is not None:
            state, report, belief = answer.state, answer.report, answer.belief
        carried = Carried(
            state,
            belief,
            carried.motion_ns if moved.measured_ns is None else moved.measured_ns,
            tick * TICK_NS if report.used else carried.used_ns,
        )
        return carried, self._estimate(carried, tick, report, failures)

    def snapshot(self, tick: int, carried: Carried) -> FoldSnapshot | None:
        """Return the checkpoint after ``tick`` as a value, None where the filter's state cannot be packed."""

        def packed() -> FoldSnapshot:
            return FoldSnapshot(
                key=self.key,
                tick=tick,
                state=packed_state(carried.state),
                belief=carried.belief,
                motion_ns=carried.motion_ns,
                used_ns=carried.used_ns,
            )

        return kept_snapshot(self._call, self._stage, packed)

    def restored(self, kept: FoldSnapshot) -> Carried:
        """Return the state that ``kept`` holds."""
        return Carried(unpacked_state(kept.state, self._stage), kept.belief, kept.motion_ns, kept.used_ns)

    def _begin(self, tick: int, observations: tuple[Observation, ...]) -> Answer | None:
        """Try to start the filter; return None if it still waits."""
        t_ns = tick * TICK_NS
        if self._known is not None:
            if self._known.t_ns > t_ns:
                return None
            priors = [Prior(t_ns=t_ns, fix=self._known)]
        else:
            priors = [Prior(t_ns=t_ns, fix=o.fix, observation=o) for o in observations]
            if tick == self._first():
                priors.insert(0, Prior(t_ns=t_ns))
        for prior in priors:
            rng = self._streams.at(self._epoch, tick, "start")
            state = self._call(self._stage, self._checked_start, self._filter.start, prior, rng)
            if isinstance(state, Failure):
                return state
            if state is not None:
                report = Report(used=int(prior.fix is not None), reasons=("started",))
                return seen(self._stage, state, report, self._call)
        return None

    def _checked_start(self, state: Any) -> Any:
        return None if state is None else self._call.state(self._stage, state)

    def _estimate(self, carried: Carried, tick: int, report: Report, failures: list[Failure]) -> Estimate:
        t_ns = tick * TICK_NS
        used_age_ns = None if carried.used_ns is None else t_ns - carried.used_ns
        if failures:
            status = Status.FAILED
        elif carried.belief is None:
            status = Status.INITIALISING
        elif report.lost:
            status = Status.LOST
        elif used_age_ns is None or used_age_ns > COASTING_NS:
            status = Status.COASTING
        else:
            status = Status.TRACKING
        return Estimate(
            device=self._device,
            pipeline=self._pipeline.name,
            epoch=self._epoch,
            tick=tick,
            t_ns=t_ns,
            status=status,
            belief=carried.belief,
            motion_age_ns=None if carried.motion_ns is None else t_ns - carried.motion_ns,
            observation_age_ns=used_age_ns,
            innovation_m=report.innovation_m,
            gate=report.gate,
            failed_by="; ".join(map(str, failures)),
            reasons=report.reasons,
        )


def revised(estimate: Estimate, revision: int) -> Estimate:
    """Return the estimate as a revision."""
    return estimate if revision == estimate.revision else replace(estimate, revision=revision)
