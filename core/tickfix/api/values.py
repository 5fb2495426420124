"""What stages hand to each other: immutable values with their units in the names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Final, TypeAlias

import numpy as np

from tickfix.api.arrays import NO_VALUES, Floats, Ints, frozen_columns, frozen_floats, frozen_ints
from tickfix.api.events import Fix, Scan


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """The result of dead reckoning for one tick, (``t0_ns``, ``t1_ns``].

    The displacement is ``distance_m`` along ``heading_rad``; a phone without compass has no heading, only turns.
    Uncertainties are one standard deviation and come in two kinds: *white* ones are independent from tick to tick,
    *bias-like* ones are constant over the walk and can be estimated by a filter.

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
        height_change_m: by how much the device rose within the tick, negative where it sank; None where nothing
            measured it.
        height_change_sigma_m: white.
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
    height_change_m: float | None = None
    height_change_sigma_m: float = 0.0

    @staticmethod
    def unknown(t0_ns: int, t1_ns: int, speed_sigma_mps: float = 1.0) -> Motion:
        """Return the motion of a tick without measurements: the person may have walked anywhere at walking speed."""
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
        rssi_dbm: (n,) float64, dBm; NaN for sources without a signal strength.
        heard_ns: (n,) int64.
        scan: (n,) int64, the number of the scan that brought the reading first; 0 is the oldest of the window.
        scan_t_ns: times of the window's scans, oldest first.
        source: of all of them, see :class:`Scan`.
        values: further columns by name, each (n,) float64; NaN where a reading has none. Empty where no scan has any.
    """

    t_ns: int
    transmitters: tuple[str, ...]
    rssi_dbm: Floats
    heard_ns: Ints
    scan: Ints
    scan_t_ns: tuple[int, ...]
    source: str = "wifi"
    values: Mapping[str, Floats] = field(default_factory=lambda: NO_VALUES)

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
            values=frozen_columns({name: column[order] for name, column in scan.values.items()}, len(order)),
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
        sources: of scans, see :class:`Scan`; a window holds scans of one of them only, that of the newest.
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
        fix: the position found, or None if the scan does not determine one.
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
        fix: the position, known at the start of the track or found by the first observation.
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


_NO_DIAGNOSTICS: Final[Mapping[str, float]] = MappingProxyType({})


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What a filter did with a tick, for the estimate to explain itself.

    Attributes:
        used: number of observations that corrected the belief.
        gated: number that were refused as implausible.
        innovation_m: distance between the last observation and what the filter expected, None without one.
        nis: its normalised squared innovation, None where the filter computes none.
        lost: the filter does not know where it is.
        reasons: short words for what happened, such as ``"recovered"`` or ``"all particles crossed walls"``.
        diagnostics: numbers by name that describe the health of the filter, such as ``ess`` (effective sample size) or
            ``log_likelihood``; names in snake_case, at most 64, values that are not finite are dropped. They are
            carried to the estimate, the wire, the journal and the sinks, and are no part of a track's digest.
    """

    used: int = 0
    gated: int = 0
    innovation_m: float | None = None
    nis: float | None = None
    lost: bool = False
    reasons: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=lambda: _NO_DIAGNOSTICS, hash=False)

    def __post_init__(self) -> None:
        """Keep a read-only copy of the diagnostics."""
        if isinstance(self.diagnostics, dict):
            object.__setattr__(self, "diagnostics", MappingProxyType(dict(self.diagnostics)))


class Status(StrEnum):
    """How much an estimate can be relied on."""

    INITIALISING = "initialising"
    """No position yet."""
    TRACKING = "tracking"
    """An observation corrected the belief within the last ten seconds."""
    COASTING = "coasting"
    """Only motion has carried the belief for longer than that."""
    LOST = "lost"
    """The filter reports that it has lost track."""
    FAILED = "failed"
    """A stage failed in this tick; the belief is the one before it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Estimate:
    """The result of a pipeline at a tick.

    Attributes:
        device, pipeline: who is followed, and by which pipeline.
        epoch: counts the starts of the device's clock.
        tick: k; ``t_ns`` is k·200 ms of device time.
        status: see :class:`EngineStatus`.
        belief: None while initialising.
        motion_age_ns, observation_age_ns: time since the last motion was measured and since an observation was last
            used; None before the first.
        innovation_m, nis: of the newest observation of this tick, see :class:`Report`.
        failed_by: the stage that failed and why, empty when none did.
        reasons: what the filter reported.
        diagnostics: numbers by name that the filter reported, see :class:`Report`; read-only.
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
    nis: float | None = None
    failed_by: str = ""
    reasons: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=lambda: _NO_DIAGNOSTICS)
    revision: int = 0

    def __post_init__(self) -> None:
        """Keep a read-only copy of the diagnostics."""
        if isinstance(self.diagnostics, dict):
            object.__setattr__(self, "diagnostics", MappingProxyType(dict(self.diagnostics)))
