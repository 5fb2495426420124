"""Exact crossings of many short moves with many wall segments.

Small cells tell how far off every segment is, so that most moves are known at once to meet none. For the others, a
coarse grid lists for each cell the segments that a short move around its centre could touch; only those are tested,
each exactly. A raster of blocked cells would refuse moves beside a wall and a test of end points would jump through it.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import shapely

from tickfix.api import Bools, Floats, Ints, frozen
from tickfix_maps.cells import MARGIN_M, Cells

_CELL_M: Final = 0.5
_REACH_M: Final = 1.0  # half of the longest piece that is tested at once
_ROUNDING_M: Final = 1e-6
_BLOCK: Final = 8192  # moves looked at together: their arrays stay in the processor's cache


class SegmentIndex:
    """Wall segments, ready to be crossed.

    Args:
        segments: (m, 2, 2) float64, metres; segments of no length are left out.
    """

    def __init__(self, segments: Floats) -> None:
        """Lay the grid over the segments."""
        segments = segments[np.hypot(*(segments[:, 1] - segments[:, 0]).T) > 0]
        self.segments = frozen(segments)
        if len(segments) == 0:
            return
        corners = segments.reshape(-1, 2)
        self._origin: Floats = corners.min(axis=0)[:, None] - MARGIN_M
        self._shape: Floats = np.ceil((corners.max(axis=0)[:, None] + MARGIN_M - self._origin) / _CELL_M)
        width, height = self._shape.ravel().astype(int).tolist()
        rows, columns = np.divmod(np.arange(width * height), width)
        centres: Floats = self._origin + _CELL_M * (np.stack([columns, rows]) + 0.5)
        self._p, self._q = frozen(segments[:, 0].T), frozen(segments[:, 1].T)
        self._cells = Cells(segments)
        # A move whose middle lies there and that is shorter meets nothing. Squared, as lengths are compared.
        # Rounded down to single precision, since the cells of a large floor take megabytes.
        harmless_m2 = (2.0 * np.maximum(self._cells.clearance_m() - _ROUNDING_M, 0.0)) ** 2
        self._harmless_m2 = frozen(np.nextafter(harmless_m2.astype(np.float32), np.float32(0.0)), np.float32)
        tree = shapely.STRtree(shapely.linestrings(segments))
        # A piece is at most 2·reach long and its middle lies in the cell.
        reach_m = _REACH_M + _CELL_M * np.sqrt(0.5)
        points = shapely.points(*centres)
        cell, segment = tree.query(points, predicate="dwithin", distance=reach_m)
        distance = shapely.distance(points[cell], tree.geometries[segment])
        order = np.lexsort((segment, distance, cell))
        self._candidates: Ints = segment[order].astype(np.int64)
        self._distances: Floats = distance[order]
        self._counts: Ints = np.bincount(cell, minlength=width * height).astype(np.int64)
        self._offsets: Ints = np.concatenate([[0], np.cumsum(self._counts)[:-1]])

    def crosses(self, a: Floats, b: Floats) -> Bools:
        """Tell for each move from ``a`` (n, 2) to ``b`` (n, 2) whether it passes through or touches a segment."""
        crossed = np.zeros(len(a), dtype=np.bool_)
        crossed[self._crossings(a, b)[0]] = True
        return crossed

    def first_crossing(self, a: Floats, b: Floats) -> float:
        """Return the share of the single move ``a`` → ``b``, each (2,), done when it meets a segment, else 1."""
        _, segment = self._crossings(a[None], b[None])
        way = b - a
        shares = [1.0]
        for p, q in self.segments[segment]:
            wall = q - p
            across = way[0] * wall[1] - way[1] * wall[0]
            start = p - a
            shares.append(float((start[0] * wall[1] - start[1] * wall[0]) / across) if across != 0 else 0.0)
        return min(shares)

    def _crossings(self, a: Floats, b: Floats) -> tuple[Ints, Ints]:
        """Return for every pair that meets: index of the move and of the segment."""
        if len(self.segments) == 0 or len(a) == 0:
            none = np.zeros(0, dtype=np.int64)
            return none, none
        blocks = [slice(first, first + _BLOCK) for first in range(0, len(a), _BLOCK)]
        move = np.concatenate([block.start + self._doubtful(a[block].T, b[block].T) for block in blocks])
        a, b = a[move].T, b[move].T
        close, segment = self._close(a, b)
        # The whole move is tested, not the piece: cutting it would move its points by rounding.
        meets = _meet(a[:, close], b[:, close], self._p[:, segment], self._q[:, segment])
        return move[close[meets]], segment[meets]

    def _doubtful(self, a: Floats, b: Floats) -> Ints:
        """Return which moves (2, n) → (2, n) are longer than it is far from their middle to a segment."""
        way = np.subtract(b, a, order="C")
        middle = np.multiply(way, 0.5)
        middle += a
        way *= way
        return np.flatnonzero(way[0] + way[1] >= self._harmless_m2[self._cells.of(middle)])

    def _close(self, a: Floats, b: Floats) -> tuple[Ints, Ints]:
        """Return every pair of a move, (2, n) → (2, n), and a segment that might meet: index of each."""
        way = b - a
        half = 0.5 * np.hypot(*way)
        if half.max(initial=0.0) <= _REACH_M:
            move, middle = np.arange(len(half)), a + 0.5 * way
        else:
            pieces = np.maximum(1, np.ceil(half / _REACH_M).astype(np.int64))
            move = np.repeat(np.arange(len(half)), pieces)
            number = np.arange(len(move)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
            middle, half = a[:, move] + (number + 0.5) / pieces[move] * way[:, move], (half / pieces)[move]
        at = (middle - self._origin) / _CELL_M
        inside = np.flatnonzero(((at >= 0.0) & (at < self._shape)).all(axis=0))
        column, row = corner = np.floor(at[:, inside])
        cell = (row * self._shape[0] + column).astype(np.int64)
        # From the cell's centre, a piece reaches no further than to its middle and then half its length.
        off = middle[:, inside] - (self._origin + _CELL_M * (corner + 0.5))
        reach = np.hypot(*off) + half[inside] + _ROUNDING_M
        counts = self._counts[cell]
        piece = np.repeat(np.arange(len(cell)), counts)
        candidate = np.arange(len(piece)) + np.repeat(self._offsets[cell] - (np.cumsum(counts) - counts), counts)
        near = np.flatnonzero(self._distances[candidate] <= reach[piece])
        return move[inside[piece[near]]], self._candidates[candidate[near]]


def _meet(a: Floats, b: Floats, p: Floats, q: Floats) -> Bools:
    """Tell for each pair whether the closed segments ab and pq, ends (2, n), share a point: (n,) bool."""
    way, wall, ap, aq, pb = b - a, q - p, p - a, q - a, b - p
    # Each of the two must not lie wholly on one side of the other …
    straddle = np.sign(_cross(way, ap)) * np.sign(_cross(way, aq)) <= 0
    straddle &= np.sign(_cross(wall, ap)) * np.sign(_cross(wall, pb)) >= 0  # a is on the side that ap comes from
    # … and where both are on one line, their extents must overlap.
    overlap = (np.minimum(a, b) <= np.maximum(p, q)) & (np.minimum(p, q) <= np.maximum(a, b))
    meets: Bools = straddle & overlap[0] & overlap[1]
    return meets


def _cross(u: Floats, v: Floats) -> Floats:
    product: Floats = u[0] * v[1] - u[1] * v[0]
    return product
