"""A run: pipelines on a site, walk after walk, until there is a summary to print."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from tickfix.api import Estimate, Fix, Floats, Recording, Truth
from tickfix.config import Config, build
from tickfix.drivers.recordings import Source
from tickfix.drivers.replay import Replayed, known_start, replay
from tickfix.drivers.surveying import context_of, trainable
from tickfix.drivers.workers import spread
from tickfix.evaluation.coverage import Coverage
from tickfix.evaluation.summary import Summary, WalkResult, evaluate_walk, summarise
from tickfix.evaluation.track import Track
from tickfix.kernel import KernelSettings, Pipeline
from tickfix.site.site import Site


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Bench:
    """What all walks of a run share: the site, and the pipelines built for it."""

    site: Site
    pipelines: tuple[Pipeline, ...]
    settings: KernelSettings
    coverage: Coverage


@dataclass(frozen=True, slots=True, kw_only=True)
class Wishes:
    """What to do with each walk besides scoring it.

    Attributes:
        start_known: tell the pipelines the first waypoint; they find the start themselves otherwise.
        pictures: folder for a picture of each walk, which must exist.
        moving: name of a walk to animate beside its picture.
        estimates: keep the published estimates.
    """

    start_known: bool = False
    pictures: Path | None = None
    moving: str = ""
    estimates: bool = False


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WalkRun:
    """What is left of a walk.

    Attributes:
        result: errors and digests.
        intake: messages by outcome.
        failures: stage calls that failed, by stage and kind of error.
        estimates: published, in the order of ticks, and of pipelines within a tick; empty unless wished for.
        start_known: whether the start could be told.
    """

    result: WalkResult
    intake: Mapping[str, int]
    failures: Mapping[str, int]
    estimates: tuple[Estimate, ...]
    start_known: bool


def prepare(site: Site, config: Config) -> Bench:
    """Build the pipelines of ``config`` for ``site``.

    Raises:
        PluginError: when an algorithm cannot be built.
    """
    return Bench(
        site=site,
        pipelines=build(config.pipelines, context_of(site), site.models),
        settings=config.kernel,
        coverage=Coverage((track.floor, track.xy) for track in site.survey_tracks),
    )


def untrained(site: Site, config: Config) -> tuple[str, ...]:
    """Return the labels of chosen algorithms that learn from a survey, but for which this site has no model."""
    return tuple(choice.offer.label for choice in trainable(config.pipelines) if choice.model not in site.models)


def run_walks(
    bench: Bench, walks: Sequence[Source | Recording], wishes: Wishes, *, processes: int | None = None
) -> Iterator[WalkRun]:
    """Run the walks on all cores and give what is left of each, in their order.

    Raises:
        TickfixError: when a walk cannot be read, or, in a strict run, when a stage fails.
    """
    return spread(partial(run_walk, bench, wishes), walks, processes=processes)


def run_walk(bench: Bench, wishes: Wishes, walk: Source | Recording) -> WalkRun:
    """Replay one walk, score it, draw it."""
    recording = walk.read() if isinstance(walk, Source) else walk
    start = known_start(recording) if wishes.start_known else None
    replayed = replay(recording, bench.pipelines, bench.settings, start=start)
    published = {name: _track(name, recording, said) for name, said in replayed.published.items()}
    settled = {name: _track(name, recording, [(e, 0) for e in said]) for name, said in replayed.settled.items()}
    result = evaluate_walk(
        recording.name,
        recording.floor,
        recording.truth,
        published=published,
        settled=settled,
        coverage=bench.coverage,
    )
    if wishes.pictures is not None:
        _draw(bench, replayed, published, wishes.pictures, moving=recording.name == wishes.moving)
    return WalkRun(
        result=result,
        intake=replayed.intake,
        failures=replayed.failures,
        estimates=_in_order(published) if wishes.estimates else (),
        start_known=start is not None,
    )


def pool(runs: Sequence[WalkRun]) -> tuple[Summary, Mapping[str, int]]:
    """Bring the walks of a run together: the summary, and how often which stage failed."""
    intake: Counter[str] = Counter()
    failures: Counter[str] = Counter()
    for run in runs:
        intake.update(run.intake)
        failures.update(run.failures)
    return summarise([run.result for run in runs], dict(sorted(intake.items()))), dict(sorted(failures.items()))


def draw_errors(runs: Sequence[WalkRun], path: Path) -> None:
    """Draw the distribution of the errors at scored waypoints of all walks."""
    from tickfix.evaluation.pictures import draw_cdf  # noqa: PLC0415 - matplotlib is slow to import

    scores = [run.result.score for run in runs]
    names = list(scores[0].pipelines) if scores else []
    errors: dict[str, Floats] = {
        name: np.concatenate([score.pipelines[name].error_m[score.scored] for score in scores]) for name in names
    }
    draw_cdf(errors, path, title=f"Errors at the waypoints of {len(scores)} walks")


def _track(pipeline: str, recording: Recording, said: Sequence[tuple[Estimate, int]]) -> Track:
    return Track(
        pipeline=pipeline,
        device=recording.name,
        estimates=tuple(estimate for estimate, _ in said),
        closed_ns=np.array([closed_ns for _, closed_ns in said], dtype=np.int64),
    )


def _in_order(tracks: Mapping[str, Track]) -> tuple[Estimate, ...]:
    ranks = {name: rank for rank, name in enumerate(tracks)}
    every = [estimate for track in tracks.values() for estimate in track.estimates]
    return tuple(sorted(every, key=lambda e: (e.epoch, e.tick, ranks[e.pipeline])))


def _draw(bench: Bench, replayed: Replayed, tracks: Mapping[str, Track], folder: Path, *, moving: bool = False) -> None:
    """Draw the walk on each floor it visits, with the fixes of the last pipeline that has a fingerprint."""
    from tickfix.evaluation.animation import animate_walk  # noqa: PLC0415 - matplotlib is slow to import
    from tickfix.evaluation.pictures import draw_walk  # noqa: PLC0415 - as above

    recording = replayed.recording
    seen = [p.fingerprint.key for p in bench.pipelines if p.fingerprint is not None]
    fixes: Sequence[Fix] = replayed.fixes[seen[-1]] if seen else ()
    visited = _floors(recording.floor, recording.truth, tracks)
    for floor in bench.site.floors:
        if floor.name in visited:
            suffix = f" {floor.name}" if len(visited) > 1 else ""
            path = folder / f"{recording.name}{suffix}.png"
            title = f"{recording.name}, {floor.name}"
            draw_walk(floor, recording.truth, tracks, fixes, path, title=title)
            if moving:
                animate_walk(floor, recording.truth, tracks, path.with_suffix(".gif"), title=title)


def _floors(floor: str, truth: Sequence[Truth], tracks: Mapping[str, Track]) -> set[str]:
    if floor:
        return {floor}
    visited = {waypoint.floor for waypoint in truth}
    beliefs = (estimate.belief for track in tracks.values() for estimate in track.estimates)
    return visited or {belief.floor for belief in beliefs if belief is not None}
