"""From drawings to the matrix of [sun2013] section 3.2: 1 where people walk, 0 building structure, −1 walkways.

Where nobody has drawn the walkways (the "calibration model"), they are the medial axis of the area people walk in, by
the integer medial axis of [hesselink2008] Hesselink and Roerdink, "Euclidean skeletons of digital image and volume data
in linear time by the integer medial axis transform", IEEE Trans. PAMI 30 (2008): a pixel lies on the axis where its
nearest wall and its neighbour's are far apart.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tickfix.api import Bools, Floats, Floor
from tickfix_maps.raster import drawn, filled

Matrix: TypeAlias = NDArray[np.int8]


def grey(image: NDArray[Any]) -> Floats:
    """Return an image (h, w) or (h, w, 3 or 4), top row first, integers or 0 … 1, as grey 0 … 1, south row first."""
    scale = float(np.iinfo(image.dtype).max) if image.dtype.kind in "iu" else 1.0
    values = image.astype(np.float64) / scale
    if values.ndim == 3:
        values = values[..., 0] if values.shape[2] < 3 else values[..., :3] @ np.array([0.299, 0.587, 0.114])
    return np.ascontiguousarray(values[::-1])


def binary(G: Floats, t_threshold: float) -> Bools:
    """Return which pixels of a grey image (h, w) are light, [sun2013] eq. (7)."""
    I: Bools = t_threshold <= G  # noqa: E741 - the paper's symbol
    return I


def matching_matrix(I_model: Bools, I_no_model: Bools) -> Matrix:
    """Return I_match (h, w) of the plans with and without walkways, both 1 where it is light, [sun2013] eq. (8)."""
    if I_model.shape != I_no_model.shape:
        raise ValueError(f"plan with walkways: found {I_model.shape} pixels, expected {I_no_model.shape} as the plan")
    I_match: Matrix = I_no_model.astype(np.int8) - np.int8(2) * (I_model ^ I_no_model).astype(np.int8)
    # A walkway drawn lighter than structure it covers would give −2: there the building wins.
    return np.where(I_no_model, I_match, np.int8(0))


def plan(floor: Floor, origin: Floats, shape: tuple[int, int], pixel_m: float) -> tuple[Bools, Bools]:
    """Return I_no_model (h, w) of a floor's vector geometry, south row first, from ``origin`` (2,) on, and its lines.

    The lines (h, w) are walls and edges: a move crosses these, while one within an obstacle or off the floor does not.
    """
    outline, obstacles = ([(ring - origin) / pixel_m for ring in rings] for rings in (floor.outline, floor.obstacles))
    free = filled(outline, shape, union=False) if outline else np.ones(shape, dtype=np.bool_)
    free &= ~filled(obstacles, shape, union=True)
    edges = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in (*outline, *obstacles)]
    lines = drawn(np.concatenate([(floor.walls - origin) / pixel_m, *edges]), shape)
    return free & ~lines, lines


def walkways(free: Bools, apart: float) -> Bools:
    """Return the medial axis (h, w) of the free pixels, [hesselink2008] eq. (2), pruned to what lies between walls.

    Args:
        free: where people walk; what lies beyond the edge is structure.
        apart: least distance in pixels between the two nearest walls of a pixel on the axis, at least 1.
    """
    padded = np.pad(free, 1)
    feature = ndimage.distance_transform_edt(padded, return_distances=False, return_indices=True).astype(np.int32)
    axis = np.zeros(padded.shape, dtype=np.bool_)
    here = np.indices(padded.shape, dtype=np.int32)
    for along in (0, 1):
        p = (slice(None),) * (along + 1) + (slice(None, -1),)
        q = (slice(None),) * (along + 1) + (slice(1, None),)
        between = feature[q] - feature[p]
        far = (between**2).sum(axis=0) > apart**2
        # Of two neighbours, the one nearer to the bisector of their walls is on the axis.
        side = (between * (feature[p] + feature[q] - here[p] - here[q])).sum(axis=0)
        axis[p[1:]] |= far & (side <= 0)
        axis[q[1:]] |= far & (side >= 0)
    found: Bools = (axis & padded)[1:-1, 1:-1]
    return found
