"""Metrics of whole tracks.

Time to first position, smoothness, wall violations, jumps while stationary, and the processor time of the stages.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, Final

import numpy as np
import shapely

from tickfix.api import TICK_NS, Bools, Floats, Floor, Ints, Recording
from tickfix.evaluation.tracks import Track
from tickfix.kernel import Pipeline, Stage
from tickfix.site.waypoints import merge_motion

_TICK_S: Final = TICK_NS * 1e-9


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrackPositions:
    """The published means of a track.

    Attributes:
        t_ns: (n,) int64, ticks with a position, increasing within an epoch.
        xy: (n, 2) float64, metres.
        floors: n names.
        consecutive: (n − 1,) bool, whether place i + 1 is one tick after place i, on the same floor.
    """

    t_ns: Ints
    xy: Floats
    floors: tuple[str, ...]
    consecutive: Bools


def track_positions(track: Track) -> TrackPositions:
    """Return the positions of a track by tick."""
    kept = [e for e in track.estimates if e.belief is not None]
    beliefs = [e.belief for e in kept if e.belief is not None]
    consecutive = [
        (a.epoch, a.tick + 1) == (b.epoch, b.tick) and one.floor == two.floor
        for a, b, one, two in zip(kept, kept[1:], beliefs, beliefs[1:], strict=False)
    ]
    return TrackPositions(
        t_ns=np.array([e.t_ns for e in kept], dtype=np.int64),
        xy=np.array([b.xy for b in beliefs]).reshape(-1, 2),
        floors=tuple(b.floor for b in beliefs),
        consecutive=np.array(consecutive, dtype=np.bool_),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Smoothness:
    """Sums that pool over walks.

    Attributes:
        squared_mps2: sum of the squared accelerations, (m/s²)².
        accelerations: how many.
        path_m: length of the track, hops between floors not counted.
    """

    squared_mps2: float
    accelerations: int
    path_m: float


def smoothness(track: TrackPositions) -> Smoothness:
    """Return the accelerations a_k = (x_{k+1} − 2 x_k + x_{k−1}) / Δt² of consecutive ticks, squared and summed."""
    if len(track.xy) < 2:
        return Smoothness(squared_mps2=0.0, accelerations=0, path_m=0.0)
    moves = np.diff(track.xy, axis=0)
    triples = track.consecutive[1:] & track.consecutive[:-1]
    accelerations = np.diff(moves, axis=0)[triples] / _TICK_S**2
    return Smoothness(
        squared_mps2=float(np.sum(accelerations**2)),
        accelerations=int(triples.sum()),
        path_m=float(np.hypot(*moves[track.consecutive].T).sum()),
    )


def time_to_first_position_s(track: Track, start_ns: int) -> float | None:
    """Return the seconds from ``start_ns`` until a position was first published, None if there was none.

    Args:
        track: as published.
        start_ns: arrival of the walk's first event.
    """
    for estimate, closed_ns in zip(track.estimates, track.closed_ns.tolist(), strict=True):
        if estimate.belief is not None:
            return float((closed_ns - start_ns) * 1e-9)
    return None


_MIN_MOVE_M: Final = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class WallViolations:
    """Counts that pool over walks; only floors with a plan are counted.

    Attributes:
        moves, crossings: moves from tick to tick, and how many of them went through a wall, or into or out of an
            obstacle or the outline.
        positions, outside: published positions, and how many of them lay off the floor or in an obstacle.
    """

    moves: int
    crossings: int
    positions: int
    outside: int


class FloorGeometry:
    """One floor's geometry, indexed for many queries."""

    def __init__(self, floor: Floor) -> None:
        """Index walls, obstacles and outline."""
        outline = reduce(shapely.symmetric_difference, _polygons(floor.outline), shapely.Polygon())
        obstacles = shapely.union_all(_polygons(floor.obstacles))
        rings = [shapely.LinearRing(ring) for ring in (*floor.outline, *floor.obstacles) if len(ring) > 2]
        edges = [*rings, *(shapely.LineString(wall) for wall in floor.walls)]
        self.has_geometry = bool(edges)
        self._bounded = not outline.is_empty
        self._free = shapely.difference(outline, obstacles) if self._bounded else obstacles
        shapely.prepare(self._free)
        self._edges = shapely.STRtree(edges)

    def outside(self, xy: Floats) -> Bools:
        """Return (n,) bool: whether a position (n, 2), metres, is off the outline or in an obstacle."""
        within = shapely.intersects_xy(self._free, xy[:, 0], xy[:, 1])
        return np.asarray(~within if self._bounded else within, dtype=np.bool_)

    def crosses(self, a: Floats, b: Floats) -> Bools:
        """Return (n,) bool: whether the move from ``a`` (n, 2) to ``b`` (n, 2) crosses a wall or an edge."""
        found = np.zeros(len(a), dtype=np.bool_)
        moved = np.flatnonzero(np.hypot(*(b - a).T) > _MIN_MOVE_M)
        if len(moved):
            moves = shapely.linestrings(np.stack([a[moved], b[moved]], axis=1))
            hit, _ = self._edges.query(moves, predicate="intersects")
            found[moved[hit]] = True
        return found


