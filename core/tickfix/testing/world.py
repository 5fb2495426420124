"""A tiny world to test algorithms in: the same every time, small enough to know by heart.

Floor ``F1`` is 20 m × 12 m with an obstacle and a wall that a door leads through; ``F2`` is the same without the wall.
Twelve transmitters on each fall off with distance. A person walks round and round the obstacle at 1.2 m/s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import shapely

from tickfix.api import (
    TICK_NS,
    Bools,
    Context,
    Fix,
    Floats,
    Floor,
    FloorMap,
    Ints,
    Motion,
    MotionSamples,
    Observation,
    RadioMap,
    Readings,
    Rng,
    Samples,
    Scan,
    Survey,
    SurveyWalk,
    Transition,
    Truth,
    displacement,
    frozen,
)

__all__ = [
    "HEIGHT_M",
    "SENSORS",
    "SPEED_MPS",
    "T0_NS",
    "WIDTH_M",
    "OpenMap",
    "ReferenceMap",
    "WalkTick",
    "context",
    "first_fix",
    "floors",
    "make_readings",
    "observation",
    "position_at",
    "radio_map",
    "readings",
    "reference_maps",
    "rng",
    "rssi_at",
    "samples",
    "scan",
    "survey",
    "walk",
]


def rng(*key: int) -> Rng:
    """Return the random stream of a key, as the kernel gives each tick its own."""
    return np.random.default_rng([20_240_601, *key])


WIDTH_M: Final = 20.0
HEIGHT_M: Final = 12.0


@cache
def floors() -> Mapping[str, Floor]:
    """Return the two floors by name."""
    outline = np.array([[0.0, 0.0], [WIDTH_M, 0.0], [WIDTH_M, HEIGHT_M], [0.0, HEIGHT_M]])
    block = np.array([[7.0, 4.0], [13.0, 4.0], [13.0, 8.0], [7.0, 8.0]])
    wall = np.array([[[5.0, 0.0], [5.0, 4.5]], [[5.0, 6.0], [5.0, HEIGHT_M]]])  # the door is between the two
    size = {"width_m": WIDTH_M, "height_m": HEIGHT_M, "outline": (outline,), "obstacles": (block,)}
    return MappingProxyType(
        {"F1": Floor(name="F1", level=0, walls=wall, **size), "F2": Floor(name="F2", level=1, **size)}  # type: ignore[arg-type]
    )


class OpenMap:
    """A map of nothing: one can stand and walk everywhere."""

    def contains(self, xy: Floats) -> Bools:
        """Return True for every point: one can stand anywhere."""
        return np.ones(len(xy), dtype=np.bool_)

    def crosses(self, a: Floats, b: Floats) -> Bools:  # noqa: ARG002
        """Return False for every move: nothing is in the way."""
        return np.zeros(len(a), dtype=np.bool_)

    def nearest_free(self, xy: Floats) -> Floats:
        """Return the places themselves."""
        return xy

    def snap(self, previous: Floats | None, xy: Floats) -> Floats:  # noqa: ARG002
        """Return the place itself."""
        return xy


class ReferenceMap:
    """The geometry of a floor by shapely, one by one and slowly: what faster maps are compared with.

    Attributes:
        area: where one can stand, None where that has no bounds.
        lines: everything that blocks a move.
        transitions: none.
    """

    transitions: tuple[Transition, ...] = ()

    def __init__(self, floor: Floor) -> None:
        """Take the floor as it is drawn."""
        rings = [*floor.outline, *floor.obstacles]
        segments = [*floor.walls, *(edge for ring in rings for edge in _ring_edges(ring))]
        self.lines = shapely.MultiLineString([segment.tolist() for segment in segments])
        self.area: Any = None
        for ring in floor.outline:
            polygon = shapely.make_valid(shapely.Polygon(ring))
            self.area = polygon if self.area is None else self.area.symmetric_difference(polygon)
        if self.area is not None and floor.obstacles:
            obstacles = [shapely.make_valid(shapely.Polygon(ring)) for ring in floor.obstacles]
            self.area = self.area.difference(shapely.union_all(obstacles))

    def contains(self, xy: Floats) -> Bools:
        """Return for each point whether it lies inside."""
        if self.area is None:
            return np.ones(len(xy), dtype=np.bool_)
        return np.array([self.area.contains(shapely.Point(p)) for p in xy], dtype=np.bool_)

    def crosses(self, a: Floats, b: Floats) -> Bools:
        """Return for each move whether it meets a line."""
        return np.array([self._way(p, q).intersects(self.lines) for p, q in zip(a, b, strict=True)], dtype=np.bool_)

    def distance_m(self, a: Floats, b: Floats) -> Floats:
        """Return how near each move comes to a line: (n,) float64, metres; 0 where it meets one."""
        return np.array([self._way(p, q).distance(self.lines) for p, q in zip(a, b, strict=True)])

    def outside_m(self, xy: Floats) -> Floats:
        """Return how far each point is from where one can stand: (n,) float64, metres."""
        if self.area is None:
            return np.zeros(len(xy))
        return np.array([self.area.distance(shapely.Point(p)) for p in xy])

    def nearest_free(self, xy: Floats) -> Floats:
        """Return each point, moved a centimetre inside where it was outside."""
        free = np.array(xy)
        for n in np.flatnonzero(~self.contains(xy)):
            free[n] = shapely.shortest_line(self.area.buffer(-0.01), shapely.Point(xy[n])).coords[0]
        return free

    def snap(self, previous: Floats | None, xy: Floats) -> Floats:
        """Return the nearest free place, or stay where a line is in the way."""
        if previous is not None and self.crosses(previous[None], xy[None])[0]:
            return previous
        nearest: Floats = self.nearest_free(xy[None])[0]
        return nearest

    @staticmethod
    def _way(p: Floats, q: Floats) -> Any:
        return shapely.Point(p) if (p == q).all() else shapely.LineString([p, q])


def reference_maps() -> Mapping[str, FloorMap]:
    """Return exact maps of both floors."""
    return MappingProxyType({name: ReferenceMap(floor) for name, floor in floors().items()})


def _ring_edges(ring: Floats) -> Ints | Floats:
    closed = np.concatenate([ring, ring[:1]])
    return np.stack([closed[:-1], closed[1:]], axis=1)


T0_NS: Final = 8_500_000_000 * TICK_NS
"""When the world's walk begins; a tick."""
SPEED_MPS: Final = 1.2
_TICKS_PER_FIX: Final = 10


