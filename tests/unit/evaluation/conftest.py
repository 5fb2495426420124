"""Builders of small tracks, so that a test shows nothing but what it is about."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from tickfix.api import TICK_NS, Belief, Estimate, Status
from tickfix.evaluation.track import Track

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
