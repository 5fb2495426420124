"""How smoothly a track moves: a person's acceleration is small, a track that hops has a large one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tickfix.api import TICK_NS, Bools, Floats, Ints
from tickfix.evaluation.track import Track

_TICK_S: Final = TICK_NS * 1e-9


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Places:
    """The published means of a track.

    Attributes:
        t_ns: (n,) int64, ticks with a position, increasing within an epoch.
        xy: (n, 2) float64, metres.
        floors: n names.
        joined: (n − 1,) bool, whether place i + 1 is one tick after place i, on the same floor.
    """

    t_ns: Ints
    xy: Floats
    floors: tuple[str, ...]
    joined: Bools


def places(track: Track) -> Places:
    """Return where a track was, tick by tick."""
    kept = [e for e in track.estimates if e.belief is not None]
    beliefs = [e.belief for e in kept if e.belief is not None]
    joined = [
        (a.epoch, a.tick + 1) == (b.epoch, b.tick) and one.floor == two.floor
        for a, b, one, two in zip(kept, kept[1:], beliefs, beliefs[1:], strict=False)
    ]
    return Places(
        t_ns=np.array([e.t_ns for e in kept], dtype=np.int64),
        xy=np.array([b.xy for b in beliefs]).reshape(-1, 2),
        floors=tuple(b.floor for b in beliefs),
        joined=np.array(joined, dtype=np.bool_),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Smoothness:
    """Sums that pool over walks.

    Attributes:
        squared_mps2: sum of the squared accelerations, (m/s²)².
        accelerations: how many.
        path_m: length of the track, hops between floors not counted.
    """

    squared_mps2: float
    accelerations: int
    path_m: float


def smoothness(track: Places) -> Smoothness:
    """Return the accelerations a_k = (x_{k+1} − 2 x_k + x_{k−1}) / Δt² of consecutive ticks, squared and summed."""
    if len(track.xy) < 2:
        return Smoothness(squared_mps2=0.0, accelerations=0, path_m=0.0)
    moves = np.diff(track.xy, axis=0)
    triples = track.joined[1:] & track.joined[:-1]
    accelerations = np.diff(moves, axis=0)[triples] / _TICK_S**2
    return Smoothness(
        squared_mps2=float(np.sum(accelerations**2)),
        accelerations=int(triples.sum()),
        path_m=float(np.hypot(*moves[track.joined].T).sum()),
    )
