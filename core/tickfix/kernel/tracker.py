"""The stages of one device, tick by tick: samples → motion, scans → observations, and a pipeline's filter step →
estimate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

from tickfix.api.events import TICK_NS, Fix, Scan
from tickfix.api.packing import pack
from tickfix.api.values import Belief, Estimate, Motion, Observation, Prior, Readings, Report, Status
from tickfix.kernel.batch import InputRequest, StepAnswer, StepCoroutine, StepRequest, with_estimate
from tickfix.kernel.determinism import RandomStreams
from tickfix.kernel.fold import StageFold
from tickfix.kernel.measurements import tick_of
from tickfix.kernel.snapshot import FoldSnapshot, WaitingSnapshot
from tickfix.kernel.stages import (
    KernelSetup,
    Pipeline,
    Stage,
    StageFailure,
    checked_belief,
    checked_motion,
    checked_observation,
    packed_state,
    smoothing_ticks,
    unpacked_state,
)
from tickfix.kernel.timeline import MOTION_SENSORS, ChangedTicks, Timeline


@dataclass(frozen=True, slots=True)
class MotionResult:
    """What dead reckoning made of a tick; ``measured_ns`` is its newest motion sample's time."""

    motion: Motion
    measured_ns: int | None = None
    failure: StageFailure | None = None


class MotionFold(StageFold[Any, MotionResult]):
    """The fold of a tick's samples into motion."""

    def __init__(self, stage: Stage, timeline: Timeline, setup: KernelSetup) -> None:
        """Begin before the first tick."""
        super().__init__(stage.key, stage, setup, lambda: None)
        self._timeline = timeline
        self._is_batched = hasattr(stage.algorithm, "step_many")

    def fold_to(self, tick: int, first: int) -> StepCoroutine[None]:  # noqa: ARG002 - the interface
        """Fold up to and including ``tick``, asking for the steps of a pdr that has ``step_many``."""
        return self.advance(tick, self.step)

    def changed_since(self, changes: ChangedTicks, upstream: int | None) -> int | None:  # noqa: ARG002 - the interface
        """Return the earliest tick whose samples changed."""
        return changes.motion

    def step(self, state: Any, tick: int) -> StepCoroutine[tuple[Any, MotionResult]]:
        """Fold one tick; None is the state before the first."""
        stage, call, pdr = self._stage, self._call, self._stage.algorithm
        samples = self._timeline.motion(tick)
        newest = [int(s.t_ns[-1]) for name, s in samples.sensors.items() if name in MOTION_SENSORS]
        measured_ns = max(newest, default=None)
        if state is None:
            state = call(stage, lambda begun: call.state(stage, begun), pdr.start)
        if isinstance(state, StageFailure):
            result = state
        elif self._is_batched:
            result = yield InputRequest(stage, state, lambda: samples, self._check)
        else:
            result = call(stage, self._check, pdr.step, state, samples)
        if isinstance(result, StageFailure):
            unknown = Motion.unknown(samples.t0_ns, samples.t1_ns)
            return None if isinstance(state, StageFailure) else state, MotionResult(unknown, measured_ns, result)
        return result[0], MotionResult(result[1], measured_ns)

    def packed(self, tick: int, state: Any) -> FoldSnapshot:
        """Return the checkpoint after ``tick`` as a value."""
        return FoldSnapshot(self.key, tick, packed_state(state))

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


