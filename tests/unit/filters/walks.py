"""Walks with honest fixes and true motion, and filters folded over them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from tickfix.api import TICK_NS, Fix, Floats, Motion, Observation, Report, displacement

Folded = list[tuple[Any, Report]]


def walk(seconds: float, heading: Callable[[float], float], speed_mps: float = 1.2) -> tuple[list[Motion], Floats]:
    """Return the motion of every tick, and the places (n + 1, 2) before and after each."""
    motions, places = [], [np.zeros(2)]
    for k in range(round(seconds * 5)):
        theta = heading(0.2 * k)
        motions.append(
            Motion(
                t0_ns=k * TICK_NS,
                t1_ns=(k + 1) * TICK_NS,
                distance_m=0.2 * speed_mps,
                heading_rad=theta,
                steps=int(k % 3 == 0 and speed_mps > 0),
            )
        )
        places.append(places[-1] + displacement(0.2 * speed_mps, theta))
    return motions, np.array(places)


def fixes(
    places: Floats,
    rng: np.random.Generator,
    sigma_m: float = 1.0,
    every: int = 10,
    gross: Mapping[int, tuple[float, float]] | None = None,
) -> dict[int, Fix]:
    """Return fixes by the number of the tick that they end; ``gross`` adds errors to some of them."""
    found = {}
    for k in range(0, len(places), every):
        xy = places[k] + sigma_m * rng.standard_normal(2) + (gross or {}).get(k, (0.0, 0.0))
        found[k] = Fix(t_ns=k * TICK_NS, floor="F", xy=xy, covariance=sigma_m**2 * np.eye(2))
    return found


def fold(algorithm: Any, motions: list[Motion], seen: Mapping[int, Fix], rng: np.random.Generator) -> Folded:
    """Return state and report before the first tick and after each."""
    state = algorithm.begin(seen[0], rng)
    out: Folded = [(state, Report())]
    for k, motion in enumerate(motions, 1):
        observations = [Observation(t_ns=seen[k].t_ns, source="test", fix=seen[k])] if k in seen else []
        state, report = algorithm.step(state, motion, observations, rng)
        out.append((state, report))
    return out


def errors(algorithm: Any, folded: Folded, places: Floats) -> Floats:
    """Return how far the belief was off, metres, after each tick."""
    told = np.array([algorithm.estimate(state).xy for state, _ in folded])
    return np.hypot(*(told - places).T)
