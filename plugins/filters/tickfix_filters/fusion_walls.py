"""What a floor means to the particles of ``fusion-pf``: where they may begin, what walls cost, which way they point."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from tickfix.api import Fix, Floats, FloorMap, Motion, Rng
from tickfix_filters.fusion_params import FusionPfParams
from tickfix_filters.noise import sigma_m
from tickfix_filters.wall_directions import WallDirections

_TRIES: Final = 8  # places drawn for each particle, to find one where it can stand


def around(fix: Fix, n: int, floor_map: FloorMap | None, params: FusionPfParams, rng: Rng) -> Floats:
    """Draw n places (n, 2) around the fix, those preferred where one can stand."""
    drawn = n if floor_map is None else _TRIES * n
    xy = fix.xy + min(sigma_m(fix), params.scatter_m) * rng.standard_normal((drawn, 2))
    if floor_map is None:
        return xy
    free = xy[floor_map.contains(xy)]
    return free[np.arange(n) % len(free)] if len(free) else floor_map.nearest_free(xy[:n])


def toll(
    before: Floats,
    after: Floats,
    floors: Sequence[str],
    motions: Sequence[Motion],
    maps: Mapping[str, FloorMap],
    params: FusionPfParams,
) -> Floats:
    """Return the logarithm (D, N) of the share of its weight that a map leaves to each particle; 0 without a map.

    Args:
        before, after: (D, N, 2) metres, the ends of the particles' ways.
        floors, motions: of each device.
        maps: by floor; each is asked for all devices on its floor at once.
        params: of the filter.
    """
    log_share = np.zeros(after.shape[:2])
    for floor in dict.fromkeys(floors):
        if (floor_map := maps.get(floor)) is None:
            continue
        here = np.flatnonzero([each == floor for each in floors])
        crossed = floor_map.crosses(before[here].reshape(-1, 2), after[here].reshape(-1, 2)).reshape(len(here), -1)
        log_share[here] = math.log(params.crossing_weight) * crossed
        steps = np.array([motions[d].steps for d in here.tolist()])
        here, steps = here[steps > 0], steps[steps > 0]
        if len(here):
            outside = ~floor_map.contains(after[here].reshape(-1, 2)).reshape(len(here), -1)
            log_share[here] += steps[:, None] * math.log(params.outside_weight) * outside
    return log_share


def aligned(
    theta_rad: Floats,
    xy: Floats,
    floors: Sequence[str],
    motions: Sequence[Motion],
    directions: Mapping[str, WallDirections],
    params: FusionPfParams,
) -> Floats:
    """Return the logarithm (D, N) of how much more likely ways are that run as walls do, than ways of any direction.

    With the share q of ways that run along or across the nearest wall, δ off it (von Mises, σ), and the d metres of
    this tick,

        log w = d/L · log(1 − q + q · exp(κ cos 4δ) / I₀(κ)),    κ = 1/(4σ)².

    Args:
        theta_rad: (D, N), where the particles head.
        xy: (D, N, 2) metres, where they are.
        floors, motions: of each device.
        directions: by floor.
        params: of the filter.
    """
    log_weights = np.zeros(theta_rad.shape)
    q, kappa = params.aligned, 0.0625 / params.aligned_sigma_rad**2
    peak = q / float(np.i0(kappa))
    for floor in dict.fromkeys(floors):
        if (walls := directions.get(floor)) is None:
            continue
        here = [d for d, each in enumerate(floors) if each == floor and motions[d].distance_m > 0.0]
        if here:
            off = theta_rad[here].astype(np.float32) - walls.rad(xy[here])
            share = np.log((1.0 - q) + peak * np.exp(kappa * np.cos(4.0 * off)))
            metres = np.array([[motions[d].distance_m] for d in here])
            log_weights[here] = metres / params.aligned_m * np.nan_to_num(share)
    return log_weights