@dataclass(frozen=True, slots=True, eq=False)
class WalkTick:
    """What a filter gets at a tick, and where the person truly is."""

    number: int
    motion: Motion
    observations: tuple[Observation, ...]
    xy: Floats


def position_at(t_s: float) -> tuple[Floats, float]:
    """Return where the person is after ``t_s`` seconds, and the heading: round the obstacle, clockwise."""
    corners = np.array([[6.0, 2.0], [6.0, 10.0], [14.0, 10.0], [14.0, 2.0]])
    side = 8.0
    way = (SPEED_MPS * t_s) % (4 * side)
    n = int(way // side) % 4
    heading = 0.5 * math.pi * n
    return corners[n] + displacement(way % side, heading), heading


def walk(
    ticks: int, *, shift: Sequence[float] = (0.0, 0.0), fixes: bool = True, compass: bool = True
) -> Iterator[WalkTick]:
    """Walk for so many ticks: true motion, and every two seconds a fix that errs by about two metres.

    Args:
        ticks: how many.
        shift: added to every fix and every place: the same walk elsewhere.
        fixes: whether there are any.
        compass: whether motion has a heading.
    """
    travelled, before = 0.0, position_at(0.0)[1]
    for k in range(1, ticks + 1):
        xy, heading = position_at(0.2 * k)
        distance = SPEED_MPS * 0.2
        travelled += distance
        t_ns = T0_NS + k * TICK_NS
        motion = Motion(
            t0_ns=t_ns - TICK_NS,
            t1_ns=t_ns,
            distance_m=distance,
            heading_rad=(heading + math.pi) % (2 * math.pi) - math.pi if compass else None,
            turn_rad=(heading - before + math.pi) % (2 * math.pi) - math.pi,
            distance_sigma_m=0.05,
            distance_scale_sigma=0.05,
            heading_bias_sigma_rad=0.1,
            steps=1,
            travelled_m=travelled,
        )
        before = heading
        observations: tuple[Observation, ...] = ()
        if fixes and k % _TICKS_PER_FIX == 0:
            error = rng(3, k).normal(0.0, 1.5, 2)
            observations = (observation(xy + error + np.asarray(shift), t_ns),)
        yield WalkTick(k, motion, observations, xy + np.asarray(shift))


def first_fix(shift: Sequence[float] = (0.0, 0.0)) -> Fix:
    """Return the fix at which the walk begins."""
    return Fix(t_ns=T0_NS, floor="F1", xy=position_at(0.0)[0] + np.asarray(shift), covariance=np.eye(2), source="world")


def observation(xy: Any, t_ns: int, floor: str = "F1", sigma_m: float = 2.0) -> Observation:
    """Return an observation with a fix."""
    covariance = sigma_m**2 * np.eye(2)
    return Observation(t_ns=t_ns, source="world", fix=Fix(t_ns=t_ns, floor=floor, xy=xy, covariance=covariance))


SENSORS: Final = ("accelerometer", "gyroscope", "magnetometer", "rotation_vector")
_RATE_HZ: Final = 50


def samples(
    tick: int, sensors: Sequence[str] = SENSORS, *, walking: bool = True, rate_hz: int = _RATE_HZ, t0_ns: int = T0_NS
) -> MotionSamples:
    """Return the samples of a tick: a phone held flat, pointing where the person walks, nearly two steps a second."""
    end_ns = t0_ns + tick * TICK_NS
    n = max(1, rate_hz * TICK_NS // 1_000_000_000)
    t_ns = frozen(end_ns - TICK_NS + (np.arange(1, n + 1) * TICK_NS) // n, np.int64)
    t_s = (t_ns - t0_ns) * 1e-9
    heading = np.array([position_at(t)[1] for t in t_s.tolist()]) if walking else np.zeros(n)
    zero, one = np.zeros(n), np.ones(n)
    bounce = 2.5 * np.sin(2 * np.pi * 1.9 * t_s) if walking else zero
    values = {
        "accelerometer": np.column_stack([zero, zero, 9.81 + bounce]),
        "gyroscope": np.column_stack([zero, zero, zero]),
        "magnetometer": np.column_stack([-20.0 * np.sin(heading), 20.0 * np.cos(heading), -45.0 * one]),
        "rotation_vector": np.column_stack([zero, zero, -np.sin(heading / 2), np.cos(heading / 2)]),
    }
    return MotionSamples(
        sensors={name: Samples(t_ns, frozen(values[name])) for name in sensors}, t0_ns=end_ns - TICK_NS, t1_ns=end_ns
    )


@cache
def radio_map() -> RadioMap:
    """Return the survey: a grid of points 2 m apart on each floor, three samples of each transmitter at each."""
    names = sorted({name for floor in floors() for name in _transmitters(floor)})
    index = {name: n for n, name in enumerate(names)}
    floor_of, xy, rows = [], [], []
    noise = rng(1)
    for f, floor in enumerate(floors()):
        for x in np.arange(1.0, WIDTH_M, 2.0):
            for y in np.arange(1.0, HEIGHT_M, 2.0):
                floor_of.append(f)
                xy.append((x, y))
                for name, rssi_dbm in rssi_at(floor, np.array([x, y])).items():
                    rows += [(len(xy) - 1, index[name], rssi_dbm + noise.normal(0.0, 1.0)) for _ in range(3)]
    point = np.array([row[0] for row in rows], np.int64)
    return RadioMap(
        floors=tuple(floors()),
        transmitters=tuple(names),
        point_floor=np.array(floor_of, np.int64),
        point_xy=np.array(xy),
        sample_point=point,
        sample_transmitter=np.array([row[1] for row in rows], np.int64),
        sample_rssi_dbm=np.array([row[2] for row in rows]),
        sample_xy=np.array(xy)[point],
        sample_t_ns=T0_NS + np.arange(len(rows), dtype=np.int64),
        sample_chain=point % 7,
    )


def rssi_at(floor: str, xy: Floats) -> Mapping[str, float]:
    """Return what is heard at a place without any noise, dBm by transmitter; nothing below −95 dBm."""
    heard = {}
    for other in floors():
        storeys = abs(floors()[other].level - floors()[floor].level)
        for name, at in _transmitters(other).items():
            distance_m = math.hypot(xy[0] - at[0], xy[1] - at[1], 3.0 * storeys + 1.0)
            rssi_dbm = -40.0 - 30.0 * math.log10(distance_m) - 15.0 * storeys
            if rssi_dbm >= -95.0:
                heard[name] = rssi_dbm
    return heard


def readings(
    floor: str = "F1", xy: Sequence[float] = (3.0, 3.0), *, t_ns: int = T0_NS, noise_db: float = 0.0
) -> Readings:
    """Return the window of one scan at a place."""
    return Readings.of(scan(floor, xy, t_ns=t_ns, noise_db=noise_db))


def scan(floor: str = "F1", xy: Sequence[float] = (3.0, 3.0), *, t_ns: int = T0_NS, noise_db: float = 0.0) -> Scan:
    """Return a scan at a place."""
    heard = rssi_at(floor, np.asarray(xy, dtype=np.float64))
    rssi_dbm = np.array(list(heard.values())) + noise_db * rng(2, t_ns % 2**31).standard_normal(len(heard))
    return Scan(transmitters=tuple(heard), rssi_dbm=rssi_dbm, heard_ns=np.full(len(heard), t_ns, np.int64))


def make_readings(
    t_ns: int, transmitters: Sequence[str], rssi_dbm: Sequence[float], ages_s: Sequence[float]
) -> Readings:
    """Return a window of readings, oldest first."""
    order = np.argsort(-np.asarray(ages_s, np.float64), kind="stable").tolist()
    return Readings(
        t_ns=t_ns,
        transmitters=tuple(transmitters[n] for n in order),
        rssi_dbm=frozen([rssi_dbm[n] for n in order]),
        heard_ns=frozen([t_ns - round(ages_s[n] * 1e9) for n in order], np.int64),
        scan=frozen(np.zeros(len(order)), np.int64),
        scan_t_ns=(t_ns,),
    )


def _transmitters(floor: str) -> Mapping[str, Floats]:
    level = floors()[floor].level
    places = [(x, y) for x in (1.0, 7.0, 13.0, 19.0) for y in (1.0, 6.0, 11.0)]
    return {f"02:00:00:00:{level:02x}:{n:02x}": np.array(xy) for n, xy in enumerate(places)}


def context(
    *, maps: Mapping[str, FloorMap] | None = None, fingerprint: Any = None, floor: Floor | None = None
) -> Context:
    """Return the site; without maps, unless some are given."""
    maps = MappingProxyType({}) if maps is None else maps
    return Context(floors=floors(), floor=floor, radio_map=radio_map(), maps=maps, fingerprint=fingerprint)


@cache
def survey() -> Survey:
    """Return a survey of eight short walks, for algorithms that learn."""
    walks = []
    for n in range(8):
        seconds = 20
        parts = [samples(k + 100 * n) for k in range(1, 5 * seconds + 1)]
        merged = {
            name: Samples(
                np.concatenate([p.sensors[name].t_ns for p in parts]),
                np.concatenate([p.sensors[name].values for p in parts]),
            )
            for name in SENSORS
        }
        begin = 20 * n
        times = [begin + s for s in range(0, seconds + 1, 5)]
        truth = tuple(Truth(t_ns=T0_NS + s * 1_000_000_000, floor="F1", xy=position_at(s)[0]) for s in times)
        scans = tuple(
            scan("F1", position_at(s)[0].tolist(), t_ns=T0_NS + s * 1_000_000_000, noise_db=3.0)
            for s in range(begin + 1, begin + seconds, 2)
        )
        motion = MotionSamples(sensors=merged)
        name = f"walk-{n}"
        walks.append(SurveyWalk(name=name, chain=name, floor="F1", truth=truth, motion=motion, scans=scans))
    return Survey(floors=tuple(floors().values()), radio_map=radio_map(), walks=tuple(walks))
