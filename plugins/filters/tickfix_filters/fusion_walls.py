"""What a floor's map means to the particles of ``fusion-pf``: where they may begin, and what walls cost them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from tickfix.api import Fix, Floats, FloorMap, Motion, Rng
from tickfix_filters.fusion_params import FusionPfParams
from tickfix_filters.noise import sigma_m

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
