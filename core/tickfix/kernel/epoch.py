"""One epoch of one device under all pipelines: its folds, its published and its settled track."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from tickfix.api.events import TICK_NS, Fix, Scan
from tickfix.api.values import Estimate, Motion, Observation
from tickfix.kernel.fold import Fold, earliest
from tickfix.kernel.moving import MotionFold, Moved
from tickfix.kernel.observing import ObservationFold, Observed, Question, Sighted
from tickfix.kernel.randomness import Streams
from tickfix.kernel.samples import tick_of
from tickfix.kernel.snapshot import EpochSnapshot, FoldSnapshot
from tickfix.kernel.stages import Caller, Pipeline
from tickfix.kernel.timeline import Timeline
from tickfix.kernel.together import Asking
from tickfix.kernel.tracker import Carried, Tracker, external, revised

S = TypeVar("S")
O = TypeVar("O")  # noqa: E741 - output


@dataclass(slots=True)
class Output:
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
        streams: Streams,
        call: Caller,
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
        self._motion: dict[str, Fold[object, Moved]] = {key: Fold(lambda: None, **sizes) for key in self._moving}
        self._observations: dict[str, Fold[Sighted, Observed]] = {
            key: Fold(Sighted, **sizes) for key in self._observing
        }
        self._beliefs: dict[str, Fold[Carried, Estimate]] = {}
        for pipeline in pipelines:
            tracker = Tracker(
                device,
                epoch,
                pipeline,
                streams,
                call,
                known=known,
                first=lambda: self._began,
                moved=lambda tick, p=pipeline: self._moved(p, tick),  # type: ignore[misc]
                observed=lambda tick, p=pipeline: self._observed(p, tick),  # type: ignore[misc]
            )
            self._tracking[pipeline.name] = tracker
            self._beliefs[pipeline.name] = Fold(Carried, **sizes)

    def run(self, tick: int | None, output: Output) -> Asking[None]:
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

    def finish(self, output: Output) -> Asking[None]:
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

    def questions(self, scan: Scan) -> list[Question]:
        """Return what the fingerprints will be asked once ``scan`` is inserted."""
        asked = []
        for key, observing in self._observing.items():
            tick, carried = self._observations[key].before(tick_of(scan.t_ns)) or (-1, Sighted())
            asked.append(observing.question(tick, carried, scan))
        return [question for question in asked if question is not None]

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

    def restore(self, kept: EpochSnapshot) -> Asking[None]:
        """Become what ``kept`` says; a stage that it does not know begins with the oldest tick that is known."""
        self.timeline.restore(kept.timeline)
        self._began, self._published, self._settled = kept.began, kept.published, kept.settled
        self._revisions = dict(kept.revisions)
        if kept.began is None or kept.published is None:
            return
        known = {fold.key: fold for fold in kept.folds}
        oldest = min((fold.tick for fold in kept.folds), default=kept.began - 1)
        for key, moving in self._moving.items():
            _restore(self._motion[key], known.get(key), moving.restored, oldest)
        for key, observing in self._observing.items():
            _restore(self._observations[key], known.get(key), observing.restored, oldest)
        for name, tracker in self._tracking.items():
            _restore(self._beliefs[name], known.get(tracker.key), tracker.restored, oldest)
        yield from self._fold(kept.published)

    def _folds(self) -> list[Fold[object, Moved] | Fold[Sighted, Observed] | Fold[Carried, Estimate]]:
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

    def _fold(self, tick: int) -> Asking[None]:
        for key, moving in self._moving.items():
            self._motion[key].advance(tick, moving.step)
        for key, observing in self._observing.items():
            self._observations[key].advance(tick, observing.step)
        for name, tracker in self._tracking.items():
            beliefs = self._beliefs[name]
            for k, carried in beliefs.ahead(tick):
                after, estimate = yield from tracker.step(carried, k)
                beliefs.keep(k, after, estimate)

    def _moved(self, pipeline: Pipeline, tick: int) -> Moved:
        if pipeline.pdr is None:
            return Moved(Motion.unknown((tick - 1) * TICK_NS, tick * TICK_NS))
        return self._motion[pipeline.pdr.key].outputs[tick]

    def _observed(self, pipeline: Pipeline, tick: int) -> Observed:
        fixes = self.timeline.fixes(tick)
        own = Observed() if pipeline.fingerprint is None else self._observations[pipeline.fingerprint.key].outputs[tick]
        if not fixes:
            return own
        return Observed(own.observations + tuple(external(fix) for fix in fixes), own.failure)

    def _estimates(self, first: int, last: int) -> list[Estimate]:
        return [
            revised(self._beliefs[p.name].outputs[k], self._revisions.get(k, 0))
            for k in range(first, last + 1)
            for p in self._pipelines
        ]

    def _settle(self, tick: int, output: Output) -> None:
        if self._began is None:
            return
        start = self._began if self._settled is None else self._settled + 1
        if tick < start:
            return
        output.settled += self._estimates(start, tick)
        for key, observed in self._observations.items():
            for k in range(start, tick + 1):
                output.observations += [(key, observation) for observation in observed.outputs[k].observations]
        self._settled = tick
        # No fold forgets what another one's oldest checkpoint needs to go on from: a snapshot keeps nothing else.
        folds = self._folds()
        again = min([fold.again(tick + 1) for fold in folds])
        again = min([fold.forget(again) for fold in folds])
        for fold in folds:
            fold.drop_outputs(min(again, tick + 1))
        self.timeline.forget(again)
        for k in range(start, tick + 1):
            self._revisions.pop(k, None)


def _restore(fold: Fold[S, O], kept: FoldSnapshot | None, restored: Callable[[FoldSnapshot], S], oldest: int) -> None:
    if kept is None:
        fold.begin(oldest + 1)
    else:
        fold.resume(kept.tick, restored(kept))
