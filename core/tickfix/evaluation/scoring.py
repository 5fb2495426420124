"""Errors of published tracks at the truth samples of a walk.

At its waypoints and, interpolated, between them, and which of them the survey covers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import shapely

from tickfix.api import Bools, Floats, Ints, Truth, frozen
from tickfix.evaluation.error_metrics import density_level, nees
from tickfix.evaluation.tracks import Track, waypoint_errors
from tickfix.site.waypoints import split_into_legs

COVERED_RADIUS_M: Final = 3.0
"""A waypoint this near to a survey walk, or nearer, is covered."""


class Coverage:
    """Finds the positions within ``radius_m`` of the path of any survey walk on their floor."""

    def __init__(self, polylines: Iterable[tuple[str, Floats]], radius_m: float = COVERED_RADIUS_M) -> None:
        """Index the survey walks.

        Args:
            polylines: for each survey walk its floor and its waypoints (n, 2) in time order, metres, floor frame. One
                that has a single waypoint is a point; one without any covers nothing.
            radius_m: the greatest distance.
        """
        self.radius_m = radius_m
        by_floor: dict[str, list[shapely.Geometry]] = {}
        for floor, xy in polylines:
            if len(xy):
                way = shapely.Point(xy[0]) if len(xy) == 1 else shapely.LineString(xy)
                by_floor.setdefault(floor, []).append(way)
        self._trees = {floor: shapely.STRtree(ways) for floor, ways in by_floor.items()}

    def covers(self, floor: str, xy: Floats) -> Bools:
        """Return for each place (n, 2) on ``floor`` whether it is covered: (n,) bool."""
        covered = np.zeros(len(xy), dtype=np.bool_)
        tree = self._trees.get(floor)
        if tree is not None and len(xy):
            near, _ = tree.query(shapely.points(xy), predicate="dwithin", distance=self.radius_m)
            covered[near] = True
        return covered


INTERPOLATION_STEP_S: Final = 1.0
"""Time between two interpolated points."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TruthSamples:
    """The m places of a walk at which tracks are compared with the truth.

    Attributes:
        t_ns: (m,) int64, non-decreasing.
        floors: m names.
        xy: (m, 2) float64, metres, floor frame.
        travelled_m: (m,) float64, way since the first waypoint, straight from waypoint to waypoint.
    """

    t_ns: Ints
    floors: tuple[str, ...]
    xy: Floats
    travelled_m: Floats

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "t_ns", frozen(self.t_ns, np.int64))
        object.__setattr__(self, "xy", frozen(self.xy))
        object.__setattr__(self, "travelled_m", frozen(self.travelled_m))

    def __len__(self) -> int:
        """Return m."""
        return len(self.t_ns)


def samples_at_waypoints(truth: Sequence[Truth]) -> TruthSamples:
    """Return the waypoints in time order; a change of floor adds no distance travelled."""
    ordered = sorted(truth, key=lambda waypoint: waypoint.t_ns)
    xy = np.array([waypoint.xy for waypoint in ordered]).reshape(-1, 2)
    floors = tuple(waypoint.floor for waypoint in ordered)
    moves = np.hypot(*np.diff(xy, axis=0).T) if len(xy) > 1 else np.zeros(0)
    same = np.array([a == b for a, b in pairwise(floors)], dtype=bool)
    travelled_m = np.concatenate([np.zeros(min(1, len(xy))), np.cumsum(np.where(same, moves, 0.0))])
    t_ns = np.array([waypoint.t_ns for waypoint in ordered], dtype=np.int64)
    return TruthSamples(t_ns=t_ns, floors=floors, xy=xy, travelled_m=travelled_m)


def samples_between_waypoints(truth: Sequence[Truth], every_s: float = INTERPOLATION_STEP_S) -> TruthSamples:
    """Return interpolated truth: a point every ``every_s`` strictly between the first and the last waypoint of a floor.

    Interpolation is linear in time between consecutive waypoints on one floor: it takes the person to have walked
    straight and at one speed from each to the next. Instants of waypoints are left out, since truth is known there.
    """
    ordered = sorted(truth, key=lambda waypoint: waypoint.t_ns)
    known = samples_at_waypoints(ordered)
    times, floors, places = [np.zeros(0, np.int64)], [], [np.zeros((0, 2))]
    step_ns = round(every_s * 1e9)
    for leg in split_into_legs(ordered):
        t_ns = np.arange(leg.t_ns[0] + step_ns, leg.t_ns[-1], step_ns, dtype=np.int64)
        t_ns = t_ns[~np.isin(t_ns, leg.t_ns)]
        times.append(t_ns)
        places.append(leg.at(t_ns))
        floors += [leg.floor] * len(t_ns)
    t_ns = np.concatenate(times)
    # Nanoseconds since 1970 do not fit into a float.
    begin_ns = known.t_ns[:1]
    travelled_m = np.interp(t_ns - begin_ns, known.t_ns - begin_ns, known.travelled_m) if len(t_ns) else np.zeros(0)
    return TruthSamples(t_ns=t_ns, floors=tuple(floors), xy=np.concatenate(places), travelled_m=travelled_m)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PipelineScore:
    """One pipeline at the m waypoints of a walk.

    Attributes:
        error_m: (m,) float64, horizontal distance from waypoint to estimate, metres; NaN where there was no estimate.
            On a wrong floor it is the distance of the coordinates, each in its own floor's frame.
        floor_right: (m,) bool, whether the estimate named the waypoint's floor; False where there was no estimate.
    """

    error_m: Floats
    floor_right: Bools

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "error_m", frozen(self.error_m))
        object.__setattr__(self, "floor_right", frozen(self.floor_right, np.bool_))

    @property
    def estimated(self) -> Bools:
        """(m,) bool: where there was an estimate."""
        return np.isfinite(self.error_m)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WalkScore:
    """All pipelines of a run at the m waypoints of one walk.

    Attributes:
        name, floor: of the walk.
        t_ns: (m,) int64, the waypoints' times, non-decreasing.
        covered: (m,) bool, see :class:`~tickfix.evaluation.scoring.Coverage`.
        scored: (m,) bool, where every pipeline has an estimate: errors of pipelines are compared only there.
        pipelines: by name.
    """

    name: str
    floor: str
    t_ns: Ints
    covered: Bools
    scored: Bools
    pipelines: Mapping[str, PipelineScore]

    def __len__(self) -> int:
        """Return the number of waypoints."""
        return len(self.t_ns)


