"""What a pipeline said of itself at a waypoint: the first place to look when it was far off."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Final

import numpy as np

from tickfix.api import TICK_NS, Ints
from tickfix.evaluation.track import Track

RECENT_S: Final = 10.0
_RECENT_TICKS: Final = round(RECENT_S * 1e9 / TICK_NS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """The estimate that was known at an instant, without its belief.

    Attributes:
        status: of the estimate; empty before the first tick closed.
        observation_age_s, motion_age_s: since an observation was last used and motion last measured, None before any.
        innovation_m, gate: the newest of the last ten seconds, None without one.
        reasons: what the filter reported in the last ten seconds, with how often.
        failed_by: the stage that failed, if one did.
    """

    status: str = ""
    observation_age_s: float | None = None
    motion_age_s: float | None = None
    innovation_m: float | None = None
    gate: float | None = None
    reasons: tuple[tuple[str, int], ...] = ()
    failed_by: str = ""

    def __str__(self) -> str:
        """Return it in words."""
        words = [self.status or "no estimate yet"]
        if self.observation_age_s is not None:
            words.append(f"last observation used {self.observation_age_s:.1f} s ago")
        elif self.status:
            words.append("no observation used yet")
        if self.motion_age_s is not None and self.motion_age_s > 1.0:
            words.append(f"no motion for {self.motion_age_s:.1f} s")
        if self.innovation_m is not None:
            words.append(f"innovation {self.innovation_m:.1f} m")
        if self.gate is not None:
            words.append(f"gate {self.gate:.1f}")
        words += [f"{reason} ({count} ×)" for reason, count in self.reasons]
        if self.failed_by:
            words.append(f"failed: {self.failed_by}")
        return ", ".join(words)


def diagnoses(track: Track, t_ns: Ints) -> tuple[Diagnosis, ...]:
    """Return what was known at each of the instants (m,), which are arrival times."""
    last = np.searchsorted(track.closed_ns, t_ns, side="right") - 1
    return tuple(_diagnosis(track, int(i)) for i in last)


def _diagnosis(track: Track, i: int) -> Diagnosis:
    if i < 0:
        return Diagnosis()
    now = track.estimates[i]
    recent = [e for e in track.estimates[max(0, i - _RECENT_TICKS) : i + 1] if e.epoch == now.epoch]
    innovations = [e.innovation_m for e in recent if e.innovation_m is not None]
    gates = [e.gate for e in recent if e.gate is not None]
    reasons = Counter(reason for e in recent for reason in e.reasons)
    return Diagnosis(
        status=str(now.status),
        observation_age_s=_seconds(now.observation_age_ns),
        motion_age_s=_seconds(now.motion_age_ns),
        innovation_m=float(innovations[-1]) if innovations else None,
        gate=float(gates[-1]) if gates else None,
        reasons=tuple(sorted(reasons.items())),
        failed_by=now.failed_by,
    )


def _seconds(age_ns: int | None) -> float | None:
    return None if age_ns is None else age_ns * 1e-9
