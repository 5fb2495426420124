"""Builders of small tracks, so that a test shows nothing but what it is about."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from tickfix.api import TICK_NS, Belief, Estimate, Recording, Status, Truth
from tickfix.evaluation.comparison.trial_outcomes import trial_outcomes
from tickfix.evaluation.comparison.trials import Trial
from tickfix.evaluation.scoring import Coverage
from tickfix.evaluation.track_metrics import StageCost
from tickfix.evaluation.tracks import Track
from tickfix.replay.driver import ReplayResult

Place = tuple[float, float] | None
TrackOf = Callable[..., Track]


@pytest.fixture(scope="session")
def track_of() -> TrackOf:
    """Give a function that makes a track of places, one per tick; tick k closes at k·200 ms unless told otherwise."""

    def build(
        places: Sequence[Place],
        *,
        pipeline: str = "p",
        floors: Sequence[str] | None = None,
        closed_ns: Sequence[int] | None = None,
        sigma_m: float = 2.0,
    ) -> Track:
        estimates = tuple(
            Estimate(
                device="phone",
                pipeline=pipeline,
                epoch=0,
                tick=k,
                t_ns=k * TICK_NS,
                status=Status.INITIALISING if xy is None else Status.TRACKING,
                belief=None
                if xy is None
                else Belief(
                    floor=floors[k - 1] if floors else "F1", xy=np.array(xy), covariance=np.diag([sigma_m**2] * 2)
                ),
            )
            for k, xy in enumerate(places, start=1)
        )
        times = [e.t_ns for e in estimates] if closed_ns is None else closed_ns
        return Track(pipeline=pipeline, device="phone", estimates=estimates, closed_ns=np.array(times, dtype=np.int64))

    return build


TrialOf = Callable[..., Trial]


@pytest.fixture(scope="session")
def trial_of(track_of: TrackOf) -> TrialOf:
    """Give a function that makes a trial: a walk along x from 1 m, a metre a tick, a waypoint at every tick
    or every n-th, tracks as told."""

    def build(
        walk: str,
        *,
        seed: int = 0,
        site: str = "site",
        floor: str = "F1",
        began_ns: int = 0,
        every: int = 1,
        **places: Sequence[Place],
    ) -> Trial:
        count = max(map(len, places.values()))
        truth = [
            Truth(t_ns=began_ns + k * TICK_NS, floor=floor, xy=np.array([float(k), 0.0]))
            for k in range(1, count + 1, every)
        ]
        timed_estimates = {
            name: [
                (replace(estimate, t_ns=began_ns + estimate.t_ns), began_ns + closed_ns)
                for estimate, closed_ns in zip(track, track.closed_ns.tolist(), strict=True)
            ]
            for name, track in ((name, track_of(where, pipeline=name)) for name, where in places.items())
        }
        replayed = ReplayResult(
            recording=Recording(name=walk, floor=floor, events=tuple(truth)),
            published=timed_estimates,
            settled={name: [estimate for estimate, _ in pairs] for name, pairs in timed_estimates.items()},
            fixes={},
            intake={"accepted": 10},
            measurements={},
            failures={},
        )
        costs = {name: StageCost(filter_ns=2000 * count, ticks=count) for name in places}
        surveyed = Coverage([("F1", np.array([[0.0, 0.0], [3.0, 0.0]]))])
        kept = trial_outcomes(replayed, costs, surveyed, {}, {"F1": 1})
        return Trial(site=site, walk=walk, seed=seed, sha256=walk, path=walk, outcomes=kept)

    return build
