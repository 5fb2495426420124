"""What the particles of ``fusion-pf`` say: the middle of them, how far around they are, and where they head."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tickfix.api import Belief, Floats, frozen, wrap_rad
from tickfix_filters.fusion_state import Particles
from tickfix_filters.resampling import normalised, spatial_median, weighted_mean


def mean_xy(state: Particles) -> Floats:
    """Return the weighted mean (2,) of the particles' places."""
    weights = normalised(state.log_weights)
    return np.array([weighted_mean(weights, state.xy[:, 0]), weighted_mean(weights, state.xy[:, 1])])


def beliefs(states: Sequence[Particles], *, median: bool) -> list[Belief]:
    """Return what each of D states with N particles means, around their spatial median or their mean."""
    weights = normalised(np.array([state.log_weights for state in states]))
    xy = np.array([state.xy for state in states])
    mean_x, mean_y = weighted_mean(weights, xy[..., 0]), weighted_mean(weights, xy[..., 1])
    x, y = xy[..., 0] - mean_x[:, None], xy[..., 1] - mean_y[:, None]
    off_x, off_y = spatial_median(x, y, weights) if median else (np.zeros(len(states)), np.zeros(len(states)))
    centres = frozen(np.array([mean_x + off_x, mean_y + off_y]).T)
    unseen = np.array([state.unseen.variance_m2 for state in states])
    wx = weights * x
    xx = weighted_mean(wx, x) + off_x * off_x + unseen
    xy_ = weighted_mean(wx, y) + off_x * off_y
    yy = weighted_mean(weights * y, y) + off_y * off_y + unseen
    covariances = frozen(np.array([[xx, xy_], [xy_, yy]]).T)
    turned = _mean_angles(weights, np.array([state.bias_rad for state in states]))
    return [
        Belief(
            floor=state.on.floor,
            xy=centres[d],
            covariance=covariances[d],
            speed_mps=state.speed_mps,
            heading_rad=None if state.heading_rad is None else float(wrap_rad(state.heading_rad + turned[d])),
        )
        for d, state in enumerate(states)
    ]


def _mean_angles(weights: Floats, angles: Floats) -> list[float]:
    """Return the direction in which each row of angles (D, N) points on the whole."""
    single, w = angles.astype(np.float32), weights.astype(np.float32)
    sine, cosine = np.add.reduce(np.sin(single) * w, axis=-1), np.add.reduce(np.cos(single) * w, axis=-1)
    return [math.atan2(*pair) for pair in zip(sine.tolist(), cosine.tolist(), strict=True)]
