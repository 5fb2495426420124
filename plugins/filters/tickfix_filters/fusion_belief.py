"""What the particles of ``fusion-pf`` say: the middle of them, how far around they are, and where they head."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tickfix.api import Belief, Floats, wrap_rad
from tickfix_filters.fusion_state import Particles
from tickfix_filters.resampling import normalised, spatial_median, weighted_mean


def mean_xy(state: Particles) -> Floats:
    """Return the weighted mean (2,) of the particles' places."""
    return weighted_mean(normalised(state.log_weights), state.xy.T)


def beliefs(states: Sequence[Particles], *, median: bool) -> list[Belief]:
    """Return what each of D states with N particles means, around their spatial median or their mean."""
    weights = normalised(np.stack([state.log_weights for state in states]))
    xy, bias = np.stack([state.xy for state in states]), np.stack([state.bias_rad for state in states])
    x, y = xy[..., 0].copy(), xy[..., 1].copy()
    centre = weighted_mean(weights, x), weighted_mean(weights, y)
    if median:
        centre = spatial_median(x, y, weights, centre)
    x -= centre[0][:, None]
    y -= centre[1][:, None]
    unseen = np.array([state.unseen.variance_m2 for state in states])
    xx, yy = (weighted_mean(weights, off * off) + unseen for off in (x, y))
    xyxy = np.stack([xx, weighted_mean(weights, x * y), weighted_mean(weights, x * y), yy], axis=-1)
    covariances = xyxy.reshape(-1, 2, 2)
    centres = np.stack(centre, axis=-1)
    single = bias.astype(np.float32)
    sines, cosines = (weighted_mean(weights, turn(single)) for turn in (np.sin, np.cos))
    return [
        Belief(
            floor=state.on.floor,
            xy=centres[d],
            covariance=covariances[d],
            speed_mps=state.speed_mps,
            heading_rad=None
            if state.heading_rad is None
            else float(wrap_rad(state.heading_rad + math.atan2(sines[d], cosines[d]))),
        )
        for d, state in enumerate(states)
    ]
