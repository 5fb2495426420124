"""The effective region of a map, [wang2015] section 5.2: where particles may be, and places to put them."""

from __future__ import annotations

from typing import Final

import numpy as np

from tickfix.api import Bools, Floats, FloorMap, Rng, frozen

_TRIES: Final = 8  # places drawn for each particle, to find one where it can stand


def outside(floor_map: FloorMap | None, before: Floats, xy: Floats, *, walls: bool) -> Bools:
    """Tell which of N particles have left the region: (N,) bool; none where there is no map.

    Args:
        floor_map: of the floor.
        before, xy: (N, 2) metres, where they came from and where they are.
        walls: one that passed a wall has left it, too.
    """
    if floor_map is None:
        return np.zeros(len(xy), dtype=np.bool_)
    left = ~floor_map.contains(xy)
    return left | floor_map.crosses(before, xy) if walls else left


def scattered(floor_map: FloorMap | None, place: Floats, sigma_m: float, n: int, rng: Rng) -> Floats:
    """Draw ``n`` places (n, 2) around ``place`` (2,), those preferred where one can stand."""
    xy = place + sigma_m * rng.standard_normal((n if floor_map is None else _TRIES * n, 2))
    if floor_map is None:
        return frozen(xy)
    free = xy[floor_map.contains(xy)]
    return frozen(free[np.arange(n) % len(free)] if len(free) else floor_map.nearest_free(xy[:n]))
