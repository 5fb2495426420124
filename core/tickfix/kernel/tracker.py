"""One pipeline on one device: samples → motion, scans → observations, filter step, estimate.

Each function here makes the step of one stage's fold: a pure function of the state, the tick and the timeline.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final, TypeAlias

from tickfix.api.events import TICK_NS, Fix, Scan
from tickfix.api.values import Belief, Estimate, Motion, Observation, Prior, Report, Status
from tickfix.kernel.randomness import Streams
from tickfix.kernel.stages import (
    Caller,
    Failure,
    Pipeline,
    Stage,
    checked_belief,
    checked_motion,
    checked_observation,
    checked_report,
)
from tickfix.kernel.timeline import Timeline

COASTING_NS: Final = 10_000_000_000
"""Without an observation used for longer than this, an estimate is ``coasting``."""


@dataclass(frozen=True, slots=True)
class Moved:
    """What dead reckoning made of a tick; ``measured_ns`` is its newest motion sample's time."""

    motion: Motion
    measured_ns: int | None = None
    failure: Failure | None = None


@dataclass(frozen=True, slots=True)
class Observed:
    """What a fingerprint made of a tick's scans."""

    observations: tuple[Observation, ...] = ()
    failure: Failure | None = None


@dataclass(frozen=True, slots=True)
class Carried:
    """What a tracker carries from tick to tick; ``state`` is the filter's, None until it has begun."""

    state: Any = None
    belief: Belief | None = None
    motion_ns: int | None = None
    used_ns: int | None = None


MotionStep: TypeAlias = Callable[[Any, int], tuple[Any, Moved]]
ObservationStep: TypeAlias = Callable[[Any, int], tuple[Any, Observed]]
BeliefStep: TypeAlias = Callable[[Carried, int], tuple[Carried, Estimate]]


def motion_step(stage: Stage, timeline: Timeline, call: Caller) -> MotionStep:
    """Return the step that folds a tick's samples into motion."""
    pdr = stage.algorithm

    def check(result: Any) -> tuple[Any, Motion]:
        state, motion = result
        return call.state(stage, state), checked_motion(motion)

    def step(state: Any, tick: int) -> tuple[Any, Moved]:
        samples = timeline.motion(tick)
        newest = [int(s.t_ns[-1]) for name, s in samples.sensors.items() if name != "pressure"]
        measured_ns = max(newest, default=None)
        if state is None:
            state = call(stage, lambda begun: call.state(stage, begun), pdr.start)
        result = state if isinstance(state, Failure) else call(stage, check, pdr.step, state, samples)
        if isinstance(result, Failure):
            unknown = Motion.unknown(samples.t0_ns, samples.t1_ns)
            return None if isinstance(state, Failure) else state, Moved(unknown, measured_ns, result)
        return result[0], Moved(result[1], measured_ns)

    return step


def observation_step(stage: Stage, timeline: Timeline, call: Caller) -> ObservationStep:
    """Return the step that folds a tick's scans into observations.

    A fix counts at the tick that closes its interval. One that describes an instant after its scan waits until then.
    """
    fingerprint = stage.algorithm

    def check(result: Any) -> tuple[Any, Observation]:
        state, observation = result
        return call.state(stage, state), checked_observation(observation)

    def locate(state: Any, scan: Scan) -> Any:
        return fingerprint.step(state, timeline.window(scan, fingerprint.window))

    def wants(scan: Scan) -> bool:
        return scan.source in fingerprint.window.sources

    def step(carried: Any, tick: int) -> tuple[Any, Observed]:
        state, waiting = carried or (None, ())
        observations: list[Observation] = list(waiting)
        failure: Failure | None = None
        for scan in timeline.scans(tick):
            wanted = call(stage, bool, wants, scan)
            if isinstance(wanted, Failure):
                failure = wanted
                continue
            if not wanted:
                continue
            if state is None:
                state = call(stage, lambda begun: call.state(stage, begun), fingerprint.start)
            result = state if isinstance(state, Failure) else call(stage, check, locate, state, scan)
            if isinstance(result, Failure):
                failure = result
                state = None if isinstance(state, Failure) else state
            else:
                state = result[0]
                observations.append(result[1])
        due = tuple(o for o in observations if o.fix is None or o.fix.t_ns <= tick * TICK_NS)
        waiting = tuple(o for o in observations if o not in due)
        return (state, waiting), Observed(due, failure)

    return step


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
        self._stage = pipeline.filter
        self._filter = pipeline.filter.algorithm
        self._streams = streams
        self._call = call
        self._known = known
        self._first = first
        self._moved = moved
        self._observed = observed

    def step(self, carried: Carried, tick: int) -> tuple[Carried, Estimate]:
        """Fold one tick; a stage that fails leaves the filter's state as it was."""
        moved, observed = self._moved(tick), self._observed(tick)
        failures = [f for f in (moved.failure, observed.failure) if f is not None]
        report = Report()
        state, belief = carried.state, carried.belief
        result: Any
        if state is None:
            result = self._begin(tick, observed.observations)
        else:
            rng = self._streams.at(self._epoch, tick, "filter")
            arguments = (state, moved.motion, observed.observations, rng)
            result = self._call(self._stage, self._checked_step, self._filter.step, *arguments)
        if isinstance(result, Failure):
            failures.append(result)
        elif result is not None:
            seen = self._call(self._stage, checked_belief, self._filter.estimate, result[0])
            if isinstance(seen, Failure):
                failures.append(seen)
            else:
                (state, report), belief = result, seen
        carried = Carried(
            state,
            belief,
            carried.motion_ns if moved.measured_ns is None else moved.measured_ns,
            tick * TICK_NS if report.used else carried.used_ns,
        )
        return carried, self._estimate(carried, tick, report, failures)

    def _begin(self, tick: int, observations: tuple[Observation, ...]) -> Any:
        """Try to start the filter; return (state, report), None if it still waits, or the failure."""
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
                return state, Report(used=int(prior.fix is not None), reasons=("started",))
        return None

    def _checked_start(self, state: Any) -> Any:
        return None if state is None else self._call.state(self._stage, state)

    def _checked_step(self, result: Any) -> tuple[Any, Report]:
        state, report = result
        return self._call.state(self._stage, state), checked_report(report)

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
