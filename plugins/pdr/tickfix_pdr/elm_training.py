"""Training of pdr ``elm`` on surveyed walks, and what it will err by: [jiang2015] sections 4 and 8.2."""

from __future__ import annotations

from typing import Any

import numpy as np

from tickfix.api import Floats, Ints, Rng, Survey, Trained, wrap_rad
from tickfix_pdr.elm_model import train as fit
from tickfix_pdr.elm_params import ElmParams
from tickfix_pdr.elm_windows import folds, headings, velocities, windows

_FEWEST_WINDOWS = 50


def train(params: ElmParams, survey: Survey, rng: Rng) -> Trained:
    """Train both networks on the survey's walks.

    Returns:
        The networks; ``velocity_mse`` and ``heading_mse`` by number of nodes as rows (nodes, MSE); ``errors``: (4,)
        of the velocity from tick to tick (m/s) and of a walk (relative), of the heading likewise (both radians);
        ``window_mse``: (2,) of the chosen networks in windows they did not see, m²/s² and, the shorter way round,
        rad², the figures of [jiang2015] Table 3.

    Raises:
        ValueError: when the survey has too few windows with all four sensors and waypoints.
    """
    velocity, heading = windows(survey.walks, params.window_ms * 1_000_000, as_vector=params.as_vector)
    if min(len(velocity.t), len(heading.t)) < _FEWEST_WINDOWS:
        raise ValueError(
            f"elm: found {len(velocity.t)} windows for the velocity and {len(heading.t)} for the heading, needs "
            f"{_FEWEST_WINDOWS}: walks with waypoints, accelerometer, gyroscope, magnetometer and rotation vector"
        )
    names = sorted({walk.chain for walk in survey.walks})
    chain = np.array([names.index(walk.chain) for walk in survey.walks])

    def fold(walk: Ints) -> Ints:
        return folds(walk, chain, params.fold_count, keep_chains=params.keep_chains, rng=rng)

    v = fit(
        velocity.x,
        velocity.t[:, None],
        fold(velocity.walk),
        params.velocity_nodes,
        activation=params.velocity_activation,
        ridge=params.ridge,
        rng=rng,
    )
    o = fit(
        heading.x,
        np.stack([np.sin(heading.t), np.cos(heading.t)], axis=1) if params.as_vector else heading.t[:, None],
        fold(heading.walk),
        params.heading_nodes,
        activation=params.heading_activation,
        ridge=params.ridge,
        rng=rng,
    )
    model: dict[str, Any] = {**v.elm.arrays("velocity"), **o.elm.arrays("heading")}
    model["velocity_mse"] = np.stack([v.nodes, v.mse])
    model["heading_mse"] = np.stack([o.nodes, o.mse])
    missed = velocity.t - velocities(v.held_out)
    mean = _by_walk(missed, velocity.walk)
    off = wrap_rad(heading.t - headings(o.held_out))
    bias = np.arctan2(_by_walk(np.sin(off), heading.walk), _by_walk(np.cos(off), heading.walk))
    model["window_mse"] = np.array([np.mean((velocity.t - v.held_out[:, 0]) ** 2), np.mean(off**2)])
    model["errors"] = np.array(
        [
            _rms(missed - mean),
            _rms(mean) / max(float(velocity.t.mean()), 0.1),
            _spread(wrap_rad(off - bias)),
            _rms(bias),
        ]
    )
    return model


def _by_walk(values: Floats, walk: Ints) -> Floats:
    """Return for each value (N,) the mean of its walk."""
    mean: Floats = (np.bincount(walk, values) / np.maximum(np.bincount(walk), 1))[walk]
    return mean


def _spread(values: Floats) -> float:
    """Return the standard deviation by the median: a spline through sparse waypoints errs far where people stop."""
    return float(1.4826 * np.median(np.abs(values)))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
