"""One epoch of a device's clock under all pipelines: its timeline, its folds, and the published and settled tracks."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from tickfix.api.events import Fix, Scan
from tickfix.api.values import Estimate, Observation
from tickfix.kernel.batch import StepCoroutine
from tickfix.kernel.determinism import RandomStreams
from tickfix.kernel.fold import StageFold, earliest
from tickfix.kernel.snapshot import EpochSnapshot
from tickfix.kernel.stages import KernelSetup
from tickfix.kernel.timeline import ChangedTicks, Timeline
from tickfix.kernel.tracker import (
    FingerprintRequest,
    MotionFold,
    ObservationFold,
    Tracker,
    TrackerFold,
    as_revision,
)


@dataclass(slots=True)
class KernelOutput:
    """What a run of the kernel returns, each list in the order of ticks, and of pipelines within a tick.

    Attributes:
        published: estimates of ticks that closed, revision 0.
        revised: estimates of ticks closed before, after late events.
        smoothed: estimates of ticks closed before, or by this run, whose belief a filter smoothed: their last revision.
        settled: the last revision of ticks that nothing can change any more.
        observations: of the fingerprints in the settled ticks, by the key of their stage.
    """

    published: list[Estimate] = field(default_factory=list)
    revised: list[Estimate] = field(default_factory=list)
    smoothed: list[Estimate] = field(default_factory=list)
    settled: list[Estimate] = field(default_factory=list)
    observations: list[tuple[str, Observation]] = field(default_factory=list)

    @property
    def emitted(self) -> list[Estimate]:
        """All that is to be published, revisions included, such that the revisions of a tick ascend."""
        # A run that ends an epoch smooths ticks that it closed itself.
        return [*self.revised, *self.published, *self.smoothed]


class Epoch:
    """One epoch of one device's clock: a timeline and what the stages make of it.

    Every tick is published once when it closes, revised while late events change it, and settled when none can any
    more. A tick that is *closed* has revision 0 out; one that is *settled* never changes again and is forgotten.

    Where a filter smooths, ticks settle by its lag later: a tick is smoothed with the ticks of the lag after it only
    once these cannot change either, so that the result does not depend on the order in which events arrived.

    Args:
        setup: what all devices share.
        device, number: whose epoch, and which.
        known: the start, where it is known.
    """

    def __init__(self, setup: KernelSetup, device: str, number: int, known: Fix | None) -> None:
        """Build the folds: one per distinct pdr and fingerprint, one per pipeline."""
        self.timeline = Timeline(setup.horizon_ns, setup.measurements)
        self._horizon = setup.horizon_ticks
        self._lag = setup.lag_ticks
        self._began: int | None = None
        self._published: int | None = None
        self._settled: int | None = None
        self._revisions: dict[int, int] = {}
        streams = RandomStreams(setup.seed, device)
        motion = {stage.key: MotionFold(stage, self.timeline, setup) for stage in setup.pdrs}
        observations = {stage.key: ObservationFold(stage, self.timeline, setup) for stage in setup.fingerprints}
        self._observing = tuple(observations.values())
        self._tracking = tuple(
            TrackerFold(
                setup,
                pipeline,
                self.timeline,
                Tracker(setup, pipeline, device, number, streams, known),
                None if pipeline.pdr is None else motion[pipeline.pdr.key],
                None if pipeline.fingerprint is None else observations[pipeline.fingerprint.key],
            )
            for pipeline in setup.pipelines
        )
        # In the order in which they are folded: trackers read the outputs of the others.
        self._folds: tuple[StageFold[Any, Any], ...] = (*motion.values(), *self._observing, *self._tracking)

    def run(self, tick: int | None, output: KernelOutput) -> StepCoroutine[None]:
        """Close the ticks up to ``tick`` (None: none yet), fold what is new or late, and append the results."""
        first = self.timeline.first
        if tick is None or first is None or tick < first:
            return
        # First the past: what late events changed is folded again up to the newest closed tick, and only then are new
        # ticks closed. So a revision never depends on how many ticks this run happens to close.
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
        final = tick - self._horizon - 1
        self._settle(final - self._lag, final, output)

    def finish(self, output: KernelOutput) -> StepCoroutine[None]:
        """Close and settle everything; the epoch is over and must not be used any more."""
        self.timeline.finish()
        newest = self.timeline.newest
        yield from self.run(newest, output)
        if self._published is not None:
            self._settle(self._published, self._published, output)

    @property
    def published(self) -> int | None:
        """The newest tick that was published."""
        return self._published

    def fingerprint_requests(self, scan: Scan) -> list[FingerprintRequest]:
        """Return what the fingerprints will be asked once ``scan`` is inserted."""
        requests = [observing.fingerprint_request(scan) for observing in self._observing]
        return [request for request in requests if request is not None]

    def snapshot(self) -> EpochSnapshot:
        """Return the epoch as a value; :meth:`run` must have followed the last event."""
        # Only the oldest checkpoint of each fold: the ones after it follow from the timeline, and how many there are
        # depends on memory settings, which a snapshot shall not.
        folds = [] if self._began is None else [fold.snapshot() for fold in self._folds]
        return EpochSnapshot(
            timeline=self.timeline.snapshot(),
            began=self._began,
            published=self._published,
            settled=self._settled,
            revisions=tuple(self._revisions.items()),
            folds=tuple(fold for fold in folds if fold is not None),
        )

    def restore(self, kept: EpochSnapshot) -> StepCoroutine[None]:
        """Restore a snapshot; a stage that it does not know begins with the oldest tick that is known."""
        self.timeline.restore(kept.timeline)
        self._began, self._published, self._settled = kept.began, kept.published, kept.settled
        self._revisions = dict(kept.revisions)
        if kept.began is None or kept.published is None:
            return
        known = {fold.key: fold for fold in kept.folds}
        oldest = min((fold.tick for fold in kept.folds), default=kept.began - 1)
        for fold in self._folds:
            fold.restore(known.get(fold.key), oldest)
        yield from self._fold(kept.published)

    def _rewind(self, first: int) -> int | None:
        """Take the timeline's changes into account; return the earliest tick that has to be folded again, if any."""
        changes, self.timeline.changes = self.timeline.changes, ChangedTicks()
        if self._began is None or first < self._began:
            # Before its first tick a fold has no checkpoint to go back to. This happens within the horizon of the first
            # event only, so starting again costs little.
            self._began = first
            for fold in self._folds:
                fold.begin(first)
            return first
        changed = changes.fixes
        for fold in self._folds:
            since = fold.changed_since(changes, changed)
            if since is not None:
                fold.rewind(since)
                changed = earliest(changed, since)
        return changed

    def _fold(self, tick: int) -> StepCoroutine[None]:
        assert self._began is not None  # noqa: S101 - nothing is folded before the first tick is known
        for fold in self._folds:
            yield from fold.fold_to(tick, self._began)

    def _estimates(self, first: int, last: int) -> list[Estimate]:
        return [
            as_revision(tracking.outputs[k].estimate, self._revisions.get(k, 0))
            for k in range(first, last + 1)
            for tracking in self._tracking
        ]

    def _last_estimates(self, first: int, last: int, final: int, output: KernelOutput) -> list[Estimate]:
        """Return the estimates to settle; smoothed ones are revisions, appended to the output too."""
        estimates = self._estimates(first, last)
        trackings = [(k, tracking) for k in range(first, last + 1) for tracking in self._tracking]
        for n, (k, tracking) in enumerate(trackings):
            belief = tracking.smoothed(k, final)
            if belief is not None:
                estimates[n] = replace(estimates[n], belief=belief, revision=estimates[n].revision + 1)
                output.smoothed.append(estimates[n])
        return estimates

    def _settle(self, tick: int, final: int, output: KernelOutput) -> None:
        """Settle the ticks up to ``tick``: append their last estimates and forget what no later tick needs.

        Args:
            tick: the last to settle.
            final: the last that can no longer change, ``tick`` or later; smoothing looks no further ahead.
            output: to append to.
        """
        if self._began is None:
            return
        start = self._began if self._settled is None else self._settled + 1
        if tick < start:
            return
        output.settled += self._last_estimates(start, tick, final, output)
        for observing in self._observing:
            for k in range(start, tick + 1):
                output.observations += [(observing.key, seen) for seen in observing.outputs[k].observations]
        self._settled = tick
        # A change can come to tick + 1 at the earliest. To fold that tick again a fold goes back to its newest
        # checkpoint before it, which lies further back where checkpoints are thinned out, and from there on reads the
        # timeline and the outputs of other folds. So the fold that has to go back furthest decides for all: everyone
        # keeps a checkpoint to start from there, and the timeline its measurements. After a restart exactly that is
        # folded again, since a snapshot keeps the oldest checkpoint of each fold and nothing else.
        refold_from = min([fold.refold_from(tick + 1) for fold in self._folds])
        refold_from = min([fold.forget(refold_from) for fold in self._folds])
        for fold in self._folds:
            fold.drop_outputs(min(refold_from, tick + 1))
        self.timeline.forget(refold_from)
        for k in range(start, tick + 1):
            self._revisions.pop(k, None)
