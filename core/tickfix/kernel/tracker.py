"""The stages of one device, tick by tick: samples → motion, scans → observations, and a pipeline's filter step →
estimate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

from tickfix.api.events import TICK_NS, Fix, Scan
from tickfix.api.packing import pack
from tickfix.api.values import Belief, Estimate, Motion, Observation, Prior, Readings, Report, Status
from tickfix.kernel.batch import StepAnswer, StepCoroutine, StepRequest, with_estimate
from tickfix.kernel.determinism import RandomStreams
from tickfix.kernel.snapshot import FoldSnapshot, WaitingSnapshot
from tickfix.kernel.stages import (
    Pipeline,
    Stage,
    StageCaller,
    StageFailure,
    checked_motion,
    checked_observation,
    checked_snapshot,
    packed_state,
    unpacked_state,
)
from tickfix.kernel.timeline import Timeline


@dataclass(frozen=True, slots=True)
class MotionResult:
    """What dead reckoning made of a tick; ``measured_ns`` is its newest motion sample's time."""

    motion: Motion
    measured_ns: int | None = None
    failure: StageFailure | None = None


class MotionFold:
    """The fold of a tick's samples into motion."""

    def __init__(self, stage: Stage, timeline: Timeline, call: StageCaller) -> None:
        """Keep what the steps need."""
        self._stage = stage
        self._timeline = timeline
        self._call = call

    def step(self, state: Any, tick: int) -> tuple[Any, MotionResult]:
        """Fold one tick; None is the state before the first."""
        stage, call, pdr = self._stage, self._call, self._stage.algorithm
        samples = self._timeline.motion(tick)
        newest = [int(s.t_ns[-1]) for name, s in samples.sensors.items() if name != "pressure"]
        measured_ns = max(newest, default=None)
        if state is None:
            state = call(stage, lambda begun: call.state(stage, begun), pdr.start)
        result = state if isinstance(state, StageFailure) else call(stage, self._check, pdr.step, state, samples)
        if isinstance(result, StageFailure):
            unknown = Motion.unknown(samples.t0_ns, samples.t1_ns)
            return None if isinstance(state, StageFailure) else state, MotionResult(unknown, measured_ns, result)
        return result[0], MotionResult(result[1], measured_ns)

    def snapshot(self, tick: int, state: Any) -> FoldSnapshot | None:
        """Return the checkpoint after ``tick`` as a value, None where the stage's state cannot be packed."""
        key = self._stage.key
        return checked_snapshot(self._call, self._stage, lambda: FoldSnapshot(key, tick, packed_state(state)))

    def restored(self, kept: FoldSnapshot) -> Any:
        """Return the state that ``kept`` holds."""
        return unpacked_state(kept.state, self._stage)

    def _check(self, result: Any) -> tuple[Any, Motion]:
        state, motion = result
        return self._call.state(self._stage, state), checked_motion(motion)


MAX_FIX_LEAD_NS: Final = 5_000_000_000
"""How far after its scan a fix may be dated: it waits for its tick until then."""


@dataclass(frozen=True, slots=True)
class ObservationResult:
    """What a fingerprint made of a tick's scans."""

    observations: tuple[Observation, ...] = ()
    failure: StageFailure | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PendingObservation:
    """An observation whose fix describes an instant to come; its scan and the state before it make it again."""

    observation: Observation
    scan: Scan
    before: Any


