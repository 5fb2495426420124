"""Errors of published tracks at the waypoints of a walk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tickfix.api import Belief, Bools, Floats, Ints, Truth, frozen
from tickfix.evaluation.coverage import Coverage
from tickfix.evaluation.track import Track


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
        covered: (m,) bool, see :class:`~tickfix.evaluation.coverage.Coverage`.
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
    pipelines = {pipeline: _score(waypoints, track) for pipeline, track in tracks.items()}
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


def belief_at(track: Track, t_ns: int) -> Belief | None:
    """Return what was known at ``t_ns``: the belief of the last tick that had closed by then.

    None before the first tick closed, and where that tick's estimate has no belief or one that is not finite; an older
    belief does not stand in for it.
    """
    i = int(np.searchsorted(track.closed_ns, t_ns, side="right")) - 1
    belief = track.estimates[i].belief if i >= 0 else None
    return belief if belief is not None and np.isfinite(belief.xy).all() else None


def _score(waypoints: Sequence[Truth], track: Track) -> PipelineScore:
    error_m = np.full(len(waypoints), np.nan)
    floor_right = np.zeros(len(waypoints), dtype=np.bool_)
    for i, waypoint in enumerate(waypoints):
        belief = belief_at(track, waypoint.t_ns)
        if belief is not None:
            error_m[i] = np.hypot(*(belief.xy - waypoint.xy))
            floor_right[i] = belief.floor == waypoint.floor
    return PipelineScore(error_m=error_m, floor_right=floor_right)
