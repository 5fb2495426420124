"""What is stored of one pipeline on one walk.

Errors, metrics, a thinned track and a diagnosis at each waypoint; and the store on disk, from which an interrupted
comparison resumes.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tickfix.api import TICK_NS, Bools, Estimate, Ints, Recording, Truth, frozen
from tickfix.api.packing import pack, unpack
from tickfix.evaluation.scoring import (
    Coverage,
    SampleErrors,
    TruthSamples,
    errors_at_samples,
    samples_at_waypoints,
    samples_between_waypoints,
)
from tickfix.evaluation.track_metrics import (
    FloorGeometry,
    Smoothness,
    StageCost,
    StationaryJumps,
    TrackPositions,
    WallViolations,
    acceleration_magnitudes,
    count_stationary_jumps,
    count_wall_violations,
    is_stationary,
    smoothness,
    time_to_first_position_s,
    track_positions,
)
from tickfix.evaluation.tracks import Track, digest, sum_diagnostics
from tickfix.replay.driver import ReplayResult

RECENT_S: Final = 10.0
_RECENT_TICKS: Final = round(RECENT_S * 1e9 / TICK_NS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """The estimate that was known at an instant, without its belief.

    Attributes:
        status: of the estimate; empty before the first tick closed.
        observation_age_s, motion_age_s: since an observation was last used and motion last measured, None before any.
        innovation_m, nis: the newest of the last ten seconds, None without one.
        reasons: what the filter reported in the last ten seconds, with how often.
        failed_by: the stage that failed, if one did.
    """

    status: str = ""
    observation_age_s: float | None = None
    motion_age_s: float | None = None
    innovation_m: float | None = None
    nis: float | None = None
    reasons: tuple[tuple[str, int], ...] = ()
    failed_by: str = ""

    def __str__(self) -> str:
        """Return the diagnosis as text."""
        words = [self.status or "no estimate yet"]
        if self.observation_age_s is not None:
            words.append(f"last observation used {self.observation_age_s:.1f} s ago")
        elif self.status:
            words.append("no observation used yet")
        if self.motion_age_s is not None and self.motion_age_s > 1.0:
            words.append(f"no motion for {self.motion_age_s:.1f} s")
        if self.innovation_m is not None:
            words.append(f"innovation {self.innovation_m:.1f} m")
        if self.nis is not None:
            words.append(f"NIS {self.nis:.1f}")
        words += [f"{reason} ({count} ×)" for reason, count in self.reasons]
        if self.failed_by:
            words.append(f"failed: {self.failed_by}")
        return ", ".join(words)


def diagnose(track: Track, t_ns: Ints) -> tuple[Diagnosis, ...]:
    """Return the diagnosis of the estimate known at each of the instants (m,), arrival times in ns."""
    last = np.searchsorted(track.closed_ns, t_ns, side="right") - 1
    return tuple(_diagnosis(track, int(i)) for i in last)


def _diagnosis(track: Track, i: int) -> Diagnosis:
    if i < 0:
        return Diagnosis()
    now = track.estimates[i]
    recent = [e for e in track.estimates[max(0, i - _RECENT_TICKS) : i + 1] if e.epoch == now.epoch]
    innovations = [e.innovation_m for e in recent if e.innovation_m is not None]
    nis_values = [e.nis for e in recent if e.nis is not None]
    reasons = Counter(reason for e in recent for reason in e.reasons)
    return Diagnosis(
        status=str(now.status),
        observation_age_s=_age_s(now.observation_age_ns),
        motion_age_s=_age_s(now.motion_age_ns),
        innovation_m=float(innovations[-1]) if innovations else None,
        nis=float(nis_values[-1]) if nis_values else None,
        reasons=tuple(sorted(reasons.items())),
        failed_by=now.failed_by,
    )


def _age_s(age_ns: int | None) -> float | None:
    return None if age_ns is None else age_ns * 1e-9


_THINNING_TICKS: Final = 5

LabelCounts = tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ThinnedTrack:
    """A track thinned to one position per second, for pictures.

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
class TrialOutcome:
    """One pipeline on one walk with one seed.

    Attributes:
        walk, floor: name of the recording, and its floor, empty for a walk over several.
        start_ns: arrival of the first event; seconds count from here.
        samples, interpolated: truth at the waypoints, and interpolated.
        covered, covered_interpolated: (m,) bool, which of them lie near a survey walk.
        at_samples, at_interpolated: what the pipeline said there.
        diagnoses: what it said of itself at the waypoints.
        thinned_track: where it went.
        published, settled: digests of both tracks.
        first_position_s: until a position was published, None if none ever was.
        smoothness, violations, stationary, cost: see :mod:`tickfix.evaluation.error_metrics`.
        statuses, reasons, failures, intake: ticks by status, reports by reason, failed stage calls by stage and error,
            messages by what became of them.
        diagnostics: name of each diagnostic, sum over the published estimates that report it, and how many do.
    """

    walk: str
    floor: str
    start_ns: int
    samples: TruthSamples
    interpolated: TruthSamples
    covered: Bools
    covered_interpolated: Bools
    at_samples: SampleErrors
    at_interpolated: SampleErrors
    diagnoses: tuple[Diagnosis, ...]
    thinned_track: ThinnedTrack
    published: str
    settled: str
    first_position_s: float | None
    smoothness: Smoothness
    violations: WallViolations
    stationary: StationaryJumps
    cost: StageCost
    statuses: LabelCounts
    reasons: LabelCounts
    failures: LabelCounts
    intake: LabelCounts
    diagnostics: tuple[tuple[str, float, int], ...] = ()

    @property
    def truth(self) -> tuple[Truth, ...]:
        """The waypoints."""
        rows = zip(self.samples.t_ns.tolist(), self.samples.floors, self.samples.xy, strict=True)
        return tuple(Truth(t_ns=t_ns, floor=floor, xy=xy) for t_ns, floor, xy in rows)