def score_walk(
    name: str, floor: str, truth: Sequence[Truth], tracks: Mapping[str, Track], coverage: Coverage
) -> WalkScore:
    """Compare published tracks with the truth of one walk.

    Args:
        name, floor: of the walk, carried through.
        truth: its m waypoints, in any order.
        tracks: the published track of every pipeline of the run, by name.
        coverage: where the survey has been.
    """
    waypoints = sorted(truth, key=lambda waypoint: waypoint.t_ns)
    pipelines = {}
    for pipeline, track in tracks.items():
        error_m, floor_right = waypoint_errors(track, waypoints)
        pipelines[pipeline] = PipelineScore(error_m=error_m, floor_right=floor_right)
    scored = np.ones(len(waypoints), dtype=np.bool_)
    for score in pipelines.values():
        scored &= score.estimated
    return WalkScore(
        name=name,
        floor=floor,
        t_ns=frozen([waypoint.t_ns for waypoint in waypoints], np.int64),
        covered=frozen([bool(coverage.covers(w.floor, w.xy[np.newaxis])[0]) for w in waypoints], np.bool_),
        scored=frozen(scored, np.bool_),
        pipelines=pipelines,
    )


NO_ESTIMATE = -1


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SampleErrors:
    """One pipeline at m truth points.

    Attributes:
        error_m: (m,) float64, horizontal distance, each place in its own floor's frame; NaN without an estimate.
        storeys_off: (m,) int64, by how many storeys the floor was wrong, −1 without an estimate.
        nees: (m,) float64, see :func:`~tickfix.evaluation.error_metrics.nees`; NaN without an estimate or on another
            floor than the truth.
        density_level: (m,) float64, see :func:`~tickfix.evaluation.error_metrics.density_level`; NaN without one.
    """

    error_m: Floats
    storeys_off: Ints
    nees: Floats
    density_level: Floats

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "storeys_off", frozen(self.storeys_off, np.int64))
        for name in ("error_m", "nees", "density_level"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def estimated(self) -> Bools:
        """(m,) bool: where there was an estimate."""
        return np.isfinite(self.error_m)

    @property
    def floor_right(self) -> Bools:
        """(m,) bool: where the estimate named the truth's floor."""
        return np.asarray(self.storeys_off == 0)


def errors_at_samples(track: Track, samples: TruthSamples, levels: Mapping[str, int]) -> SampleErrors:
    """Compare what ``track`` published with the truth: at each point the newest estimate that was known by then counts.

    Args:
        track: as published.
        samples: where truth is known.
        levels: number of the storey of each floor. Two floors that differ are at least one storey apart.
    """
    m = len(samples)
    error_m, nees_values, level = np.full(m, np.nan), np.full(m, np.nan), np.full(m, np.nan)
    storeys_off = np.full(m, NO_ESTIMATE, dtype=np.int64)
    for i, (t_ns, floor, xy) in enumerate(zip(samples.t_ns.tolist(), samples.floors, samples.xy, strict=True)):
        belief = track.belief_at(t_ns)
        if belief is None:
            continue
        error_m[i] = np.hypot(*(belief.xy - xy))
        storeys_off[i] = storeys_apart(belief.floor, floor, levels)
        nees_values[i] = nees(belief, floor, xy)
        level[i] = density_level(belief, floor, xy)
    return SampleErrors(error_m=error_m, storeys_off=storeys_off, nees=nees_values, density_level=level)


def storeys_apart(a: str, b: str, levels: Mapping[str, int]) -> int:
    """Return by how many storeys two floors differ: 0 for one floor, at least 1 for two, also where none is known."""
    return 0 if a == b else max(1, abs(levels.get(a, 0) - levels.get(b, 0)))
