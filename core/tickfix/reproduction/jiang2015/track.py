"""What is measured of a pipeline on a simulated walk, of which the true place is known at every tick."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from tickfix.api import TICK_NS, Estimate, Fix, Floats, Recording, Rng, Scan
from tickfix.drivers.replay import Replayed
from tickfix.kernel import Pipeline
from tickfix.simulation import SimulatedWalk


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Tracked:
    """A pipeline on a walk.

    Attributes:
        t_s: (n,) of its ticks with a position, since the walk began.
        xy: (n, 2) published, metres.
        error_m: (n,) distance from the true place at the tick.
        located_m: (m,) the same, settled, at the ticks that brought a location result; empty without Wi-Fi.
        every_s: mean time from one published position to the next other one.
    """

    t_s: Floats
    xy: Floats
    error_m: Floats
    located_m: Floats
    every_s: float

    @property
    def bend_m(self) -> float:
        """How far, on average, a position lies from going on as in the tick before: 0 for a straight, steady way."""
        return float(np.hypot(*np.diff(self.xy, 2, axis=0).T).mean())

    @property
    def growth_m(self) -> float:
        """By how much the error is greater in the last quarter of the walk than in the second."""
        quarters = np.array_split(self.error_m, 4)
        return float(quarters[3].mean() - quarters[1].mean())


def tracked(pipeline: Pipeline, replayed: Replayed, walk: SimulatedWalk) -> Tracked:
    """Measure a pipeline on a walk."""
    t_s, xy, error_m = _errors(replayed.published[pipeline.name], walk)
    stage = pipeline.fingerprint
    ticks = set() if stage is None else {-(-fix.t_ns // TICK_NS) for fix in replayed.fixes[stage.key]}
    located = [(estimate, 0) for estimate in replayed.settled[pipeline.name] if estimate.tick in ticks]
    changes = t_s[1:][np.any(np.diff(xy, axis=0) != 0.0, axis=1)]
    return Tracked(
        t_s=t_s, xy=xy, error_m=error_m, located_m=_errors(located, walk)[2], every_s=float(np.diff(changes).mean())
    )


def with_given_fixes(walk: SimulatedWalk, sigma_m: float, rng: Rng) -> Recording:
    """Return the recording with a fix in the place of each scan, off by ``sigma_m`` in each coordinate."""

    def given(scan: Scan) -> Fix:
        xy = walk.trajectory.xy_at(np.array((scan.t_ns - walk.t_ns[0]) * 1e-9)) + sigma_m * rng.standard_normal(2)
        return Fix(
            t_ns=scan.t_ns,
            floor=walk.recording.floor,
            xy=xy,
            covariance=sigma_m**2 * np.eye(2),
            device=scan.device,
            arrival_ns=scan.arrival_ns,
            seq=scan.seq,
        )

    events = tuple(given(event) if isinstance(event, Scan) else event for event in walk.recording.events)
    return replace(walk.recording, events=events)


def _errors(said: Iterable[tuple[Estimate, int]], walk: SimulatedWalk) -> tuple[Floats, Floats, Floats]:
    """Return times (n,), places (n, 2) and errors (n,) of the estimates that have a belief."""
    known = [(estimate.t_ns, estimate.belief.xy) for estimate, _ in said if estimate.belief is not None]
    t_s = (np.array([t_ns for t_ns, _ in known], np.int64) - walk.t_ns[0]) * 1e-9
    xy = np.array([xy for _, xy in known]).reshape(-1, 2)
    error_m: Floats = np.hypot(*(xy - walk.trajectory.xy_at(t_s)).T)
    return t_s, xy, error_m
