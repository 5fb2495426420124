"""The multi-threshold rules of [wang2015] section 3.1: which extrema of the acceleration make a step.

The paper's equations (3)–(6) are garbled in print; they are read as follows. With Δt_p the time between consecutive
peaks, Δt_pv from the valley before to a peak, δ(Δt_pv) = ½·δ(Δt_p) and valleys as the mirror image of peaks, by
magnitude:

- eq. (3): a peak that makes one more than there are valleys is true if a_p ≥ δ_ap, Δt_p ≥ δ(Δt_p) and Δt_pv ≥ δ(Δt_pv);
- eq. (4): a second peak in a row takes the place of the first if Δa_p ≥ 0 besides;
- eqs. (5)–(6): the same for valleys.

A step is a true peak followed by a true valley. It is told at that valley: a deeper one that takes its place a moment
later moves the times that the next extrema are measured from, not the step. None is searched for while the person
stands: where no extremum has had the amplitude of walking for a while.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from tickfix_pdr.extrema import Extremum


@dataclass(frozen=True, slots=True)
class Thresholds:
    """What extrema are held against.

    Attributes:
        amplitude: δ_ap = |δ_av|, m/s² above or below the slow mean.
        between_s: δ(Δt_p) = δ(Δt_v); between a peak and its valley half of it.
        standing_s: so long without an extremum of that amplitude, the person stands.
    """

    amplitude: float
    between_s: float
    standing_s: float


@dataclass(frozen=True, slots=True)
class StepState:
    """The true extrema so far.

    Attributes:
        surplus: Num_pk − Num_vy: 1 when a true peak awaits its valley.
        peak_ns, valley_ns: the last true ones, −1 before the first.
        a_p, a_v: their values, m/s².
        active_ns: the last extremum with the amplitude of walking, −1 before the first.
    """

    surplus: int = 0
    peak_ns: int = -1
    valley_ns: int = -1
    a_p: float = 0.0
    a_v: float = 0.0
    active_ns: int = -1


@dataclass(frozen=True, slots=True)
class Step:
    """A step: when its valley was, and acc_max and acc_min of eq. (7), m/s²."""

    t_ns: int
    acc_max: float
    acc_min: float


def fold_extrema(
    state: StepState, extrema: Iterable[Extremum], thresholds: Thresholds
) -> tuple[StepState, tuple[Step, ...]]:
    """Fold extrema in their order; return the new state and the steps completed."""
    steps: list[Step] = []
    for extremum in extrema:
        if abs(extremum.a) < thresholds.amplitude:
            continue  # a_p < δ_ap, a_v < δ_av: a false one by any of the four equations
        if state.active_ns >= 0 and _apart(state.active_ns, extremum.t_ns, thresholds.standing_s):
            state = StepState()  # stood: what was before belongs to no step
        state = replace(state, active_ns=extremum.t_ns)
        if extremum.peak and extremum.a > 0.0:
            state = _peak(state, extremum, thresholds)
        elif not extremum.peak and extremum.a < 0.0:
            surplus = state.surplus
            state = _valley(state, extremum, thresholds)
            if state.surplus < surplus:
                steps.append(Step(extremum.t_ns, state.a_p, state.a_v))
    return state, tuple(steps)


def _peak(state: StepState, peak: Extremum, d: Thresholds) -> StepState:
    true = _apart(state.peak_ns, peak.t_ns, d.between_s)  # Δt_p ≥ δ(Δt_p)
    true = true and _apart(state.valley_ns, peak.t_ns, d.between_s / 2.0)  # Δt_pv ≥ δ(Δt_pv)
    if state.surplus == 1:
        true = true and peak.a >= state.a_p  # eq. (4), otherwise eq. (3)
    return replace(state, surplus=1, peak_ns=peak.t_ns, a_p=peak.a) if true else state


def _valley(state: StepState, valley: Extremum, d: Thresholds) -> StepState:
    true = state.peak_ns >= 0  # a valley before the first peak ends no step
    true = true and _apart(state.valley_ns, valley.t_ns, d.between_s)  # Δt_v ≥ δ(Δt_v)
    true = true and _apart(state.peak_ns, valley.t_ns, d.between_s / 2.0)  # Δt_vp ≥ δ(Δt_vp)
    if state.surplus == 0:
        true = true and -valley.a >= -state.a_v  # eq. (6), otherwise eq. (5)
    return replace(state, surplus=0, valley_ns=valley.t_ns, a_v=valley.a) if true else state


def _apart(before_ns: int, now_ns: int, least_s: float) -> bool:
    return before_ns < 0 or (now_ns - before_ns) * 1e-9 >= least_s
