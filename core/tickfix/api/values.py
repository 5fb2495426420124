"""What stages hand to each other: immutable values with their units in the names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Any, Protocol, TypeAlias

import numpy as np
from scipy.spatial import cKDTree

from tickfix.api.arrays import Bools, Floats, Ints, frozen_floats, frozen_ints
from tickfix.api.events import Fix, MotionSamples, Scan, Truth


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """What dead reckoning says happened within one tick, (``t0_ns``, ``t1_ns``].

    The way is ``distance_m`` along ``heading_rad``; a phone without compass has no heading and tells only how it
    turned. Uncertainties are one standard deviation and come in two kinds: *white* ones are drawn anew every tick,
    *bias-like* ones stay for the whole walk and can be estimated by a filter.

    Attributes:
        distance_m: length of the way, ≥ 0.
        heading_rad: direction of walking at the end of the tick, clockwise from +y, or None.
        turn_rad: change of heading since the last tick.
        distance_sigma_m: white.
        distance_scale_sigma: bias-like, relative: the person's steps are longer or shorter than thought.
        heading_sigma_rad: white.
        heading_bias_sigma_rad: bias-like: disturbed field, phone held askew, map not quite north.
        turn_sigma_rad: white.
        turn_bias_sigma_rad: growth of the bias per tick: gyroscope drift.
        steps: steps completed within the tick.
        stationary: the phone is at rest.
        travelled_m: distance since the epoch began, this tick included.
    """

    t0_ns: int
    t1_ns: int
    distance_m: float = 0.0
    heading_rad: float | None = None
    turn_rad: float = 0.0
    distance_sigma_m: float = 0.0
    distance_scale_sigma: float = 0.1
    heading_sigma_rad: float = 0.1
    heading_bias_sigma_rad: float = 0.3
    turn_sigma_rad: float = 0.02
    turn_bias_sigma_rad: float = 0.002
    steps: int = 0
    stationary: bool = False
    travelled_m: float = 0.0

    @staticmethod
    def unknown(t0_ns: int, t1_ns: int, speed_sigma_mps: float = 1.0) -> Motion:
        """Nobody measured motion in this tick: the person may have walked anywhere at walking speed."""
        return Motion(
            t0_ns=t0_ns,
            t1_ns=t1_ns,
            distance_sigma_m=speed_sigma_mps * (t1_ns - t0_ns) * 1e-9,
            heading_sigma_rad=np.pi,
            heading_bias_sigma_rad=np.pi,
            turn_sigma_rad=np.pi,
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Readings:
    """The window of readings that a fingerprint asked for, ending with the newest scan.

    Each reading stands here once, though phones repeat old ones in scan after scan. Sorted by scan, then by the time it
    was heard, then by transmitter.

    Attributes:
        t_ns: the newest scan's time.
        transmitters: n transmitter ids.
        rssi_dbm: (n,) float64.
        heard_ns: (n,) int64.
        scan: (n,) int64, the number of the scan that brought the reading first; 0 is the oldest of the window.
        scan_t_ns: times of the window's scans, oldest first.
        source: ``"wifi"`` or ``"ble"``.
    """

    t_ns: int
    transmitters: tuple[str, ...]
    rssi_dbm: Floats
    heard_ns: Ints
    scan: Ints
    scan_t_ns: tuple[int, ...]
    source: str = "wifi"

    @staticmethod
    def of(scan: Scan, seconds: float = np.inf) -> Readings:
        """Return the window that holds just this scan's readings that are no older than ``seconds``."""
        fresh = np.flatnonzero(scan.heard_ns >= scan.t_ns - min(seconds, 1e9) * 1e9)
        order = sorted(fresh.tolist(), key=lambda i: (int(scan.heard_ns[i]), scan.transmitters[i]))
        return Readings(
            t_ns=scan.t_ns,
            transmitters=tuple(scan.transmitters[i] for i in order),
            rssi_dbm=frozen_floats("rssi_dbm", scan.rssi_dbm[order], None),
            heard_ns=frozen_ints("heard_ns", scan.heard_ns[order], None),
            scan=frozen_ints("scan", np.zeros(len(order), np.int64), None),
            scan_t_ns=(scan.t_ns,),
            source=scan.source,
        )

    def __len__(self) -> int:
        """Return the number of readings."""
        return len(self.transmitters)


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """Which readings a fingerprint wants to see: those of the last ``scans`` scans heard within ``seconds``.

    Attributes:
        seconds: greatest age of a reading, counted from the newest scan.
        scans: greatest number of scans.
        sources: kinds of scans.
    """

    seconds: float = 5.0
    scans: int = 64
    sources: tuple[str, ...] = ("wifi",)


