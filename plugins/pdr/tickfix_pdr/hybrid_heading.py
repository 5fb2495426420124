"""The hybrid heading of [wang2015] eq. (8), the first of two so numbered: compass and gyroscope, step by step.

θ_m is what the magnetometer says, θ_g what the gyroscope says, θ_{k−1} the fused heading of the step before:

    θ_Δc = |θ_m,k − θ_g,k|,  θ_Δm = |θ_m,k − θ_m,k−1|

The weights α, β, γ of a branch are normalised to sum to one and the mean is taken on the circle, so that 359° and 1°
give 0°.

The paper leaves open what θ_g is counted from. Counted from the first compass reading on, as the preset ``wang2015``
reads it, the gyroscope's drift is compared with the compass for ever; and in the third branch (the compass is steady,
but disagrees) θ_{k−1} stays as it is and what was turned meanwhile is lost. By default (``keep_turns``) a gyroscope
tells turns only: θ_g,k is θ_{k−1} plus what was turned since, and the θ_{k−1} that α weighs is carried along that
turn too, so that α is trust in the past and not in walking straight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tickfix.api import wrap_rad


@dataclass(frozen=True, slots=True)
class HybridWeights:
    """α, β, γ: of the heading before, the magnetometer and the gyroscope; θ_c and θ_m in radians."""

    alpha: float
    beta: float
    gamma: float
    theta_c: float
    theta_m: float


def hybrid_heading(before: float, theta_m: float, theta_m_before: float, theta_g: float, w: HybridWeights) -> float:
    """Return θ_k [wang2015] eq. (8), all angles in radians.

    Args:
        before: θ_{k−1}, the fused heading of the step before.
        theta_m, theta_m_before: θ_m,k and θ_m,k−1.
        theta_g: θ_g,k.
        w: weights and thresholds.
    """
    agree = abs(wrap_rad(theta_m - theta_g)) <= w.theta_c  # θ_Δc ≤ θ_c
    steady = abs(wrap_rad(theta_m - theta_m_before)) <= w.theta_m  # θ_Δm ≤ θ_m
    if agree and steady:
        terms = [(w.alpha, before), (w.beta, theta_m), (w.gamma, theta_g)]
    elif agree:
        terms = [(w.beta, theta_m), (w.gamma, theta_g)]
    elif steady:
        terms = [(w.alpha, before)]
    else:
        terms = [(w.alpha, before), (w.gamma, theta_g)]
    return circular_mean(terms, before)


def circular_mean(terms: Sequence[tuple[float, float]], otherwise: float) -> float:
    """Return the mean of (weight, angle) on the circle; ``otherwise`` where they cancel or weigh nothing.

    The length of the sum does not matter for its direction: this is where the weights come to sum to one.
    """
    sin = sum(weight * math.sin(angle) for weight, angle in terms)
    cos = sum(weight * math.cos(angle) for weight, angle in terms)
    if math.hypot(sin, cos) <= 1e-9 * sum(weight for weight, _ in terms):
        return otherwise
    return math.atan2(sin, cos)
