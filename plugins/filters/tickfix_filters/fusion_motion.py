"""How the particles of ``fusion-pf`` walk: [jiang2015] eq. (16), for many devices at once.

A tick's way has a length and a direction, and errs in both; what no step explains comes on top of it, alike in all
directions, so that it may as well be drawn along and across the way. Every particle takes four random numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tickfix.api import Floats, Motion, Rng, wrap_rad
from tickfix_filters.fusion_params import FusionPfParams
from tickfix_filters.fusion_state import BiasPrior, Particles
from tickfix_filters.normals import normal_pairs


def bias_prior(motion: Motion, params: FusionPfParams) -> BiasPrior:
    """Return what the first ``motion`` says of its biases; none where all particles walk alike."""
    if not params.own_ways:
        return BiasPrior(0.0, 0.0, compass=True)
    compass = motion.heading_rad is not None
    return BiasPrior(motion.heading_bias_sigma_rad, motion.distance_scale_sigma, compass=compass)


def biases(prior: BiasPrior, n: int, rng: Rng) -> tuple[Floats, Floats]:
    """Draw biases (n,) of the heading and of the length of steps."""
    bias = prior.heading_rad * rng.standard_normal(n) if prior.compass else rng.uniform(-math.pi, math.pi, n)
    return bias, prior.scale * rng.standard_normal(n)


def heading_rad(state: Particles, motion: Motion) -> float:
    """Return the heading of a tick, before biases.

    Without compass the biases begin all around, and turns are all there is to follow.
    """
    if motion.heading_rad is not None:
        return motion.heading_rad
    return float(wrap_rad((state.heading_rad or 0.0) + motion.turn_rad))


def walked(
    xy: Floats,
    bias_rad: Floats,
    scale: Floats,
    headings_rad: Sequence[float],
    motions: Sequence[Motion],
    rngs: Sequence[Rng],
    params: FusionPfParams,
) -> tuple[Floats, Floats]:
    """Return where the particles of D devices walk, (D, N, 2) metres, and the biases of their headings then, (D, N).

    Args:
        xy: (D, N, 2) metres.
        bias_rad, scale: (D, N).
        headings_rad, motions, rngs: of each device.
        params: of the filter.
    """
    own = float(params.own_ways)
    table = [
        (
            heading,
            motion.distance_m,
            params.diffusion_m * math.sqrt((motion.t1_ns - motion.t0_ns) * 1e-9),
            own * motion.distance_sigma_m,
            own * motion.heading_sigma_rad,
            own * motion.turn_bias_sigma_rad,
        )
        for heading, motion in zip(headings_rad, motions, strict=True)
    ]
    # The way is computed in single precision, a ten-millionth of it; the place it leads to is not.
    columns = np.array(table, dtype=np.float32).T[:, :, None]
    heading, distance, diffusion, distance_sigma, heading_sigma, turn_bias_sigma = columns
    n = xy.shape[1]
    one, other = normal_pairs(rngs, 2 * n)
    bias = bias_rad + turn_bias_sigma * one[:, :n]
    theta = heading + bias.astype(np.float32) + heading_sigma * one[:, n:]
    along = distance * (1.0 + scale.astype(np.float32)) + np.hypot(diffusion, distance_sigma) * other[:, :n]
    across = diffusion * other[:, n:]
    sine, cosine = np.sin(theta), np.cos(theta)
    there = np.empty_like(xy)
    there[..., 0] = xy[..., 0] + (along * sine + across * cosine)
    there[..., 1] = xy[..., 1] + (along * cosine - across * sine)
    return there, bias