def floor_geometries(floors: Iterable[Floor]) -> Mapping[str, FloorGeometry]:
    """Return the plans of the floors that have one, by name."""
    every = {floor.name: FloorGeometry(floor) for floor in floors}
    return {name: geometry for name, geometry in every.items() if geometry.has_geometry}


def count_wall_violations(track: TrackPositions, geometries: Mapping[str, FloorGeometry]) -> WallViolations:
    """Count wall crossings and positions outside, by the plans of the floors."""
    moves = crossings = positions = outside = 0
    floors = np.array(track.floors, dtype=np.str_)
    for name, geometry in geometries.items():
        here = floors == name
        positions += int(here.sum())
        outside += int(geometry.outside(track.xy[here]).sum())
        from_ = np.flatnonzero(track.consecutive & here[:-1]) if len(here) > 1 else np.zeros(0, np.int64)
        moves += len(from_)
        crossings += int(geometry.crosses(track.xy[from_], track.xy[from_ + 1]).sum())
    return WallViolations(moves=moves, crossings=crossings, positions=positions, outside=outside)


def _polygons(rings: Iterable[Floats]) -> list[shapely.Geometry]:
    return [shapely.make_valid(shapely.Polygon(ring)) for ring in rings if len(ring) > 2]


STATIONARY_MPS2: Final = 0.5
"""Standard deviation of the acceleration's magnitude over one second below which the person is stationary, m/s²."""
JUMP_M: Final = 1.0
_WINDOW_NS: Final = 1_000_000_000
_WINDOW_TICKS: Final = _WINDOW_NS // TICK_NS
_MIN_SAMPLES: Final = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class StationaryJumps:
    """Counts that pool over walks.

    Attributes:
        stationary_s: time with a published position during which the person had been stationary for a second.
        jumps: how often the track moved more than 1 m within such a second, or changed floor.
    """

    stationary_s: float
    jumps: int


def acceleration_magnitudes(recording: Recording) -> tuple[Ints, Floats]:
    """Return the times (n,) and magnitudes (n,), m/s², of a walk's accelerometer; empty without one."""
    samples = merge_motion(recording).sensors.get("accelerometer")
    if samples is None:
        return np.zeros(0, np.int64), np.zeros(0)
    return samples.t_ns, np.linalg.norm(samples.values[:, :3], axis=1)


def is_stationary(t_ns: Ints, magnitude_mps2: Floats, at_ns: Ints) -> Bools:
    """Return for each instant (m,) whether the person was stationary in the second before it: (m,) bool.

    The detector is the moving variance of the acceleration's magnitude [skog2010], which does not depend on any
    pipeline. An instant with fewer than ten samples in its second counts as moving: nothing is known of it.

    Args:
        t_ns: (n,) times of the samples, increasing.
        magnitude_mps2: (n,).
        at_ns: (m,).
    """
    if len(t_ns) == 0:
        return np.zeros(len(at_ns), dtype=np.bool_)
    centred = magnitude_mps2 - magnitude_mps2.mean()
    sums = np.concatenate([[0.0], np.cumsum(centred)])
    squares = np.concatenate([[0.0], np.cumsum(centred**2)])
    low = np.searchsorted(t_ns, at_ns - _WINDOW_NS, side="right")
    high = np.searchsorted(t_ns, at_ns, side="right")
    n = np.maximum(high - low, 1)
    variance = (squares[high] - squares[low]) / n - ((sums[high] - sums[low]) / n) ** 2
    return np.asarray((high - low >= _MIN_SAMPLES) & (variance < STATIONARY_MPS2**2))