class ObservationFold(StageFold[FingerprintState, ObservationResult]):
    """The fold of a tick's scans into observations.

    A fix counts at the tick that closes its interval. One that describes an instant after its scan waits until then.
    """

    def __init__(self, stage: Stage, timeline: Timeline, setup: KernelSetup) -> None:
        """Begin before the first tick."""
        super().__init__(stage.key, stage, setup, FingerprintState)
        self._timeline = timeline
        self._is_batched = hasattr(stage.algorithm, "step_many")

    def fold_to(self, tick: int, first: int) -> StepCoroutine[None]:  # noqa: ARG002 - the interface
        """Fold up to and including ``tick``, asking for the steps of a fingerprint that has ``step_many``."""
        return self.advance(tick, self.step)

    def changed_since(self, changes: ChangedTicks, upstream: int | None) -> int | None:  # noqa: ARG002 - the interface
        """Return the earliest tick whose scans changed.

        A scan also stands in the windows of the scans after it, which are folded again with it.
        """
        return changes.scans

    def step(
        self, fingerprint_state: FingerprintState, tick: int
    ) -> StepCoroutine[tuple[FingerprintState, ObservationResult]]:
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
            if isinstance(before, StageFailure):
                result = before
            elif self._is_batched:
                result = yield InputRequest(
                    self._stage, before, partial(self._window, scan), partial(self._check, scan)
                )
            else:
                result = self._guarded_step(before, scan)
            if isinstance(result, StageFailure):
                failure = result
                state = None if isinstance(before, StageFailure) else before
            else:
                state = result[0]
                found.append(PendingObservation(result[1], scan, before))
        due = [w for w in found if w.observation.fix is None or w.observation.fix.t_ns <= tick * TICK_NS]
        waiting = tuple(w for w in found if w not in due)
        return FingerprintState(state, waiting), ObservationResult(tuple(w.observation for w in due), failure)

    def fingerprint_request(self, scan: Scan) -> FingerprintRequest | None:
        """Return what the fingerprint will be asked once ``scan``, which is not in the timeline yet, is inserted.

        Returns None where the fingerprint does not want it.
        """
        # All scans after the newest checkpoint before the scan's tick will be folded again.
        tick, fingerprint_state = self.before(tick_of(scan.t_ns)) or (-1, FingerprintState())
        if self._guarded_wants(scan) is not True:
            return None
        before = self._start_state() if fingerprint_state.state is None else fingerprint_state.state
        if isinstance(before, StageFailure):
            return None
        fingerprint = self._stage.algorithm
        windows = self._timeline.windows_with(scan, tick, fingerprint.window)
        return FingerprintRequest(self._stage, before, windows)

    def packed(self, tick: int, state: FingerprintState) -> FoldSnapshot:
        """Return the checkpoint after ``tick`` as a value.

        Observations may hold functions, so their scans are kept in their place.
        """
        waiting = tuple(WaitingSnapshot(w.scan, pack(w.before)) for w in state.waiting)
        return FoldSnapshot(self.key, tick, packed_state(state.state), waiting=waiting)

    def unpacked(self, kept: FoldSnapshot) -> FingerprintState:
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

    def _window(self, scan: Scan) -> Readings:
        return self._timeline.window(scan, self._stage.algorithm.window)

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


@dataclass(frozen=True, slots=True)
class TrackerResult:
    """A pipeline's estimate at a tick.

    Attributes:
        estimate: as the filter computed it forwards, revision 0.
        state: the filter's after the tick, for a filter that smooths; None if it has not started or failed there.
    """

    estimate: Estimate
    state: Any = None


def observation_of_fix(fix: Fix) -> Observation:
    """Return a fix that another process computed as the observation it is."""
    return Observation(t_ns=fix.t_ns, source=fix.source, fix=fix)


class Tracker:
    """Makes the step that folds motion and observations into estimates.

    Args:
        device, epoch, pipeline: what is followed, since when, and how.
        known: the start, where it is known; without one the filter begins at its first observation.
    """

    def __init__(
        self,
        setup: KernelSetup,
        pipeline: Pipeline,
        device: str,
        epoch: int,
        streams: RandomStreams,
        known: Fix | None,
    ) -> None:
        """Keep what the steps need."""
        self._device = device
        self._epoch = epoch
        self._pipeline = pipeline
        self._stage = pipeline.filter
        self._filter = pipeline.filter.algorithm
        self._streams = streams
        self._call = setup.call
        self._known = known
        self._lag = smoothing_ticks(self._stage)

    def step(
        self,
        tracker_state: TrackerState,
        tick: int,
        motion_result: MotionResult,
        observation_result: ObservationResult,
        first: int,
    ) -> StepCoroutine[tuple[TrackerState, TrackerResult]]:
        """Fold one tick; a stage that fails leaves the filter's state as it was.

        Args:
            tracker_state: before the tick.
            tick: to fold.
            motion_result, observation_result: what the other stages made of it.
            first: the epoch's first tick, at which a filter may start without a place.
        """
        failures = [f for f in (motion_result.failure, observation_result.failure) if f is not None]
        report = Report()
        state, belief = tracker_state.state, tracker_state.belief
        answer: StepAnswer | None
        if state is None:
            answer = self._begin(tick, observation_result.observations, first)
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
        estimate = self._estimate(tracker_state, tick, report, failures)
        # A failed step leaves the state of the tick before, which is no state of this tick to smooth with.
        stepped = self._lag is not None and answer is not None and not isinstance(answer, StageFailure)
        return tracker_state, TrackerResult(estimate, state if stepped else None)

    def smoothed(self, tick: int, last: int, results: Mapping[int, TrackerResult]) -> Belief | None:
        """Return the belief at ``tick`` given the ticks of the lag after it; None if it stays what it is.

        Args:
            tick: to smooth.
            last: the newest tick that may be used; it and all before it can no longer change.
            results: of these ticks.
        """
        if self._lag is None:
            return None
        states = []
        for k in range(tick, min(tick + self._lag, last) + 1):
            if results[k].state is None:
                break
            states.append(results[k].state)
        if not states:
            return None
        belief = self._call(self._stage, partial(checked_belief, method="smooth"), self._filter.smooth, tuple(states))
        return None if isinstance(belief, StageFailure) else belief

    def _begin(self, tick: int, observations: tuple[Observation, ...], first: int) -> StepAnswer | None:
        """Try to start the filter; return None if it still waits."""
        t_ns = tick * TICK_NS
        if self._known is not None:
            if self._known.t_ns > t_ns:
                return None
            priors = [Prior(t_ns=t_ns, fix=self._known)]
        else:
            priors = [Prior(t_ns=t_ns, fix=o.fix, observation=o) for o in observations]
            if tick == first:
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
            diagnostics=report.diagnostics,
        )


