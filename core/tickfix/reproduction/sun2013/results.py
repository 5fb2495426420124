"""A result from each N samples, and what a filter makes of one result after another.

The paper's experiment is one of results, not of a stream: a result from each two samples, one a second, and no motion
sensors. So the fingerprints and filters of the pipelines are called once per result, as the kernel would call them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from tickfix.api import Fix, Floats, Motion, Observation, Prior, Readings, Scan, frozen
from tickfix.kernel import Pipeline
from tickfix.reproduction.sun2013 import choices, site

STEP_NS: Final = round(choices.STEP_S * 1e9)


def window(scans: Sequence[Scan], place: int) -> Readings:
    """Return scans as the window of the ``place``-th result of a pass: the last of them ends at its instant."""
    last = len(scans) - 1
    times = [place * STEP_NS - (last - n) * STEP_NS // choices.ONLINE_SAMPLES for n in range(len(scans))]
    rows = sorted(
        (n, transmitter, rssi_dbm)
        for n, scan in enumerate(scans)
        for transmitter, rssi_dbm in zip(scan.transmitters, scan.rssi_dbm.tolist(), strict=True)
    )
    return Readings(
        t_ns=times[-1],
        transmitters=tuple(row[1] for row in rows),
        rssi_dbm=frozen([row[2] for row in rows]),
        heard_ns=frozen([times[row[0]] for row in rows], np.int64),
        scan=frozen([row[0] for row in rows], np.int64),
        scan_t_ns=tuple(times),
    )


def fingerprint_of(pipeline: Pipeline) -> Any:
    """Return the algorithm of a pipeline's fingerprint."""
    assert pipeline.fingerprint is not None  # noqa: S101 - each of ours has one
    return pipeline.fingerprint.algorithm


def track(pipeline: Pipeline, fixes: Sequence[Fix | None]) -> Floats:
    """Return (T, 2) what a pipeline's filter says at the instant of each of T results; NaN before the first."""
    filter_: Any = pipeline.filter.algorithm
    rng = np.random.default_rng(0)  # none of these filters draws
    state: Any = None
    said = np.full((len(fixes), 2), np.nan)
    for n, fix in enumerate(fixes):
        observation = Observation(t_ns=n * STEP_NS, source="fingerprint", fix=fix)
        if state is None:
            state = filter_.start(Prior(t_ns=n * STEP_NS, fix=fix, observation=observation), rng)
        else:
            state, _ = filter_.step(state, Motion.unknown((n - 1) * STEP_NS, n * STEP_NS), [observation], rng)
        if state is not None:
            said[n] = filter_.estimate(state).xy
    return said


def perfect(xy: Floats) -> list[Fix]:
    """Return the results of a fingerprint that never errs, at test points (T, 2)."""
    return [Fix(t_ns=n * STEP_NS, floor=site.FLOOR, xy=place) for n, place in enumerate(xy)]


def errors(said: Floats, xy: Floats) -> Floats:
    """Return the distances of (…, T, 2) from the test points (T, 2)."""
    away = said - xy
    found: Floats = np.hypot(away[..., 0], away[..., 1])
    return found
