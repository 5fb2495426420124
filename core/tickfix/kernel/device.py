"""One device under all pipelines: the epochs of its clock, with the folds and the published and settled tracks of
each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from tickfix.api.events import TICK_NS, Event, Fix, Scan
from tickfix.api.values import Estimate, Motion, Observation
from tickfix.kernel.batch import StepCoroutine, step_one
from tickfix.kernel.deduplication import MessageOutcome
from tickfix.kernel.determinism import RandomStreams
from tickfix.kernel.fold import Fold, earliest
from tickfix.kernel.measurements import Measurement, split_event, tick_of
from tickfix.kernel.snapshot import DeviceSnapshot, EpochSnapshot, FoldSnapshot
from tickfix.kernel.stages import Pipeline, StageCaller
from tickfix.kernel.timeline import Timeline
from tickfix.kernel.tracker import (
    FingerprintRequest,
    FingerprintState,
    MotionFold,
    MotionResult,
    ObservationFold,
    ObservationResult,
    Tracker,
    TrackerState,
    as_revision,
    observation_of_fix,
)

S = TypeVar("S")
O = TypeVar("O")  # noqa: E741 - output


@dataclass(slots=True)
class KernelOutput:
    """What a run of the kernel says, each list in the order of ticks, and of pipelines within a tick.

    Attributes:
        published: estimates of ticks that closed, revision 0.
        revised: estimates of ticks closed before, after late events.
        settled: the last revision of ticks that nothing can change any more.
        observations: what the fingerprints saw in those ticks, by the key of their stage.
    """

    published: list[Estimate] = field(default_factory=list)
    revised: list[Estimate] = field(default_factory=list)
    settled: list[Estimate] = field(default_factory=list)
    observations: list[tuple[str, Observation]] = field(default_factory=list)


class Epoch:
    """One epoch of one device's clock: a timeline and what the stages make of it.

    Args:
        horizon_ns: how late an event may be.
        checkpoint_bytes: memory for checkpoints.
    """

    def __init__(
        self,
        device: str,
        epoch: int,
        pipelines: Sequence[Pipeline],
        streams: RandomStreams,
        call: StageCaller,
        counts: Counter[str],
        *,
        horizon_ns: int,
        checkpoint_bytes: int,
        known: Fix | None,
    ) -> None:
        """Build the folds: one per distinct pdr and fingerprint, one per pipeline."""
        self.timeline = Timeline(horizon_ns, counts)
        self._pipelines = pipelines
        self._call = call
        self._horizon = horizon_ns // TICK_NS
        self._began: int | None = None
        self._published: int | None = None
        self._settled: int | None = None
        self._revisions: dict[int, int] = {}
        pdrs = {p.pdr.key: p.pdr for p in pipelines if p.pdr is not None}
        fingerprints = {p.fingerprint.key: p.fingerprint for p in pipelines if p.fingerprint is not None}
        budget = checkpoint_bytes // max(1, len(pdrs) + len(fingerprints) + len(pipelines))
        sizes = {"horizon": self._horizon, "budget_bytes": budget}
        self._moving = {key: MotionFold(stage, self.timeline, call) for key, stage in pdrs.items()}
        self._observing = {key: ObservationFold(stage, self.timeline, call) for key, stage in fingerprints.items()}
        self._tracking: dict[str, Tracker] = {}
        self._motion: dict[str, Fold[object, MotionResult]] = {key: Fold(lambda: None, **sizes) for key in self._moving}
        self._observations: dict[str, Fold[FingerprintState, ObservationResult]] = {
            key: Fold(FingerprintState, **sizes) for key in self._observing
        }
        self._beliefs: dict[str, Fold[TrackerState, Estimate]] = {}
        for pipeline in pipelines:
            tracker = Tracker(
                device,
                epoch,
                pipeline,
                streams,
                call,
                known=known,
                first=lambda: self._began,
                motion_result=lambda tick, p=pipeline: self._motion_result(p, tick),  # type: ignore[misc]
                observation_result=lambda tick, p=pipeline: self._observation_result(p, tick),  # type: ignore[misc]
            )
            self._tracking[pipeline.name] = tracker
            self._beliefs[pipeline.name] = Fold(TrackerState, **sizes)

    def run(self, tick: int | None, output: KernelOutput) -> StepCoroutine[None]:
        """Close the ticks up to ``tick`` (None: none yet), fold what is new or late, and say what came of it."""
        first = self.timeline.first
        if tick is None or first is None or tick < first:
            return
        changed = self._rewind(first)
        if self._published is not None and changed is not None and changed <= self._published:
            for k in range(changed, self._published + 1):
                self._revisions[k] = self._revisions.get(k, 0) + 1
            yield from self._fold(self._published)
            output.revised += self._estimates(changed, self._published)
        for k in range(first if self._published is None else self._published + 1, tick + 1):
            self.timeline.close(k)
            yield from self._fold(k)
            output.published += self._estimates(k, k)
            self._published = k
            self._revisions.setdefault(k, 0)
        self._settle(tick - self._horizon - 1, output)

    def finish(self, output: KernelOutput) -> StepCoroutine[None]:
        """Close and settle everything; the epoch is over, and nothing may be asked of it any more."""
        self.timeline.finish()
        newest = self.timeline.newest
        yield from self.run(newest, output)
        if self._published is not None:
            self._settle(self._published, output)
        # Trackers ask the epoch that holds them: let go of, all is freed now, not when the collector comes by.
        for stages in (self._moving, self._observing, self._tracking, self._motion, self._observations, self._beliefs):
            stages.clear()

    @property
    def published(self) -> int | None:
        """The newest tick that was published."""
        return self._published

    def fingerprint_requests(self, scan: Scan) -> list[FingerprintRequest]:
        """Return what the fingerprints will be asked once ``scan`` is inserted."""
        requests = []
        for key, observing in self._observing.items():
            tick, state = self._observations[key].before(tick_of(scan.t_ns)) or (-1, FingerprintState())
            requests.append(observing.fingerprint_request(tick, state, scan))
        return [fingerprint_request for fingerprint_request in requests if fingerprint_request is not None]

    def snapshot(self) -> EpochSnapshot:
        """Return the epoch as a value; whatever was fed must have been run."""
        folds: list[FoldSnapshot | None] = []
        if self._began is not None:
            folds += [moving.snapshot(*self._motion[key].oldest) for key, moving in self._moving.items()]
            folds += [observing.snapshot(*self._observations[key].oldest) for key, observing in self._observing.items()]
            folds += [tracker.snapshot(*self._beliefs[name].oldest) for name, tracker in self._tracking.items()]
        return EpochSnapshot(
            timeline=self.timeline.snapshot(),
            began=self._began,
            published=self._published,
            settled=self._settled,
            revisions=tuple(self._revisions.items()),
            folds=tuple(fold for fold in folds if fold is not None),
        )

    def restore(self, kept: EpochSnapshot) -> StepCoroutine[None]:
        """Become what ``kept`` says; a stage that it does not know begins with the oldest tick that is known."""
        self.timeline.restore(kept.timeline)
        self._began, self._published, self._settled = kept.began, kept.published, kept.settled
        self._revisions = dict(kept.revisions)
        if kept.began is None or kept.published is None:
            return
        known = {fold.key: fold for fold in kept.folds}
        oldest = min((fold.tick for fold in kept.folds), default=kept.began - 1)
        for key, moving in self._moving.items():
            _restore_fold(self._motion[key], known.get(key), moving.restored, oldest)
        for key, observing in self._observing.items():
            _restore_fold(self._observations[key], known.get(key), observing.restored, oldest)
        for name, tracker in self._tracking.items():
            _restore_fold(self._beliefs[name], known.get(tracker.key), tracker.restored, oldest)
        yield from self._fold(kept.published)

    def _folds(
        self,
    ) -> list[Fold[object, MotionResult] | Fold[FingerprintState, ObservationResult] | Fold[TrackerState, Estimate]]:
        return [*self._motion.values(), *self._observations.values(), *self._beliefs.values()]

    def _rewind(self, first: int) -> int | None:
        """Take the timeline's changes into account; return the earliest tick that has to be folded again, if any."""
        changes = self.timeline.changes
        motion, scans, fixes = changes.motion, changes.scans, changes.fixes
        changes.motion = changes.scans = changes.fixes = None
        if self._began is None or first < self._began:
            self._began = first
            for fold in self._folds():
                fold.begin(first)
            return first
        # A scan also stands in the windows of the scans after it, which are folded again with it.
        for folds, since in ((self._motion, motion), (self._observations, scans)):
            if since is not None:
                for fold in folds.values():
                    fold.rewind(since)
        changed = earliest(motion if self._motion else None, scans if self._observations else None, fixes)
        # Ages of motion are told of every pipeline, so that even one without pdr is folded again.
        if changed is not None:
            for belief in self._beliefs.values():
                belief.rewind(changed)
        return changed

    def _fold(self, tick: int) -> StepCoroutine[None]:
        for key, moving in self._moving.items():
            self._motion[key].advance(tick, moving.step)
        for key, observing in self._observing.items():
            self._observations[key].advance(tick, observing.step)
        for name, tracker in self._tracking.items():
            beliefs = self._beliefs[name]
            for k, state in beliefs.pending_ticks(tick):
                after, estimate = yield from tracker.step(state, k)
                beliefs.record(k, after, estimate)

    def _motion_result(self, pipeline: Pipeline, tick: int) -> MotionResult:
        if pipeline.pdr is None:
            return MotionResult(Motion.unknown((tick - 1) * TICK_NS, tick * TICK_NS))
        return self._motion[pipeline.pdr.key].outputs[tick]

    def _observation_result(self, pipeline: Pipeline, tick: int) -> ObservationResult:
        fixes = self.timeline.fixes(tick)
        own = (
            ObservationResult()
            if pipeline.fingerprint is None
            else self._observations[pipeline.fingerprint.key].outputs[tick]
        )
        if not fixes:
            return own
        return ObservationResult(own.observations + tuple(observation_of_fix(fix) for fix in fixes), own.failure)

    def _estimates(self, first: int, last: int) -> list[Estimate]:
        return [
            as_revision(self._beliefs[p.name].outputs[k], self._revisions.get(k, 0))
            for k in range(first, last + 1)
            for p in self._pipelines
        ]

    def _settle(self, tick: int, output: KernelOutput) -> None:
        if self._began is None:
            return
        start = self._began if self._settled is None else self._settled + 1
        if tick < start:
            return
        output.settled += self._estimates(start, tick)
        for key, observation_result in self._observations.items():
            for k in range(start, tick + 1):
                output.observations += [
                    (key, observation) for observation in observation_result.outputs[k].observations
                ]
        self._settled = tick
        # No fold forgets what another one's oldest checkpoint needs to go on from: a snapshot keeps nothing else.
        folds = self._folds()
        refold_from = min([fold.refold_from(tick + 1) for fold in folds])
        refold_from = min([fold.forget(refold_from) for fold in folds])
        for fold in folds:
            fold.drop_outputs(min(refold_from, tick + 1))
        self.timeline.forget(refold_from)
        for k in range(start, tick + 1):
            self._revisions.pop(k, None)


