"""What is kept of one pipeline on one walk: enough for every figure and picture, and far less than its track."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tickfix.api import Bools, Estimate, Recording, Truth, frozen
from tickfix.drivers.replay import Replayed
from tickfix.evaluation.comparison.diagnosis import Diagnosis, diagnoses
from tickfix.evaluation.coverage import Coverage
from tickfix.evaluation.metrics.availability import time_to_first_position_s
from tickfix.evaluation.metrics.cost import Cost
from tickfix.evaluation.metrics.points import TruthPoints, between_waypoints, waypoints
from tickfix.evaluation.metrics.pointwise import Pointwise, pointwise
from tickfix.evaluation.metrics.smoothness import Places, Smoothness, places, smoothness
from tickfix.evaluation.metrics.standing import Standing, accelerations, is_standing, standing
from tickfix.evaluation.metrics.walls import Plan, Violations, violations
from tickfix.evaluation.track import Track, digest

_EVERY_TICKS: Final = 5

Counts = tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sketch:
    """A track thinned to a place a second, for pictures.

    Attributes:
        t_s: (n,) float32, seconds since the first event arrived.
        xy: (n, 2) float32, metres.
        floor: (n,) int64, index into ``floors``.
        floors: names.
    """

    t_s: NDArray[np.float32]
    xy: NDArray[np.float32]
    floor: NDArray[np.int64]
    floors: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Outcome:
    """One pipeline on one walk with one seed.

    Attributes:
        walk, floor: name of the recording, and its floor, empty for a walk over several.
        start_ns: arrival of the first event; seconds count from here.
        points, between: truth at the waypoints, and interpolated.
        covered, covered_between: (m,) bool, which of them lie near a survey walk.
        at_points, at_between: what the pipeline said there.
        diagnoses: what it said of itself at the waypoints.
        sketch: where it went.
        published, settled: digests of both tracks.
        first_position_s: until a position was published, None if none ever was.
        smoothness, violations, standing, cost: see :mod:`tickfix.evaluation.metrics`.
        statuses, reasons, failures, intake: ticks by status, reports by reason, failed stage calls by stage and error,
            messages by what became of them.
    """

    walk: str
    floor: str
    start_ns: int
    points: TruthPoints
    between: TruthPoints
    covered: Bools
    covered_between: Bools
    at_points: Pointwise
    at_between: Pointwise
    diagnoses: tuple[Diagnosis, ...]
    sketch: Sketch
    published: str
    settled: str
    first_position_s: float | None
    smoothness: Smoothness
    violations: Violations
    standing: Standing
    cost: Cost
    statuses: Counts
    reasons: Counts
    failures: Counts
    intake: Counts

    @property
    def truth(self) -> tuple[Truth, ...]:
        """The waypoints."""
        rows = zip(self.points.t_ns.tolist(), self.points.floors, self.points.xy, strict=True)
        return tuple(Truth(t_ns=t_ns, floor=floor, xy=xy) for t_ns, floor, xy in rows)


def outcomes(
    replayed: Replayed,
    costs: Mapping[str, Cost],
    coverage: Coverage,
    plans: Mapping[str, Plan],
    levels: Mapping[str, int],
) -> Mapping[str, Outcome]:
    """Return what is kept of every pipeline of a replayed walk.

    Args:
        replayed: the walk.
        costs: by pipeline.
        coverage: where the survey has been.
        plans: by floor.
        levels: storeys by floor.
    """
    recording = replayed.recording
    truth = recording.truth
    points, between = waypoints(truth), between_waypoints(truth)
    covered, covered_between = _covered(points, coverage), _covered(between, coverage)
    start_ns = min((event.arrival_ns for event in recording.events), default=0)
    samples = accelerations(recording)
    kept = {}
    for name, said in replayed.published.items():
        track = Track.of(name, recording.name, said)
        went = places(track)
        kept[name] = Outcome(
            walk=recording.name,
            floor=recording.floor,
            start_ns=start_ns,
            points=points,
            between=between,
            covered=covered,
            covered_between=covered_between,
            at_points=pointwise(track, points, levels),
            at_between=pointwise(track, between, levels),
            diagnoses=diagnoses(track, points.t_ns),
            sketch=_sketch(went, _first_tick_ns(recording)),
            published=digest(track),
            settled=digest(replayed.settled[name]),
            first_position_s=time_to_first_position_s(track, start_ns),
            smoothness=smoothness(went),
            violations=violations(went, plans),
            standing=standing(went, is_standing(*samples, went.t_ns)),
            cost=costs[name],
            statuses=_counts(str(e.status) for e in track),
            reasons=_counts(reason for e in track for reason in e.reasons),
            failures=_failures(track.estimates),
            intake=tuple(sorted(replayed.intake.items())),
        )
    return kept


def _covered(points: TruthPoints, coverage: Coverage) -> Bools:
    covered = [bool(coverage.covers(f, xy[np.newaxis])[0]) for f, xy in zip(points.floors, points.xy, strict=True)]
    return frozen(covered, np.bool_)


def _first_tick_ns(recording: Recording) -> int:
    return min((event.t_ns for event in recording.events), default=0)


def _sketch(went: Places, start_ns: int) -> Sketch:
    names = tuple(sorted(set(went.floors)))
    numbers = {name: i for i, name in enumerate(names)}
    floor = np.array([numbers[name] for name in went.floors], dtype=np.int64)
    return Sketch(
        t_s=frozen((went.t_ns[::_EVERY_TICKS] - start_ns) * 1e-9, np.float32),
        xy=frozen(went.xy[::_EVERY_TICKS], np.float32),
        floor=frozen(floor[::_EVERY_TICKS], np.int64),
        floors=names,
    )


def _failures(estimates: Iterable[Estimate]) -> Counts:
    return _counts(e.failed_by for e in estimates if e.failed_by)


def _counts(words: Iterable[str]) -> Counts:
    return tuple(sorted(Counter(words).items()))
