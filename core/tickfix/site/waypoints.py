"""Walks as a survey uses them.

Waypoints as legs (polylines in time, one per uninterrupted stay on a floor), chains of walks, the hold-out, and all
motion of a walk in one value. The rule of the hold-out: per floor, walks are ordered by (time of first waypoint, file
name); a walk joins the chain of the latest-ending earlier walk whose last waypoint lies ≤ 0.5 m from its first and
ended 0–60 s before it; a chain is held out when ``int(sha256(file name of its first walk without
extensions).hexdigest(), 16) % 1000 < 1000·holdout``. Whole chains are held out because a split within one leaks test
data into the survey.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Final

import numpy as np

from tickfix.api import (
    Bools,
    Floats,
    Ints,
    MotionSamples,
    Pressure,
    Recording,
    Samples,
    Scan,
    SiteError,
    SurveyWalk,
    Truth,
    frozen,
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Leg:
    """One floor's part of a walk.

    Attributes:
        floor: its name.
        t_ns: (n,) int64, increasing.
        xy: (n, 2) float64, metres, floor frame.
    """

    floor: str
    t_ns: Ints
    xy: Floats

    def covers(self, t_ns: Ints) -> Bools:
        """Return which times (k,) lie between the first and the last waypoint, both included."""
        return np.asarray((t_ns >= self.t_ns[0]) & (t_ns <= self.t_ns[-1]))

    def at(self, t_ns: Ints) -> Floats:
        """Return the places (k, 2) at times that the leg covers, linear between waypoints."""
        since, knots = t_ns - self.t_ns[0], self.t_ns - self.t_ns[0]  # nanoseconds since 1970 do not fit into a float
        return np.stack([np.interp(since, knots, self.xy[:, i]) for i in range(2)], axis=1)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SurveyTrack:
    """The polyline of one surveyed walk on one floor.

    Attributes:
        walk: name of the recording.
        floor: name of the floor.
        chain: name of the first walk of its chain.
        t_ns: (n,) int64, times of the waypoints, increasing.
        xy: (n, 2) float64, metres, floor frame.
    """

    walk: str
    floor: str
    chain: str
    t_ns: Ints
    xy: Floats


def split_into_legs(truth: Sequence[Truth]) -> tuple[Leg, ...]:
    """Split waypoints in time order where the floor changes; of waypoints at the same instant the first counts."""
    runs: list[list[Truth]] = []
    for point in truth:
        if not runs or runs[-1][-1].floor != point.floor:
            runs.append([point])
        elif point.t_ns > runs[-1][-1].t_ns:
            runs[-1].append(point)
    return tuple(
        Leg(
            floor=run[0].floor,
            t_ns=frozen([point.t_ns for point in run], np.int64),
            xy=frozen([point.xy for point in run]),
        )
        for run in runs
    )


MAX_CHAIN_GAP_M: Final = 0.5
MAX_CHAIN_GAP_NS: Final = 60_000_000_000


def assign_chains(recordings: Iterable[Recording]) -> dict[str, str]:
    """Return the chain of every walk that has waypoints: walk name → name of the chain's first walk.

    Names must be unique. The result is ordered by (floor, time of first waypoint, name) and does not depend on the
    order of ``recordings``.
    """
    walks = [(recording, truth[0], truth[-1]) for recording in recordings if (truth := recording.truth)]
    walks.sort(key=lambda walk: (walk[0].floor, walk[1].t_ns, walk[0].name))
    chain: dict[str, str] = {}
    for i, (recording, first, _) in enumerate(walks):
        before = [
            (earlier.name, last.t_ns)
            for earlier, _, last in walks[:i]
            if earlier.floor == recording.floor and _follows(first, last)
        ]
        chain[recording.name] = chain[max(before, key=lambda walk: walk[1])[0]] if before else recording.name
    return chain


def is_held_out(chain: str, holdout: float) -> bool:
    """Return whether the chain whose first walk is called ``chain`` is held out, of a share ``holdout`` in [0, 1].

    Raises:
        SiteError: when the share is none.
    """
    if not 0.0 <= holdout <= 1.0:
        raise SiteError(f"holdout: found {holdout}, expected a share from 0 to 1")
    return int(sha256(chain.encode()).hexdigest(), 16) % 1000 < 1000 * holdout


def _follows(first: Truth, last: Truth) -> bool:
    near = math.hypot(first.xy[0] - last.xy[0], first.xy[1] - last.xy[1]) <= MAX_CHAIN_GAP_M
    return near and 0 <= first.t_ns - last.t_ns <= MAX_CHAIN_GAP_NS


def to_survey_walk(recording: Recording, chain: str) -> SurveyWalk:
    """Return the walk with its motion merged and its scans in time order."""
    truth = recording.truth
    return SurveyWalk(
        name=recording.name,
        chain=chain,
        floor=recording.floor or truth[0].floor,
        truth=truth,
        motion=merge_motion(recording),
        scans=tuple(sorted((e for e in recording.events if isinstance(e, Scan)), key=lambda e: (e.t_ns, e.source))),
    )


def merge_motion(recording: Recording) -> MotionSamples:
    """Return all motion samples and pressures in one value, each sensor's times strictly increasing.

    Of samples of a sensor at the same instant the one logged first counts.
    """
    parts: defaultdict[str, list[tuple[Ints, Floats]]] = defaultdict(list)
    for event in recording.events:
        if isinstance(event, MotionSamples):
            for sensor, samples in event.sensors.items():
                parts[sensor].append((samples.t_ns, samples.values))
        elif isinstance(event, Pressure):
            parts["pressure"].append((np.array([event.t_ns]), np.array([[event.pressure_hpa]])))
    sensors: dict[str, Samples] = {}
    for sensor in sorted(parts):
        times, first = np.unique(np.concatenate([t_ns for t_ns, _ in parts[sensor]]), return_index=True)
        sensors[sensor] = Samples(times, np.concatenate([values for _, values in parts[sensor]])[first])
    return MotionSamples(sensors=sensors, device=recording.name, session=recording.name)
