"""Runs pipelines on the walks of a site.

Replay, score and draw each walk, then summarise all of them in the shape that ``--json`` prints.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tickfix.api import Bools, Estimate, Fix, Floats, Recording, Truth
from tickfix.config import Config, build_pipelines
from tickfix.evaluation.error_metrics import ErrorStatistics
from tickfix.evaluation.scoring import Coverage, WalkScore, score_walk
from tickfix.evaluation.tracks import DiagnosticSums, Track, digest, pooled_digest, sum_diagnostics
from tickfix.kernel import KernelSettings, Pipeline
from tickfix.observers import Observers
from tickfix.replay.driver import ReplayResult, replay_recording, start_at_first_waypoint
from tickfix.replay.process_pool import parallel_map
from tickfix.replay.recording_files import RecordingFile
from tickfix.replay.site_survey import site_context, trainable_choices
from tickfix.site import Site


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WalkResult:
    """The result of a walk without its tracks.

    Attributes:
        score: errors at the waypoints.
        published, settled: digests of the two tracks by pipeline.
        diagnostics: by pipeline and name of a diagnostic, the sum of what the published estimates report, and how many
            do.
    """

    score: WalkScore
    published: Mapping[str, str]
    settled: Mapping[str, str]
    diagnostics: Mapping[str, DiagnosticSums] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class PipelineSummary:
    """One pipeline in one walk, or in all of them.

    Attributes:
        error_statistics: of the errors at scored waypoints.
        covered: the same of those that are covered as well.
        covered_share: share of the scored waypoints that are covered, 0 … 1; None when none was scored.
        floor_probability: share of the scored waypoints whose floor was right; None when none was scored.
        availability: share of all waypoints at which this pipeline has an estimate; None without waypoints.
        published, settled: digests; pooled ones are of the walks' digests in their order.
        diagnostics: mean of each diagnostic over the published estimates that report it.
    """

    error_statistics: ErrorStatistics
    covered: ErrorStatistics
    covered_share: float | None
    floor_probability: float | None
    availability: float | None
    published: str
    settled: str
    diagnostics: Mapping[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Return the object that stands under the pipeline's name."""
        return self.error_statistics.as_json() | {
            "availability": self.availability,
            "floor_probability": self.floor_probability,
            "published": self.published,
            "settled": self.settled,
            "covered": {"share": self.covered_share} | self.covered.as_json(),
            **({"diagnostics": dict(self.diagnostics)} if self.diagnostics else {}),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkSummary:
    """One walk.

    Attributes:
        waypoints: how many it has.
        scored: at how many every pipeline has an estimate.
    """

    name: str
    floor: str
    waypoints: int
    scored: int
    pipelines: Mapping[str, PipelineSummary]

    def as_json(self) -> dict[str, Any]:
        """Return the walk's object."""
        return {
            "name": self.name,
            "floor": self.floor,
            "waypoints": self.waypoints,
            "scored": self.scored,
            "pipelines": {name: pipeline.as_json() for name, pipeline in self.pipelines.items()},
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSummary:
    """A run.

    Attributes:
        pipelines: pooled over all walks, every waypoint counting the same, in the order of the run.
        walks: in their order.
        intake: number of messages by outcome.
    """

    pipelines: Mapping[str, PipelineSummary]
    walks: tuple[WalkSummary, ...]
    intake: Mapping[str, int]

    def as_json(self) -> dict[str, Any]:
        """Return the object that ``tickfix replay --json`` prints; it holds no NaN."""
        return {
            "pipelines": {name: pipeline.as_json() for name, pipeline in self.pipelines.items()},
            "walks": [walk.as_json() for walk in self.walks],
            "intake": dict(self.intake),
        }


def evaluate_walk(
    name: str,
    floor: str,
    truth: Sequence[Truth],
    *,
    published: Mapping[str, Track],
    settled: Mapping[str, Iterable[Estimate]],
    coverage: Coverage,
) -> WalkResult:
    """Score the published tracks of a walk and take the digests of both.

    Args:
        name, floor: of the walk.
        truth: its waypoints.
        published: tracks by pipeline.
        settled: the last revision of every tick, in the order of ticks, by pipeline.
        coverage: where the survey has been.
    """
    return WalkResult(
        score=score_walk(name, floor, truth, published, coverage),
        published={pipeline: digest(track) for pipeline, track in published.items()},
        settled={pipeline: digest(track) for pipeline, track in settled.items()},
        diagnostics={pipeline: sum_diagnostics(track) for pipeline, track in published.items()},
    )


def _mean_diagnostics(walks: Sequence[DiagnosticSums]) -> dict[str, float]:
    means: dict[str, float] = {}
    for name in sorted({name for walk in walks for name in walk}):
        sums = [walk[name] for walk in walks if name in walk]
        means[name] = math.fsum(total for total, _ in sums) / sum(count for _, count in sums)
    return means


def summarise(results: Sequence[WalkResult], intake: Mapping[str, int]) -> RunSummary:
    """Pool the walks of a run.

    Raises:
        ValueError: when walks were run with different pipelines.
    """
    names = list(results[0].score.pipelines) if results else []
    for result in results:
        if set(result.score.pipelines) != set(names):
            found, expected = ", ".join(result.score.pipelines), ", ".join(names)
            raise ValueError(
                f"walk {result.score.name}: found pipelines {found}; expected those of the first: {expected}"
            )
    return RunSummary(
        pipelines={name: _pipeline_summary(name, results, pooled=True) for name in names},
        walks=tuple(
            WalkSummary(
                name=result.score.name,
                floor=result.score.floor,
                waypoints=len(result.score),
                scored=int(result.score.scored.sum()),
                pipelines={name: _pipeline_summary(name, [result], pooled=False) for name in names},
            )
            for result in results
        ),
        intake=dict(intake),
    )


def _pipeline_summary(pipeline: str, results: Sequence[WalkResult], *, pooled: bool) -> PipelineSummary:
    walks = [result.score for result in results]
    scores = [walk.pipelines[pipeline] for walk in walks]
    scored = np.concatenate([walk.scored for walk in walks])
    covered = np.concatenate([walk.covered for walk in walks])
    error_m: Floats = np.concatenate([score.error_m for score in scores])
    published = [result.published[pipeline] for result in results]
    settled = [result.settled[pipeline] for result in results]
    return PipelineSummary(
        error_statistics=ErrorStatistics.of(error_m[scored]),
        covered=ErrorStatistics.of(error_m[scored & covered]),
        covered_share=_share_of_true(covered[scored]),
        floor_probability=_share_of_true(np.concatenate([score.floor_right for score in scores])[scored]),
        availability=_share_of_true(np.concatenate([score.estimated for score in scores])),
        published=pooled_digest(published) if pooled else published[0],
        settled=pooled_digest(settled) if pooled else settled[0],
        diagnostics=_mean_diagnostics([result.diagnostics.get(pipeline, {}) for result in results]),
    )


def _share_of_true(flags: Bools) -> float | None:
    return float(np.mean(flags)) if len(flags) else None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunSetup:
    """What all walks of a run share: the site, the pipelines built for it, and the observers of plugins."""

    site: Site
    pipelines: tuple[Pipeline, ...]
    settings: KernelSettings
    coverage: Coverage
    observers: Observers = field(default_factory=Observers)


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkOptions:
    """Options of a run.

    Attributes:
        start_known: whether the pipelines are given the first waypoint; otherwise they find the start themselves.
        pictures: folder for a picture of each walk, which must exist.
        animated: name of a walk to animate beside its picture.
        estimates: keep the published estimates.
    """

    start_known: bool = False
    pictures: Path | None = None
    animated: str = ""
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


def prepare(site: Site, config: Config, observers: Observers | None = None) -> RunSetup:
    """Build the pipelines of ``config`` for ``site``; ``observers`` will watch the walks.

    Raises:
        PluginError: when an algorithm cannot be built.
    """
    return RunSetup(
        site=site,
        pipelines=build_pipelines(config.pipelines, site_context(site), site.models),
        settings=config.kernel,
        coverage=Coverage((track.floor, track.xy) for track in site.survey_tracks),
        observers=Observers() if observers is None else observers,
    )


def untrained(site: Site, config: Config) -> tuple[str, ...]:
    """Return the labels of chosen algorithms that learn from a survey, but for which this site has no model."""
    return tuple(
        choice.offer.label for choice in trainable_choices(config.pipelines) if choice.model not in site.models
    )


def run_walks(
    setup: RunSetup, walks: Sequence[RecordingFile | Recording], options: WalkOptions, *, processes: int | None = None
) -> Iterator[WalkRun]:
    """Run the walks on all cores and give what is left of each, in their order.

    Raises:
        TickfixError: when a walk cannot be read, or, in a strict run, when a stage fails.
    """
    return parallel_map(partial(run_walk, setup, options), walks, processes=processes)


def run_walk(setup: RunSetup, options: WalkOptions, walk: RecordingFile | Recording) -> WalkRun:
    """Replay one walk, score it, draw it."""
    recording = walk.read() if isinstance(walk, RecordingFile) else walk
    start = start_at_first_waypoint(recording) if options.start_known else None
    replayed = replay_recording(
        recording, setup.pipelines, setup.settings, start=start, observers=setup.observers, site=setup.site.name
    )
    published = {
        name: _track_of(name, recording, timed_estimates) for name, timed_estimates in replayed.published.items()
    }
    settled = {
        name: _track_of(name, recording, [(e, 0) for e in timed_estimates])
        for name, timed_estimates in replayed.settled.items()
    }
    result = evaluate_walk(
        recording.name,
        recording.floor,
        recording.truth,
        published=published,
        settled=settled,
        coverage=setup.coverage,
    )
    if options.pictures is not None:
        _draw_walk_on_floors(setup, replayed, published, options.pictures, animated=recording.name == options.animated)
    return WalkRun(
        result=result,
        intake=replayed.intake,
        failures=replayed.failures,
        estimates=_estimates_in_tick_order(published) if options.estimates else (),
        start_known=start is not None,
    )


def pool_runs(runs: Sequence[WalkRun]) -> tuple[RunSummary, Mapping[str, int]]:
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


def _track_of(pipeline: str, recording: Recording, timed_estimates: Sequence[tuple[Estimate, int]]) -> Track:
    return Track(
        pipeline=pipeline,
        device=recording.name,
        estimates=tuple(estimate for estimate, _ in timed_estimates),
        closed_ns=np.array([closed_ns for _, closed_ns in timed_estimates], dtype=np.int64),
    )


def _estimates_in_tick_order(tracks: Mapping[str, Track]) -> tuple[Estimate, ...]:
    ranks = {name: rank for rank, name in enumerate(tracks)}
    every = [estimate for track in tracks.values() for estimate in track.estimates]
    return tuple(sorted(every, key=lambda e: (e.epoch, e.tick, ranks[e.pipeline])))


def _draw_walk_on_floors(
    setup: RunSetup, replayed: ReplayResult, tracks: Mapping[str, Track], folder: Path, *, animated: bool = False
) -> None:
    """Draw the walk on each floor it visits, with the fixes of the last pipeline that has a fingerprint."""
    from tickfix.evaluation.pictures import animate_walk, draw_walk  # noqa: PLC0415 - matplotlib is slow to import

    recording = replayed.recording
    fingerprint_keys = [p.fingerprint.key for p in setup.pipelines if p.fingerprint is not None]
    fixes: Sequence[Fix] = replayed.fixes[fingerprint_keys[-1]] if fingerprint_keys else ()
    visited = _visited_floors(recording.floor, recording.truth, tracks)
    for floor in setup.site.floors:
        if floor.name in visited:
            suffix = f" {floor.name}" if len(visited) > 1 else ""
            path = folder / f"{recording.name}{suffix}.png"
            title = f"{recording.name}, {floor.name}"
            draw_walk(floor, recording.truth, tracks, fixes, path, title=title)
            if animated:
                animate_walk(floor, recording.truth, tracks, path.with_suffix(".gif"), title=title)


def _visited_floors(floor: str, truth: Sequence[Truth], tracks: Mapping[str, Track]) -> set[str]:
    if floor:
        return {floor}
    visited = {waypoint.floor for waypoint in truth}
    beliefs = (estimate.belief for track in tracks.values() for estimate in track.estimates)
    return visited or {belief.floor for belief in beliefs if belief is not None}
