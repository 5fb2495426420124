"""What algorithms are built for: the floors, the radio map and the survey of a site."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, Protocol, TypeAlias, get_args

import numpy as np
from scipy.spatial import cKDTree

from tickfix.api.arrays import Bools, Floats, Ints, frozen_floats, frozen_ints
from tickfix.api.errors import EventError
from tickfix.api.events import MotionSamples, Scan, Truth


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Floor:
    """One level of a building, in metres: x east, y north, the origin at the south-west corner of its drawing.

    Attributes:
        name: unique within the site.
        level: number of the storey, 0 or 1 for the ground as the building counts.
        elevation_m: height of the walking surface over any datum that the floors of a site share; None where it is not
            known.
        width_m, height_m: of the drawing.
        outline: rings (n, 2) that bound the floor; a point inside an odd number of them is on the floor.
        obstacles: rings (n, 2) that one cannot walk through: shops, shafts, voids.
        walls: (m, 2, 2) float64, segments from (x, y) to (x, y) that one cannot walk through.
    """

    name: str
    level: int = 0
    width_m: float = 0.0
    height_m: float = 0.0
    outline: tuple[Floats, ...] = ()
    obstacles: tuple[Floats, ...] = ()
    walls: Floats = field(default_factory=lambda: np.zeros((0, 2, 2)))
    elevation_m: float | None = None

    def __post_init__(self) -> None:
        """Freeze the rings and the walls."""
        object.__setattr__(self, "outline", tuple(frozen_floats("outline", ring, None, 2) for ring in self.outline))
        object.__setattr__(
            self, "obstacles", tuple(frozen_floats("obstacles", ring, None, 2) for ring in self.obstacles)
        )
        object.__setattr__(self, "walls", frozen_floats("walls", self.walls, None, 2, 2))


TransitionKind: TypeAlias = Literal["stairs", "lift", "escalator"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Transition:
    """A way between two floors.

    Attributes:
        kind: how people change floor there.
        floors: names of the two floors it joins.
        areas: on each of the two floors, in its frame: a ring (n ≥ 3, 2) around the place, or one point (1, 2), float64
            metres.
    """

    kind: TransitionKind
    floors: tuple[str, str]
    areas: tuple[Floats, Floats]

    def __post_init__(self) -> None:
        """Freeze the areas.

        Raises:
            EventError: for an unknown kind, a transition from a floor to itself, or an area that is neither a ring nor
                one point, or not finite.
        """
        if self.kind not in get_args(TransitionKind):
            raise EventError(f"kind: found {self.kind!r}, expected one of {', '.join(get_args(TransitionKind))}")
        if len(self.floors) != 2 or self.floors[0] == self.floors[1] or len(self.areas) != 2:
            raise EventError(
                f"floors: found {', '.join(self.floors)} with {len(self.areas)} areas, expected two different floors "
                "and an area on each"
            )
        first, second = (frozen_floats("areas", area, None, 2) for area in self.areas)
        for area in (first, second):
            if len(area) in (0, 2) or not np.isfinite(area).all():
                raise EventError(f"areas: found {len(area)} points, expected one or a finite ring of three or more")
        object.__setattr__(self, "floors", tuple(self.floors))
        object.__setattr__(self, "areas", (first, second))

    def area(self, floor: str) -> Floats | None:
        """Return the ring (n, 2) or point (1, 2) on ``floor``, None where the transition does not touch it."""
        return self.areas[self.floors.index(floor)] if floor in self.floors else None

    def other_floor(self, floor: str) -> str:
        """Return the floor at the other end.

        Raises:
            ValueError: when the transition does not touch ``floor``.
        """
        return self.floors[1 - self.floors.index(floor)]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RadioMap:
    """What the survey heard, every sample kept: reference points × transmitters.

    Samples are the long form of the matrix: sample *s* means that at ``sample_xy[s]``, which belongs to reference point
    ``sample_point[s]``, transmitter ``sample_transmitter[s]`` was received with ``sample_rssi_dbm[s]``.

    Attributes:
        floors: names of the F floors.
        transmitters: ids of the T transmitters, sorted; an id that two sources use stands there once for each.
        transmitter_source: the source of each of the T transmitters, such as ``"wifi"`` or ``"ble"``: the ``source`` of
            the scans that heard it. Empty stands for ``"ble"`` where an id begins with ``ble:`` and ``"wifi"`` for all
            others, as site folders without this field have it.
        point_floor: (P,) int64, index into ``floors``.
        point_xy: (P, 2) float64, metres.
        sample_point, sample_transmitter: (S,) int64, indices into the points and the transmitters.
        sample_rssi_dbm: (S,) float64.
        sample_xy: (S, 2) float64, metres: where the sample was heard, not where its reference point lies.
        sample_t_ns: (S,) int64, when.
        sample_chain: (S,) int64: samples of one chain of walks share a number, chains being numbered in the order of
            their names; a fair test leaves whole chains out.
        reach_m: a sample also describes the other points within this distance of where it was heard; 0 after a survey
            that stood still at its points, a few metres after one that walked past them.
    """

    floors: tuple[str, ...]
    transmitters: tuple[str, ...]
    point_floor: Ints
    point_xy: Floats
    sample_point: Ints
    sample_transmitter: Ints
    sample_rssi_dbm: Floats
    sample_xy: Floats
    sample_t_ns: Ints
    sample_chain: Ints
    reach_m: float = 0.0
    transmitter_source: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Freeze the arrays and check their shapes.

        Raises:
            EventError: naming the field whose shape or type is wrong.
        """
        sources = tuple(self.transmitter_source) or tuple(
            "ble" if transmitter.startswith("ble:") else "wifi" for transmitter in self.transmitters
        )
        if len(sources) != len(self.transmitters):
            expected = f"{len(self.transmitters)}, one for every transmitter"
            raise EventError(f"transmitter_source: found {len(sources)} sources, expected {expected}")
        object.__setattr__(self, "transmitter_source", sources)
        p, s = len(self.point_xy), len(self.sample_point)
        object.__setattr__(self, "point_floor", frozen_ints("point_floor", self.point_floor, p))
        object.__setattr__(self, "point_xy", frozen_floats("point_xy", self.point_xy, p, 2))
        for name in ("sample_point", "sample_transmitter", "sample_t_ns", "sample_chain"):
            object.__setattr__(self, name, frozen_ints(name, getattr(self, name), s))
        object.__setattr__(self, "sample_rssi_dbm", frozen_floats("sample_rssi_dbm", self.sample_rssi_dbm, s))
        object.__setattr__(self, "sample_xy", frozen_floats("sample_xy", self.sample_xy, s, 2))

    def __len__(self) -> int:
        """Return the number of reference points."""
        return len(self.point_xy)

    def of_sources(self, sources: Collection[str]) -> Bools:
        """Return for each transmitter whether it is of one of ``sources``: (T,) bool."""
        return np.array([source in sources for source in self.transmitter_source], np.bool_)

    def transmitter_numbers(self, source: str) -> dict[str, int]:
        """Return the number, an index into ``transmitters``, of each id of one source."""
        known = zip(self.transmitters, self.transmitter_source, strict=True)
        return {transmitter: n for n, (transmitter, of) in enumerate(known) if of == source}

    def described(self) -> tuple[Ints, Ints]:
        """Return the pairs (point, sample) of which sample describes which point, each (N,) int64, sorted by point."""
        if self.reach_m <= 0.0:
            order = np.argsort(self.sample_point, kind="stable")
            return self.sample_point[order], order
        points, samples = [], []
        sample_floor = self.point_floor[self.sample_point]
        for floor in range(len(self.floors)):
            here = np.flatnonzero(self.point_floor == floor)
            heard = np.flatnonzero(sample_floor == floor)
            if len(here) == 0 or len(heard) == 0:
                continue
            places, place = np.unique(self.sample_xy[heard], axis=0, return_inverse=True)
            order = np.argsort(place.ravel(), kind="stable")
            counts = np.bincount(place.ravel(), minlength=len(places))
            starts = np.cumsum(counts) - counts
            near = cKDTree(places).query_ball_point(self.point_xy[here], self.reach_m, return_sorted=True)
            for point, found in zip(here, near, strict=True):
                picked = [order[starts[n] : starts[n] + counts[n]] for n in found]
                mine = heard[np.concatenate(picked)] if picked else np.zeros(0, np.int64)
                points.append(np.full(len(mine), point))
                samples.append(mine)
        if not points:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        described, by = np.concatenate(points), np.concatenate(samples)
        order = np.argsort(described, kind="stable")
        return described[order], by[order]

    def mean_matrix(self, missing_dbm: float = np.nan, use: Bools | None = None) -> Floats:
        """Return (P, T) float64: the mean RSS per point and transmitter, ``missing_dbm`` where it was never heard.

        Args:
            missing_dbm: stands for what was never heard.
            use: (S,) bool, the samples to use; all by default.
        """
        shape = (len(self), len(self.transmitters))
        point, sample = self.described()
        if use is not None:
            point, sample = point[use[sample]], sample[use[sample]]
        flat = point * shape[1] + self.sample_transmitter[sample]
        count = np.bincount(flat, minlength=shape[0] * shape[1])
        total = np.bincount(flat, weights=self.sample_rssi_dbm[sample], minlength=shape[0] * shape[1])
        mean = np.full(shape[0] * shape[1], missing_dbm)
        np.divide(total, count, out=mean, where=count > 0)
        return mean.reshape(shape)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SurveyWalk:
    """One recorded walk with truth, for algorithms that learn.

    Attributes:
        chain: walks of one chain follow each other without a break; folds keep them together.
        truth: waypoints in time order.
        motion: all motion samples.
        scans: in time order.
    """

    name: str
    chain: str
    floor: str
    truth: tuple[Truth, ...]
    motion: MotionSamples
    scans: tuple[Scan, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Survey:
    """Everything a survey brought together, as ``train`` sees it."""

    floors: tuple[Floor, ...]
    radio_map: RadioMap
    walks: tuple[SurveyWalk, ...]


class FloorMap(Protocol):
    """Vectorised geometry of one floor. Points are (n, 2) float64, metres, floor frame.

    Each point, and each move, is judged by itself: filters call it for many devices together, and other rows may
    change no answer.
    """

    @property
    def transitions(self) -> tuple[Transition, ...]:
        """The stairs, lifts and escalators that touch this floor; :class:`~tickfix.api.BaseMap` takes the site's."""
        ...

    def contains(self, xy: Floats) -> Bools:
        """Return for each point whether one can stand there: (n,) bool."""
        ...

    def crosses(self, a: Floats, b: Floats) -> Bools:
        """Tell for each straight move from ``a`` to ``b`` whether it passes through or touches a wall: (n,) bool."""
        ...

    def nearest_free(self, xy: Floats) -> Floats:
        """Return for each point the nearest place where one can stand: (n, 2)."""
        ...

    def snap(self, previous: Floats | None, xy: Floats) -> Floats:
        """Return a place (2,) the map allows for ``xy`` (2,), coming from ``previous`` (2,) where that is known."""
        ...


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Context:
    """What an algorithm is built for: the site, immutable.

    Attributes:
        floors: by name.
        floor: the one to map, for algorithms of kind ``map``, which are built once per floor; None for all others.
        radio_map: None on a site that was never surveyed.
        transitions: stairs, lifts and escalators between the floors; empty where the site names none.
        maps: the pipeline's map of each floor by name; empty when the pipeline has none.
        fingerprint: the pipeline's fingerprint, None without one or while it is itself being built.
    """

    floors: Mapping[str, Floor] = field(default_factory=lambda: MappingProxyType({}))
    floor: Floor | None = None
    radio_map: RadioMap | None = None
    maps: Mapping[str, FloorMap] = field(default_factory=lambda: MappingProxyType({}))
    fingerprint: Any = None
    transitions: tuple[Transition, ...] = ()

    def transitions_on(self, floor: str) -> tuple[Transition, ...]:
        """Return the transitions that touch ``floor``."""
        return tuple(transition for transition in self.transitions if floor in transition.floors)
