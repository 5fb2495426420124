"""Jumps while standing: a track that moves although nobody takes a step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tickfix.api import TICK_NS, Bools, Floats, Ints, Recording
from tickfix.evaluation.metrics.smoothness import Places
from tickfix.site.walks import merged_motion

STILL_MPS2: Final = 0.5
"""Below this deviation of the acceleration's magnitude within a second nobody took a step."""
JUMP_M: Final = 1.0
_WINDOW_NS: Final = 1_000_000_000
_WINDOW_TICKS: Final = _WINDOW_NS // TICK_NS
_LEAST_SAMPLES: Final = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """Counts that pool over walks.

    Attributes:
        standing_s: time during which a position was published and nobody had taken a step for a second.
        jumps: how often the track moved more than 1 m within such a second, or changed floor.
    """

    standing_s: float
    jumps: int


def accelerations(recording: Recording) -> tuple[Ints, Floats]:
    """Return the times (n,) and magnitudes (n,), m/s², of a walk's accelerometer; empty without one."""
    samples = merged_motion(recording).sensors.get("accelerometer")
    if samples is None:
        return np.zeros(0, np.int64), np.zeros(0)
    return samples.t_ns, np.linalg.norm(samples.values[:, :3], axis=1)


def is_standing(t_ns: Ints, magnitude_mps2: Floats, at_ns: Ints) -> Bools:
    """Tell for each instant (m,) whether nobody took a step in the second before it.

    The detector is the moving variance of the acceleration's magnitude [skog2010], which does not depend on any
    pipeline. An instant with fewer than ten samples in its second counts as moving: nothing is known of it.

    Args:
        t_ns: (n,) times of the samples, increasing.
        magnitude_mps2: (n,).
        at_ns: (m,).
    """
    if len(t_ns) == 0:
        return np.zeros(len(at_ns), dtype=np.bool_)
    centred = magnitude_mps2 - magnitude_mps2.mean()
    sums = np.concatenate([[0.0], np.cumsum(centred)])
    squares = np.concatenate([[0.0], np.cumsum(centred**2)])
    low = np.searchsorted(t_ns, at_ns - _WINDOW_NS, side="right")
    high = np.searchsorted(t_ns, at_ns, side="right")
    n = np.maximum(high - low, 1)
    variance = (squares[high] - squares[low]) / n - ((sums[high] - sums[low]) / n) ** 2
    return np.asarray((high - low >= _LEAST_SAMPLES) & (variance < STILL_MPS2**2))


def standing(track: Places, still: Bools) -> Standing:
    """Count the jumps of a track.

    A tick jumps when it is ``still`` and its place lies more than 1 m from the place one second earlier, or on another
    floor; ticks that jump in a row are one jump.

    Args:
        track: its n places.
        still: (n,) bool, see :func:`is_standing`, at the places' times.
    """
    n = len(track.t_ns)
    jumping = np.zeros(n, dtype=np.bool_)
    late = np.arange(_WINDOW_TICKS, n)
    early = late - _WINDOW_TICKS
    whole = track.t_ns[late] - track.t_ns[early] == _WINDOW_NS
    far = np.hypot(*(track.xy[late] - track.xy[early]).T) > JUMP_M
    elsewhere = np.array([track.floors[i] != track.floors[i - _WINDOW_TICKS] for i in late], dtype=np.bool_)
    jumping[late] = whole & still[late] & (far | elsewhere)
    starts = jumping & ~np.concatenate([[False], jumping[:-1]]) if n else jumping
    return Standing(standing_s=float(still.sum() * TICK_NS * 1e-9), jumps=int(starts.sum()))