def _restore_fold(
    fold: Fold[S, O], kept: FoldSnapshot | None, restored: Callable[[FoldSnapshot], S], oldest: int
) -> None:
    if kept is None:
        fold.begin(oldest + 1)
    else:
        fold.resume(kept.tick, restored(kept))


@dataclass(frozen=True, slots=True)
class DeviceProgress:
    """How far a device has come.

    Attributes:
        epoch: of its clock.
        newest_ns: its newest measurement that is believed, on its clock.
        next_tick: the first tick that is not closed, None before there is one.
        watermark: the newest tick that the data has passed; while it is not closed, more is due.
    """

    epoch: int
    newest_ns: int | None
    next_tick: int | None
    watermark: int | None = None

    @property
    def backlog(self) -> int:
        """How many ticks the data has passed that are not closed."""
        return 0 if self.watermark is None or self.next_tick is None else max(0, self.watermark + 1 - self.next_tick)


class Device:
    """One device: the epoch its clock is in, and the beginning of the next."""

    def __init__(
        self,
        device: str,
        pipelines: Sequence[Pipeline],
        call: StageCaller,
        counts: Counter[str],
        *,
        seed: int,
        horizon_ns: int,
        checkpoint_bytes: int,
        known: Fix | None = None,
        number: int = 0,
    ) -> None:
        """Begin with nothing measured, in epoch ``number``."""
        self._device = device
        self._pipelines = pipelines
        self._call = call
        self._counts = counts
        self._streams = RandomStreams(seed, device)
        self._horizon_ns = horizon_ns
        self._checkpoint_bytes = checkpoint_bytes
        self._pending = KernelOutput()
        self._number = number
        self._epoch = self._begin(known)

    def feed(self, event: Event, *, out_of_order: bool = False) -> MessageOutcome:
        """Insert an event into the timeline; nothing is folded yet.

        Args:
            event: of this device.
            out_of_order: something sent after it has taken the clock further.
        """
        inserted = self._epoch.timeline.insert(event, out_of_order=out_of_order)
        restart: list[Measurement] = inserted.restart
        if restart:
            # The clock started anew: what the old one showed is over, and its last ticks are published.
            step_one(self._epoch.finish(self._pending), self._call)
            self._number += 1
            self._epoch = self._begin(None)
            # Once for a message: else one that leaps to and fro could begin a thousand epochs.
            self._counts["dropped"] += len(self._epoch.timeline.insert_measurements(restart))
        return inserted.outcome

    def run(self, tick: int | None = None, max_ticks: int | None = None) -> StepCoroutine[KernelOutput]:
        """Fold what is due: ticks that the data has passed, or up to ``tick`` where the driver closes it.

        At most ``max_ticks`` ticks are closed, where that is told.
        """
        due = max((k for k in (self._epoch.timeline.watermark, tick) if k is not None), default=None)
        next_tick = self._next_tick
        if due is not None and next_tick is not None:
            due = max(due, next_tick - 1)
            due = due if max_ticks is None else min(due, next_tick - 1 + max_ticks)
        output, self._pending = self._pending, KernelOutput()
        yield from self._epoch.run(due, output)
        return output

    def finish(self) -> StepCoroutine[KernelOutput]:
        """Fold and settle everything; nothing more will come."""
        output, self._pending = self._pending, KernelOutput()
        yield from self._epoch.finish(output)
        return output

    def fingerprint_requests(self, scan: Scan) -> list[FingerprintRequest]:
        """Return what the fingerprints will be asked once ``scan`` is fed."""
        return [q for item in split_event(scan, Counter()) for q in self._epoch.fingerprint_requests(item.content)]

    @property
    def progress(self) -> DeviceProgress:
        """How far it has come."""
        timeline = self._epoch.timeline
        return DeviceProgress(self._number, timeline.newest_ns, self._next_tick, timeline.watermark)

    @property
    def reached(self) -> tuple[int, int | None]:
        """How far the clock has come: its epoch, and the newest measurement in it."""
        return self._number, self._epoch.timeline.newest_ns

    @property
    def number(self) -> int:
        """The number of the epoch that the clock is in."""
        return self._number

    def snapshot(self) -> DeviceSnapshot:
        """Return the device as a value; :meth:`run` must have followed the last :meth:`feed`."""
        if self._pending != KernelOutput():
            raise RuntimeError(f"{self._device}: a snapshot was asked for while estimates wait to be said")
        return DeviceSnapshot(self._device, self._number, self._epoch.snapshot())

    def restore(self, kept: DeviceSnapshot) -> StepCoroutine[None]:
        """Become what ``kept`` says."""
        self._number = kept.number
        if kept.number:
            self._epoch = self._begin(None)
        yield from self._epoch.restore(kept.epoch)

    @property
    def _next_tick(self) -> int | None:
        epoch = self._epoch
        return epoch.timeline.first if epoch.published is None else epoch.published + 1

    def _begin(self, known: Fix | None) -> Epoch:
        return Epoch(
            self._device,
            self._number,
            self._pipelines,
            self._streams,
            self._call,
            self._counts,
            horizon_ns=self._horizon_ns,
            checkpoint_bytes=self._checkpoint_bytes,
            known=known,
        )