def trial_outcomes(
    replayed: ReplayResult,
    costs: Mapping[str, StageCost],
    coverage: Coverage,
    geometries: Mapping[str, FloorGeometry],
    levels: Mapping[str, int],
) -> Mapping[str, TrialOutcome]:
    """Return the outcome of every pipeline on a replayed walk.

    Args:
        replayed: the walk.
        costs: by pipeline.
        coverage: where the survey has been.
        geometries: by floor.
        levels: storeys by floor.
    """
    recording = replayed.recording
    truth = recording.truth
    samples, interpolated = samples_at_waypoints(truth), samples_between_waypoints(truth)
    covered, covered_interpolated = _covered(samples, coverage), _covered(interpolated, coverage)
    start_ns = min((event.arrival_ns for event in recording.events), default=0)
    acceleration = acceleration_magnitudes(recording)
    kept = {}
    for name, timed_estimates in replayed.published.items():
        track = Track.of(name, recording.name, timed_estimates)
        positions = track_positions(track)
        kept[name] = TrialOutcome(
            walk=recording.name,
            floor=recording.floor,
            start_ns=start_ns,
            samples=samples,
            interpolated=interpolated,
            covered=covered,
            covered_interpolated=covered_interpolated,
            at_samples=errors_at_samples(track, samples, levels),
            at_interpolated=errors_at_samples(track, interpolated, levels),
            diagnoses=diagnose(track, samples.t_ns),
            thinned_track=_thin(positions, _first_tick_ns(recording)),
            published=digest(track),
            settled=digest(replayed.settled[name]),
            first_position_s=time_to_first_position_s(track, start_ns),
            smoothness=smoothness(positions),
            violations=count_wall_violations(positions, geometries),
            stationary=count_stationary_jumps(positions, is_stationary(*acceleration, positions.t_ns)),
            cost=costs[name],
            statuses=_count_labels(str(e.status) for e in track),
            reasons=_count_labels(reason for e in track for reason in e.reasons),
            failures=_failures(track.estimates),
            intake=tuple(sorted(replayed.intake.items())),
            diagnostics=tuple((key, total, n) for key, (total, n) in sum_diagnostics(track.estimates).items()),
        )
    return kept


def _covered(samples: TruthSamples, coverage: Coverage) -> Bools:
    covered = [bool(coverage.covers(f, xy[np.newaxis])[0]) for f, xy in zip(samples.floors, samples.xy, strict=True)]
    return frozen(covered, np.bool_)


def _first_tick_ns(recording: Recording) -> int:
    return min((event.t_ns for event in recording.events), default=0)


def _thin(positions: TrackPositions, start_ns: int) -> ThinnedTrack:
    names = tuple(sorted(set(positions.floors)))
    numbers = {name: i for i, name in enumerate(names)}
    floor = np.array([numbers[name] for name in positions.floors], dtype=np.int64)
    return ThinnedTrack(
        t_s=frozen((positions.t_ns[::_THINNING_TICKS] - start_ns) * 1e-9, np.float32),
        xy=frozen(positions.xy[::_THINNING_TICKS], np.float32),
        floor=frozen(floor[::_THINNING_TICKS], np.int64),
        floors=names,
    )


def _failures(estimates: Iterable[Estimate]) -> LabelCounts:
    return _count_labels(e.failed_by for e in estimates if e.failed_by)


def _count_labels(words: Iterable[str]) -> LabelCounts:
    return tuple(sorted(Counter(words).items()))


OUTCOME_FORMAT: Final = 1
"""Version of the stored format; outcomes of another version are run again."""


def outcome_key(parts: Mapping[str, Any]) -> str:
    """Return the key (64 hex digits) of an outcome that depends on ``parts``, which are values of JSON."""
    return sha256(json.dumps({"format": OUTCOME_FORMAT, **parts}, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class OutcomeStore:
    """A folder of outcomes; several processes may use it concurrently."""

    folder: Path

    def has(self, key: str) -> bool:
        """Return whether an outcome is stored under ``key``."""
        return self._path(key).is_file()

    def get(self, key: str) -> TrialOutcome | None:
        """Return the outcome stored under ``key``; None if there is none or its file is damaged."""
        try:
            return unpack(self._path(key).read_bytes(), TrialOutcome)
        except (OSError, ValueError):
            return None

    def put(self, key: str, outcome: TrialOutcome) -> None:
        """Store an outcome atomically."""
        path = self._path(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        draft = path.with_name(f".{path.name}.{os.getpid()}")
        draft.write_bytes(pack(outcome))
        draft.replace(path)

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key[2:34]}.outcome"