@dataclass(frozen=True, slots=True)
class FingerprintState:
    """What a fingerprint carries from tick to tick; ``state`` is None until it has begun."""

    state: Any = None
    waiting: tuple[PendingObservation, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class FingerprintRequest:
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

    def __init__(self, stage: Stage, timeline: Timeline, call: StageCaller) -> None:
        """Keep what the steps need."""
        self._stage = stage
        self._timeline = timeline
        self._call = call

    def step(self, fingerprint_state: FingerprintState, tick: int) -> tuple[FingerprintState, ObservationResult]:
        """Fold one tick."""
        state, found = fingerprint_state.state, list(fingerprint_state.waiting)
        failure: StageFailure | None = None
        for scan in self._timeline.scans(tick):
            wanted = self._guarded_wants(scan)
            if isinstance(wanted, StageFailure):
                failure = wanted
                continue
            if not wanted:
                continue
            before = self._start_state() if state is None else state
            result = before if isinstance(before, StageFailure) else self._guarded_step(before, scan)
            if isinstance(result, StageFailure):
                failure = result
                state = None if isinstance(before, StageFailure) else before
            else:
                state = result[0]
                found.append(PendingObservation(result[1], scan, before))
        due = [w for w in found if w.observation.fix is None or w.observation.fix.t_ns <= tick * TICK_NS]
        waiting = tuple(w for w in found if w not in due)
        return FingerprintState(state, waiting), ObservationResult(tuple(w.observation for w in due), failure)

    def fingerprint_request(
        self, tick: int, fingerprint_state: FingerprintState, scan: Scan
    ) -> FingerprintRequest | None:
        """Return what the fingerprint will be asked once ``scan`` is in the timeline, None where it is not wanted.

        Args:
            tick: the newest checkpoint before the scan's tick; all scans after it will be folded again.
            fingerprint_state: the state there.
            scan: not in the timeline yet.
        """
        if self._guarded_wants(scan) is not True:
            return None
        before = self._start_state() if fingerprint_state.state is None else fingerprint_state.state
        if isinstance(before, StageFailure):
            return None
        fingerprint = self._stage.algorithm
        windows = self._timeline.windows_with(scan, tick, fingerprint.window)
        return FingerprintRequest(self._stage, before, windows)

    def snapshot(self, tick: int, fingerprint_state: FingerprintState) -> FoldSnapshot | None:
        """Return the checkpoint after ``tick`` as a value, None where the stage's state cannot be packed.

        Observations may hold functions, so their scans stand in for them.
        """

        def packed() -> FoldSnapshot:
            waiting = tuple(WaitingSnapshot(w.scan, pack(w.before)) for w in fingerprint_state.waiting)
            return FoldSnapshot(self._stage.key, tick, packed_state(fingerprint_state.state), waiting=waiting)

        return checked_snapshot(self._call, self._stage, packed)

    def restored(self, kept: FoldSnapshot) -> FingerprintState:
        """Return the state that ``kept`` holds; the timeline must have been restored."""
        again = []
        for waiting in kept.waiting:
            before = unpacked_state(waiting.state, self._stage)
            result = self._guarded_step(before, waiting.scan)
            if not isinstance(result, StageFailure):
                again.append(PendingObservation(result[1], waiting.scan, before))
        return FingerprintState(unpacked_state(kept.state, self._stage), tuple(again))

    def _start_state(self) -> Any:
        begin = self._stage.algorithm.start
        return self._call(self._stage, lambda begun: self._call.state(self._stage, begun), begin)

    def _guarded_step(self, state: Any, scan: Scan) -> Any:
        return self._call(self._stage, partial(self._check, scan), self._step_window, state, scan)

    def _step_window(self, state: Any, scan: Scan) -> Any:
        fingerprint = self._stage.algorithm
        return fingerprint.step(state, self._timeline.window(scan, fingerprint.window))

    def _check(self, scan: Scan, result: Any) -> tuple[Any, Observation]:
        state, observation = result
        observation = checked_observation(observation)
        if observation.fix is not None and observation.fix.t_ns > scan.t_ns + MAX_FIX_LEAD_NS:
            raise ValueError(
                f"returned a fix dated {1e-9 * (observation.fix.t_ns - scan.t_ns):.1f} s after its scan, "
                f"at most {1e-9 * MAX_FIX_LEAD_NS:g} s are allowed"
            )
        return self._call.state(self._stage, state), observation

    def _wants(self, scan: Scan) -> bool:
        return scan.source in self._stage.algorithm.window.sources

    def _guarded_wants(self, scan: Scan) -> Any:
        return self._call(self._stage, bool, self._wants, scan)


COASTING_NS: Final = 10_000_000_000
"""Without an observation used for longer than this, an estimate is ``coasting``."""


@dataclass(frozen=True, slots=True)
class TrackerState:
    """What a tracker carries from tick to tick; ``state`` is the filter's, None until it has begun."""

    state: Any = None
    belief: Belief | None = None
    motion_ns: int | None = None
    used_ns: int | None = None


def observation_of_fix(fix: Fix) -> Observation:
    """Return a fix that another process computed as the observation it is."""
    return Observation(t_ns=fix.t_ns, source=fix.source, fix=fix)


class Tracker:
    """Makes the step that folds motion and observations into estimates.

    Args:
        device, epoch, pipeline: what is followed, since when, and how.
        known: a start that somebody told; without one the filter begins at its first observation.
        motion_result, observation_result: what the other stages made of a tick.
    """

    def __init__(
        self,
        device: str,
        epoch: int,
        pipeline: Pipeline,
        streams: RandomStreams,
        call: StageCaller,
        *,
        known: Fix | None,
        first: Callable[[], int | None],
        motion_result: Callable[[int], MotionResult],
        observation_result: Callable[[int], ObservationResult],
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
        self._motion_result = motion_result
        self._observation_result = observation_result

    def step(self, tracker_state: TrackerState, tick: int) -> StepCoroutine[tuple[TrackerState, Estimate]]:
        """Fold one tick; a stage that fails leaves the filter's state as it was."""
        motion_result, observation_result = self._motion_result(tick), self._observation_result(tick)
        failures = [f for f in (motion_result.failure, observation_result.failure) if f is not None]
        report = Report()
        state, belief = tracker_state.state, tracker_state.belief
        answer: StepAnswer | None
        if state is None:
            answer = self._begin(tick, observation_result.observations)
        else:
            rng = partial(self._streams.at, self._epoch, tick, "filter")
            answer = yield StepRequest(self._stage, state, motion_result.motion, observation_result.observations, rng)
        if isinstance(answer, StageFailure):
            failures.append(answer)
        elif answer is not None:
            state, report, belief = answer.state, answer.report, answer.belief
        tracker_state = TrackerState(
            state,
            belief,
            tracker_state.motion_ns if motion_result.measured_ns is None else motion_result.measured_ns,
            tick * TICK_NS if report.used else tracker_state.used_ns,
        )
        return tracker_state, self._estimate(tracker_state, tick, report, failures)

    def snapshot(self, tick: int, tracker_state: TrackerState) -> FoldSnapshot | None:
        """Return the checkpoint after ``tick`` as a value, None where the filter's state cannot be packed."""

        def packed() -> FoldSnapshot:
            return FoldSnapshot(
                key=self.key,
                tick=tick,
                state=packed_state(tracker_state.state),
                belief=tracker_state.belief,
                motion_ns=tracker_state.motion_ns,
                used_ns=tracker_state.used_ns,
            )

        return checked_snapshot(self._call, self._stage, packed)

    def restored(self, kept: FoldSnapshot) -> TrackerState:
        """Return the state that ``kept`` holds."""
        return TrackerState(unpacked_state(kept.state, self._stage), kept.belief, kept.motion_ns, kept.used_ns)

    def _begin(self, tick: int, observations: tuple[Observation, ...]) -> StepAnswer | None:
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
            if isinstance(state, StageFailure):
                return state
            if state is not None:
                report = Report(used=int(prior.fix is not None), reasons=("started",))
                return with_estimate(self._stage, state, report, self._call)
        return None

    def _checked_start(self, state: Any) -> Any:
        return None if state is None else self._call.state(self._stage, state)

    def _estimate(
        self, tracker_state: TrackerState, tick: int, report: Report, failures: list[StageFailure]
    ) -> Estimate:
        t_ns = tick * TICK_NS
        used_age_ns = None if tracker_state.used_ns is None else t_ns - tracker_state.used_ns
        if failures:
            status = Status.FAILED
        elif tracker_state.belief is None:
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
            belief=tracker_state.belief,
            motion_age_ns=None if tracker_state.motion_ns is None else t_ns - tracker_state.motion_ns,
            observation_age_ns=used_age_ns,
            innovation_m=report.innovation_m,
            nis=report.nis,
            failed_by="; ".join(map(str, failures)),
            reasons=report.reasons,
        )


def as_revision(estimate: Estimate, revision: int) -> Estimate:
    """Return the estimate as a revision."""
    return estimate if revision == estimate.revision else replace(estimate, revision=revision)