LogLikelihood: TypeAlias = Callable[[str, Floats], Floats]
Sampler: TypeAlias = Callable[[int, np.random.Generator], tuple[tuple[str, ...], Floats]]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Observation:
    """A scan as a fingerprint sees it.

    Attributes:
        t_ns: the scan's time.
        source: name of the fingerprint, or of the process that sent the fix.
        fix: the position found, or None where the scan says nothing.
        log_likelihood: ``(floor, xy (n, 2)) → (n,)``: log of how well each place explains the scan, up to a constant;
            None where not offered.
        sample: ``(n, rng) → (floors, xy (n, 2))``: places drawn in proportion to it; None where not offered.
    """

    t_ns: int
    source: str
    fix: Fix | None = None
    log_likelihood: LogLikelihood | None = None
    sample: Sampler | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prior:
    """What is known when a track begins: a place, a first observation, or nothing at all (both None).

    Attributes:
        t_ns: when.
        fix: the place, either told by whoever started the track or found by the first observation.
        observation: the first observation, where one started the track.
    """

    t_ns: int
    fix: Fix | None = None
    observation: Observation | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Component:
    """One Gaussian of a mixture, on one floor."""

    weight: float
    floor: str
    xy: Floats
    covariance: Floats

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "xy", frozen_floats("xy", self.xy, 2))
        object.__setattr__(self, "covariance", frozen_floats("covariance", self.covariance, 2, 2))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Belief:
    """Where a filter believes the device is.

    Attributes:
        floor: the most probable floor; ``xy`` is in its frame.
        xy: (2,) float64, metres, the mean.
        covariance: (2, 2) float64, m², symmetric and positive semi-definite.
        floor_probabilities: pairs (floor, probability) that sum to one; empty means certainty about ``floor``.
        mixture: Gaussians that sum to the belief, where one would hide that it is ambiguous.
        speed_mps, heading_rad: of walking, None where the filter does not know.
    """

    floor: str
    xy: Floats
    covariance: Floats
    floor_probabilities: tuple[tuple[str, float], ...] = ()
    mixture: tuple[Component, ...] = ()
    speed_mps: float | None = None
    heading_rad: float | None = None

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "xy", frozen_floats("xy", self.xy, 2))
        object.__setattr__(self, "covariance", frozen_floats("covariance", self.covariance, 2, 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What a filter did with a tick, for the estimate to explain itself.

    Attributes:
        used: number of observations that corrected the belief.
        gated: number that were refused as implausible.
        innovation_m: distance between the last observation and what the filter expected, None without one.
        gate: its normalised squared innovation, None where the filter computes none.
        lost: the filter does not know where it is.
        reasons: short words for what happened, such as ``"recovered"`` or ``"all particles crossed walls"``.
    """

    used: int = 0
    gated: int = 0
    innovation_m: float | None = None
    gate: float | None = None
    lost: bool = False
    reasons: tuple[str, ...] = ()


class Status(StrEnum):
    """How much an estimate can be relied on."""

    INITIALISING = "initialising"
    """No position yet."""
    TRACKING = "tracking"
    """An observation corrected the belief within the last ten seconds."""
    COASTING = "coasting"
    """Only motion has carried the belief for longer than that."""
    LOST = "lost"
    """The filter says that it does not know."""
    FAILED = "failed"
    """A stage failed in this tick; the belief is the one before it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Estimate:
    """What a tracker says at a tick.

    Attributes:
        device, pipeline: who is followed, and by which pipeline.
        epoch: counts the starts of the device's clock.
        tick: k; ``t_ns`` is k·200 ms of device time.
        status: see :class:`Status`.
        belief: None while initialising.
        motion_age_ns, observation_age_ns: time since the last motion was measured and since an observation was last
            used; None before the first.
        innovation_m, gate: of the newest observation of this tick, see :class:`Report`.
        failed_by: the stage that failed and why, empty when none did.
        reasons: what the filter reported.
        revision: 0 as published when the tick closed; each revision counts one up.
    """

    device: str
    pipeline: str
    epoch: int
    tick: int
    t_ns: int
    status: Status
    belief: Belief | None = None
    motion_age_ns: int | None = None
    observation_age_ns: int | None = None
    innovation_m: float | None = None
    gate: float | None = None
    failed_by: str = ""
    reasons: tuple[str, ...] = ()
    revision: int = 0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Floor:
    """One level of a building, in metres: x east, y north, the origin at the south-west corner of its drawing.

    Attributes:
        name: unique within the site.
        level: number of the storey, 0 or 1 for the ground as the building counts.
        width_m, height_m: of the drawing.
        outline: rings (n, 2) that bound the floor; a point inside an odd number of them is on the floor.
        obstacles: rings (n, 2) nobody walks through: shops, shafts, voids.
        walls: (m, 2, 2) float64, segments from (x, y) to (x, y) nobody walks through.
    """

    name: str
    level: int = 0
    width_m: float = 0.0
    height_m: float = 0.0
    outline: tuple[Floats, ...] = ()
    obstacles: tuple[Floats, ...] = ()
    walls: Floats = field(default_factory=lambda: np.zeros((0, 2, 2)))

    def __post_init__(self) -> None:
        """Freeze the rings and the walls."""
        object.__setattr__(self, "outline", tuple(frozen_floats("outline", ring, None, 2) for ring in self.outline))
        object.__setattr__(
            self, "obstacles", tuple(frozen_floats("obstacles", ring, None, 2) for ring in self.obstacles)
        )
        object.__setattr__(self, "walls", frozen_floats("walls", self.walls, None, 2, 2))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RadioMap:
    """What the survey heard, every sample kept: reference points × transmitters.

    Samples are the long form of the matrix: sample *s* says that at ``sample_xy[s]``, which belongs to reference point
    ``sample_point[s]``, transmitter ``sample_transmitter[s]`` was received with ``sample_rssi_dbm[s]``.

    Attributes:
        floors: names of the F floors.
        transmitters: ids of the T transmitters, sorted.
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

    def __post_init__(self) -> None:
        """Freeze the arrays and check their shapes."""
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
    """Vectorised geometry of one floor. Points are (n, 2) float64, metres, floor frame."""

    def contains(self, xy: Floats) -> Bools:
        """Tell for each point whether one can stand there: (n,) bool."""
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
        maps: the pipeline's map of each floor by name; empty when the pipeline has none.
        fingerprint: the pipeline's fingerprint, None without one or while it is itself being built.
    """

    floors: Mapping[str, Floor] = field(default_factory=lambda: MappingProxyType({}))
    floor: Floor | None = None
    radio_map: RadioMap | None = None
    maps: Mapping[str, FloorMap] = field(default_factory=lambda: MappingProxyType({}))
    fingerprint: Any = None
