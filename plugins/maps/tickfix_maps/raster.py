"""Geometry on a raster: which pixels a straight move passes, and which lie inside rings.

Coordinates here are in pixels: pixel (row, column) covers the square [column, column + 1) × [row, row + 1), row 0 in
the south. A matrix is indexed ``[row, column]``, that is [y, x].
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tickfix.api import Bools, Floats, Ints

_ROUNDING_PIXELS: Final = 1e-9


def traverse_pixels(a: Floats, b: Floats) -> tuple[Ints, Ints, Ints]:
    """Return every pixel that the moves ``a`` (n, 2) → ``b`` (n, 2) pass: move, row and column, in order of the way.

    The pixels of a move are connected by their edges, except where it passes exactly through a corner.
    """
    n = len(a)
    low, high = np.floor(np.minimum(a, b)), np.floor(np.maximum(a, b))
    crossings = (high - low).astype(np.int64)
    move, share = [np.arange(n)], [np.zeros(n)]
    for axis in (0, 1):
        count = crossings[:, axis]
        those = np.repeat(np.arange(n), count)
        number = np.arange(len(those)) - np.repeat(np.cumsum(count) - count, count)
        line = low[those, axis] + 1.0 + number
        move.append(those)
        share.append((line - a[those, axis]) / (b[those, axis] - a[those, axis]))
    moves, shares = np.concatenate(move), np.concatenate(share)
    order = np.lexsort((shares, moves))
    moves, shares = moves[order], shares[order]
    ends = np.append(np.where(moves[1:] == moves[:-1], shares[1:], 1.0), 1.0)[: len(moves)]
    # Between two lines of the grid a move stays within one pixel, the one of its middle.
    middle = a[moves] + (0.5 * (shares + ends))[:, None] * (b - a)[moves]
    column, row = np.floor(middle).astype(np.int64).T
    return moves, row, column


def clip_moves(a: Floats, b: Floats, shape: tuple[int, int]) -> tuple[Floats, Floats, Ints]:
    """Return what of the moves ``a`` (n, 2) → ``b`` (n, 2) lies over a matrix, and which moves these are."""
    delta = b - a
    limits = np.array(shape[::-1], dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([-a / delta, (limits - a) / delta])
    # A move along an axis never meets the two edges it is parallel to: it is between them all the way or never.
    between = (a >= 0.0) & (a <= limits)
    first = np.where(delta == 0.0, np.where(between, 0.0, np.inf), ends.min(axis=0)).max(axis=1, initial=0.0)
    last = np.where(delta == 0.0, np.where(between, 1.0, -np.inf), ends.max(axis=0)).min(axis=1, initial=1.0)
    over = np.flatnonzero(first <= last)
    start, end = first[over, None], last[over, None]
    # An end that lies over the matrix stays as it is, to the bit.
    c = np.where(start > 0.0, a[over] + start * delta[over], a[over])
    d = np.where(end < 1.0, a[over] + end * delta[over], b[over])
    return c, d, over


def rasterise_segments(segments: Floats, shape: tuple[int, int]) -> Bools:
    """Return the matrix with the pixels that ``segments`` (m, 2, 2) pass, so closed that no diagonal slips through."""
    matrix = np.zeros(shape, dtype=np.bool_)
    which, row, column = traverse_pixels(segments[:, 0], segments[:, 1])
    skips = np.flatnonzero((which[1:] == which[:-1]) & (row[1:] != row[:-1]) & (column[1:] != column[:-1]))
    row, column = np.concatenate([row, row[skips]]), np.concatenate([column, column[skips + 1]])
    inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    matrix[row[inside], column[inside]] = True
    return matrix


def rasterise_rings(rings: Sequence[Floats], shape: tuple[int, int], *, union: bool) -> Bools:
    """Return the matrix with the pixels whose centres are inside the rings, each (n, 2).

    Args:
        rings: in pixels.
        shape: of the matrix.
        union: inside any of the rings; otherwise inside an odd number of them.
    """
    turns = np.zeros((shape[0], shape[1] + 1), dtype=np.int32)
    for ring in rings:
        a, b = ring, np.roll(ring, -1, axis=0)
        orientation = np.sign(float(a[:, 0] @ b[:, 1] - a[:, 1] @ b[:, 0])) or 1.0
        # A row of pixels meets an edge where its centre line lies between the edge's two ends.
        first = np.clip(np.ceil(np.minimum(a[:, 1], b[:, 1]) - 0.5), 0, shape[0]).astype(np.int64)
        last = np.clip(np.ceil(np.maximum(a[:, 1], b[:, 1]) - 0.5), 0, shape[0]).astype(np.int64)
        count = last - first
        edge = np.repeat(np.arange(len(a)), count)
        row = first[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
        share = (row + 0.5 - a[edge, 1]) / (b[edge, 1] - a[edge, 1])
        x = a[edge, 0] + share * (b[edge, 0] - a[edge, 0])
        column = np.clip(np.ceil(x - 0.5 - _ROUNDING_PIXELS), 0, shape[1]).astype(np.int64)
        np.add.at(turns, (row, column), (orientation * np.sign(a[edge, 1] - b[edge, 1])).astype(np.int32))
    inside = np.cumsum(turns, axis=1)[:, :-1]
    matrix: Bools = inside != 0 if union else inside % 2 == 1
    return matrix