class TrackerFold(StageFold[TrackerState, TrackerResult]):
    """The fold of what the other stages made of a tick into a pipeline's estimates.

    Args:
        tracker: makes the steps.
        motion, observations: the pipeline's folds, None where it has none; they are folded before this one.
    """

    def __init__(
        self,
        setup: KernelSetup,
        pipeline: Pipeline,
        timeline: Timeline,
        tracker: Tracker,
        motion: MotionFold | None,
        observations: ObservationFold | None,
    ) -> None:
        """Begin before the first tick."""
        super().__init__(pipeline.key, pipeline.filter, setup, TrackerState)
        self._timeline = timeline
        self._tracker = tracker
        self._motion = motion
        self._observations = observations

    def fold_to(self, tick: int, first: int) -> StepCoroutine[None]:
        """Fold up to and including ``tick``, asking for the filter's steps."""
        for k, state in self.pending_ticks(tick):
            after, result = yield from self._tracker.step(
                state, k, self._motion_result(k), self._observation_result(k), first
            )
            self.record(k, after, result)

    def smoothed(self, tick: int, last: int) -> Belief | None:
        """Return the smoothed belief at ``tick``, None if it stays what it is; see :meth:`Tracker.smoothed`."""
        return self._tracker.smoothed(tick, last, self.outputs)

    def changed_since(self, changes: ChangedTicks, upstream: int | None) -> int | None:  # noqa: ARG002 - the interface
        """Return the earliest tick that anything changed, also of stages of other pipelines.

        An estimate holds the age of the newest motion sample, so that even a pipeline without pdr is folded again.
        """
        return upstream

    def packed(self, tick: int, state: TrackerState) -> FoldSnapshot:
        """Return the checkpoint after ``tick`` as a value."""
        return FoldSnapshot(
            key=self.key,
            tick=tick,
            state=packed_state(state.state),
            belief=state.belief,
            motion_ns=state.motion_ns,
            used_ns=state.used_ns,
        )

    def unpacked(self, kept: FoldSnapshot) -> TrackerState:
        """Return the state that ``kept`` holds."""
        return TrackerState(unpacked_state(kept.state, self._stage), kept.belief, kept.motion_ns, kept.used_ns)

    def _motion_result(self, tick: int) -> MotionResult:
        if self._motion is None:
            return MotionResult(Motion.unknown((tick - 1) * TICK_NS, tick * TICK_NS))
        return self._motion.outputs[tick]

    def _observation_result(self, tick: int) -> ObservationResult:
        own = ObservationResult() if self._observations is None else self._observations.outputs[tick]
        fixes = self._timeline.fixes(tick)
        if not fixes:
            return own
        return ObservationResult(own.observations + tuple(observation_of_fix(fix) for fix in fixes), own.failure)


def as_revision(estimate: Estimate, revision: int) -> Estimate:
    """Return the estimate as a revision."""
    return estimate if revision == estimate.revision else replace(estimate, revision=revision)