def count_stationary_jumps(track: TrackPositions, stationary: Bools) -> StationaryJumps:
    """Count the jumps of a track.

    A tick jumps when it is ``stationary`` and its place lies more than 1 m from the place one second earlier, or on
    another
    floor; ticks that jump in a row are one jump.

    Args:
        track: its n places.
        stationary: (n,) bool, see :func:`is_stationary`, at the places' times.
    """
    n = len(track.t_ns)
    jumping = np.zeros(n, dtype=np.bool_)
    late = np.arange(_WINDOW_TICKS, n)
    early = late - _WINDOW_TICKS
    whole = track.t_ns[late] - track.t_ns[early] == _WINDOW_NS
    far = np.hypot(*(track.xy[late] - track.xy[early]).T) > JUMP_M
    on_other_floor = np.array([track.floors[i] != track.floors[i - _WINDOW_TICKS] for i in late], dtype=np.bool_)
    jumping[late] = whole & stationary[late] & (far | on_other_floor)
    starts = jumping & ~np.concatenate([[False], jumping[:-1]]) if n else jumping
    return StationaryJumps(stationary_s=float(stationary.sum() * TICK_NS * 1e-9), jumps=int(starts.sum()))


@dataclass(frozen=True, slots=True, kw_only=True)
class StageCost:
    """Sums that pool over walks.

    Attributes:
        pdr_ns, fingerprint_ns, filter_ns: time within the stages, that of a shared one counted in full for each of the
            pipelines it serves: what the pipeline would cost alone. Ticks folded again after a late event count again.
        ticks: of the published track.
        scans: calls of the fingerprint.
    """

    pdr_ns: int = 0
    fingerprint_ns: int = 0
    filter_ns: int = 0
    ticks: int = 0
    scans: int = 0

    @property
    def per_tick_us(self) -> float | None:
        """All stages, per published tick, µs."""
        total = self.pdr_ns + self.fingerprint_ns + self.filter_ns
        return total / self.ticks * 1e-3 if self.ticks else None

    @property
    def per_fix_us(self) -> float | None:
        """The fingerprint, per scan, µs."""
        return self.fingerprint_ns / self.scans * 1e-3 if self.scans else None


class TimedAlgorithm:
    """An algorithm whose calls are timed; other attributes are those of the algorithm."""

    def __init__(self, algorithm: Any, clock_ns: Callable[[], int]) -> None:
        """Begin with no time spent."""
        self._algorithm = algorithm
        self._clock_ns = clock_ns
        self.spent_ns = 0
        self.steps = 0

    def __getattr__(self, name: str) -> Any:
        """Return the attribute of the algorithm."""
        return getattr(self._algorithm, name)

    def start(self, *args: Any) -> Any:
        """Start, timed."""
        return self._timed(self._algorithm.start, args)

    def step(self, *args: Any) -> Any:
        """Step, timed and counted."""
        self.steps += 1
        return self._timed(self._algorithm.step, args)

    def estimate(self, *args: Any) -> Any:
        """Estimate, timed."""
        return self._timed(self._algorithm.estimate, args)

    def _timed(self, call: Callable[..., Any], args: tuple[Any, ...]) -> Any:
        began = self._clock_ns()
        try:
            return call(*args)
        finally:
            self.spent_ns += self._clock_ns() - began


class StageTimer:
    """Pipelines whose stages are timed.

    Args:
        pipelines: any; those handed out compute the same.
        clock_ns: counts nanoseconds, of processor time best.
    """

    def __init__(self, pipelines: Sequence[Pipeline], clock_ns: Callable[[], int]) -> None:
        """Wrap each stage once, so that shared ones stay shared."""
        self._clock_ns = clock_ns
        self._timed_algorithms: dict[str, TimedAlgorithm] = {}
        self.pipelines = tuple(
            replace(p, pdr=self._wrap(p.pdr), fingerprint=self._wrap(p.fingerprint), filter=self._wrapped(p.filter))
            for p in pipelines
        )

    def cost(self, pipeline: Pipeline, ticks: int) -> StageCost:
        """Return the processor time of ``pipeline`` so far, over ``ticks`` published ticks."""
        pdr, fingerprint, filter_ = (
            None if stage is None else self._timed_algorithms[stage.key]
            for stage in (pipeline.pdr, pipeline.fingerprint, pipeline.filter)
        )
        return StageCost(
            pdr_ns=pdr.spent_ns if pdr else 0,
            fingerprint_ns=fingerprint.spent_ns if fingerprint else 0,
            filter_ns=filter_.spent_ns if filter_ else 0,
            ticks=ticks,
            scans=fingerprint.steps if fingerprint else 0,
        )

    def _wrap(self, stage: Stage | None) -> Stage | None:
        return None if stage is None else self._wrapped(stage)

    def _wrapped(self, stage: Stage) -> Stage:
        if stage.key not in self._timed_algorithms:
            self._timed_algorithms[stage.key] = TimedAlgorithm(stage.algorithm, self._clock_ns)
        return replace(stage, algorithm=self._timed_algorithms[stage.key])
