"""What a run amounts to, walk by walk and pooled, in the shape that ``--json`` prints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tickfix.api import Bools, Estimate, Floats, Truth
from tickfix.evaluation.coverage import Coverage
from tickfix.evaluation.figures import Figures
from tickfix.evaluation.scoring import WalkScore, score_walk
from tickfix.evaluation.track import Track, digest, pooled_digest


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WalkResult:
    """What is kept of a walk when its tracks are gone.

    Attributes:
        score: errors at the waypoints.
        published, settled: digests of the two tracks by pipeline.
    """

    score: WalkScore
    published: Mapping[str, str]
    settled: Mapping[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class PipelineSummary:
    """One pipeline in one walk, or in all of them.

    Attributes:
        figures: of the errors at scored waypoints.
        covered: the same of those that are covered as well.
        covered_share: share of the scored waypoints that are covered, 0 … 1; None when none was scored.
        floor_hit: share of the scored waypoints whose floor was right; None when none was scored.
        availability: share of all waypoints at which this pipeline has an estimate; None without waypoints.
        published, settled: digests; pooled ones are of the walks' digests in their order.
    """

    figures: Figures
    covered: Figures
    covered_share: float | None
    floor_hit: float | None
    availability: float | None
    published: str
    settled: str

    def as_json(self) -> dict[str, Any]:
        """Return the object that stands under the pipeline's name."""
        return self.figures.as_json() | {
            "availability": self.availability,
            "floor_hit": self.floor_hit,
            "published": self.published,
            "settled": self.settled,
            "covered": {"share": self.covered_share} | self.covered.as_json(),
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
class Summary:
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
    )


def summarise(results: Sequence[WalkResult], intake: Mapping[str, int]) -> Summary:
    """Bring the walks of a run together.

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
    return Summary(
        pipelines={name: _summary(name, results, pooled=True) for name in names},
        walks=tuple(
            WalkSummary(
                name=result.score.name,
                floor=result.score.floor,
                waypoints=len(result.score),
                scored=int(result.score.scored.sum()),
                pipelines={name: _summary(name, [result], pooled=False) for name in names},
            )
            for result in results
        ),
        intake=dict(intake),
    )


def _summary(pipeline: str, results: Sequence[WalkResult], *, pooled: bool) -> PipelineSummary:
    walks = [result.score for result in results]
    scores = [walk.pipelines[pipeline] for walk in walks]
    scored = np.concatenate([walk.scored for walk in walks])
    covered = np.concatenate([walk.covered for walk in walks])
    error_m: Floats = np.concatenate([score.error_m for score in scores])
    published = [result.published[pipeline] for result in results]
    settled = [result.settled[pipeline] for result in results]
    return PipelineSummary(
        figures=Figures.of(error_m[scored]),
        covered=Figures.of(error_m[scored & covered]),
        covered_share=_share(covered[scored]),
        floor_hit=_share(np.concatenate([score.floor_right for score in scores])[scored]),
        availability=_share(np.concatenate([score.estimated for score in scores])),
        published=pooled_digest(published) if pooled else published[0],
        settled=pooled_digest(settled) if pooled else settled[0],
    )


def _share(flags: Bools) -> float | None:
    return float(np.mean(flags)) if len(flags) else None
