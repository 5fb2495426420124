"""Exact crossings of many short moves with many wall segments.

For small square cells the clearance to the nearest segment is precomputed, so most moves are cleared directly (broad
phase); for the rest a coarse grid lists for each cell the segments that a short move around its centre could touch, and
only those are tested, each exactly. A raster of blocked cells would refuse moves beside a wall, and a test of end
points would jump through it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from tickfix.api import Bools, Floats, Ints, frozen
from tickfix_maps.raster import rasterise_segments

GRID_MARGIN_M: Final = 2.0
_CELL_SIZE_M: Final = 0.1
_MAX_CELLS: Final = 2_000_000  # cells; those of a larger floor are coarser


class CellGrid:
    """Cells over some segments and a margin around them.

    Args:
        segments: (m, 2, 2) float64, metres, at least one.
    """

    def __init__(self, segments: Floats) -> None:
        """Lay the cells over the segments."""
        corners = segments.reshape(-1, 2)
        low, high = corners.min(axis=0) - GRID_MARGIN_M, corners.max(axis=0) + GRID_MARGIN_M
        self.side_m = max(_CELL_SIZE_M, float(np.sqrt(np.prod(high - low) / _MAX_CELLS)))
        self._origin = low
        self._columns, self._rows = np.ceil((high - low) / self.side_m).astype(int).tolist()
        self._last = np.array([[self._columns - 1.0], [self._rows - 1.0]])
        #: (rows, columns): which cells a segment passes.
        self.occupied: Bools = rasterise_segments((segments - low) / self.side_m, (self._rows, self._columns))

    def index_of(self, places: Floats) -> Ints:
        """Return for each point the number of its cell, of the nearest one where it is in none.

        Args:
            places: (2, n): first all x, then all y.
        """
        at = places - self._origin[:, None]
        at *= 1.0 / self.side_m
        np.maximum(at, 0.0, out=at)
        np.minimum(at, self._last, out=at)
        column, row = at.astype(np.int64)
        number: Ints = row * self._columns + column
        return number

    def clearance_m(self) -> Floats:
        """Return for each cell (rows · columns,) a distance that no point in it is nearer to a segment.

        For cells on the edge it also holds beyond them, up to the margin.
        """
        # Half a diagonal from the point to the middle of its cell, and as much from the segment to that of its cell.
        off = ndimage.distance_transform_edt(~self.occupied) - np.sqrt(2.0)
        return frozen(np.clip(self.side_m * off, 0.0, GRID_MARGIN_M).ravel())

    def uniform_cells(self, predicate: Callable[[Floats], Bools]) -> tuple[Bools, Bools]:
        """Return what changes across segments only: ``predicate`` in each cell, and whether it is constant over the
        cell.

        Args:
            predicate: evaluated on points (n, 2), once for every region that segments separate.

        Returns:
            Both (rows · columns,). It is never constant in a cell near a segment.
        """
        # A point may be taken for one of the next cell, by rounding.
        mixed = ndimage.binary_dilation(self.occupied, np.ones((3, 3), np.bool_))
        region: NDArray[np.int32]
        region, count = ndimage.label(~mixed)
        _, first = np.unique(region, return_index=True)
        row, column = np.divmod(first, self._columns)
        middle = self._origin + (np.stack([column, row], axis=1) + 0.5) * self.side_m
        answers = np.zeros(count + 1, dtype=np.bool_)
        answers[region.ravel()[first]] = predicate(middle)
        return frozen(answers[region.ravel()], np.bool_), frozen(~mixed.ravel(), np.bool_)


_CANDIDATE_CELL_M: Final = 0.5
_MAX_HALF_PIECE_M: Final = 1.0  # half of the longest piece that is tested in one go
_ROUNDING_M: Final = 1e-6
_MOVES_PER_BLOCK: Final = 8192  # moves looked at together: their arrays stay in the processor's cache


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
        self._origin: Floats = corners.min(axis=0)[:, None] - GRID_MARGIN_M
        self._shape: Floats = np.ceil((corners.max(axis=0)[:, None] + GRID_MARGIN_M - self._origin) / _CANDIDATE_CELL_M)
        width, height = self._shape.ravel().astype(int).tolist()
        rows, columns = np.divmod(np.arange(width * height), width)
        centres: Floats = self._origin + _CANDIDATE_CELL_M * (np.stack([columns, rows]) + 0.5)
        self._p, self._q = frozen(segments[:, 0].T), frozen(segments[:, 1].T)
        self._cells = CellGrid(segments)
        # A move whose middle lies there and that is shorter meets nothing. Squared, as lengths are compared.
        # Rounded down to single precision, since the cells of a large floor take megabytes.
        clear_length_m2 = (2.0 * np.maximum(self._cells.clearance_m() - _ROUNDING_M, 0.0)) ** 2
        self._clear_length_m2 = frozen(np.nextafter(clear_length_m2.astype(np.float32), np.float32(0.0)), np.float32)
        tree = shapely.STRtree(shapely.linestrings(segments))
        # A piece is at most 2·reach long and its middle lies in the cell.
        reach_m = _MAX_HALF_PIECE_M + _CANDIDATE_CELL_M * np.sqrt(0.5)
        points = shapely.points(*centres)
        cell, segment = tree.query(points, predicate="dwithin", distance=reach_m)
        distance = shapely.distance(points[cell], tree.geometries[segment])
        order = np.lexsort((segment, distance, cell))
        self._candidates: Ints = segment[order].astype(np.int64)
        self._distances: Floats = distance[order]
        self._counts: Ints = np.bincount(cell, minlength=width * height).astype(np.int64)
        self._offsets: Ints = np.concatenate([[0], np.cumsum(self._counts)[:-1]])

    def crosses(self, a: Floats, b: Floats) -> Bools:
        """Return for each move from ``a`` (n, 2) to ``b`` (n, 2) whether it passes through or touches a segment."""
        crossed = np.zeros(len(a), dtype=np.bool_)
        crossed[self._crossings(a, b)[0]] = True
        return crossed

    def first_crossing(self, a: Floats, b: Floats) -> float:
        """Return the share of the single move ``a`` → ``b``, each (2,), done when it meets a segment, else 1."""
        _, segment = self._crossings(a[None], b[None])
        delta = b - a
        shares = [1.0]
        for p, q in self.segments[segment]:
            wall = q - p
            across = delta[0] * wall[1] - delta[1] * wall[0]
            start = p - a
            shares.append(float((start[0] * wall[1] - start[1] * wall[0]) / across) if across != 0 else 0.0)
        return min(shares)

    def _crossings(self, a: Floats, b: Floats) -> tuple[Ints, Ints]:
        """Return for every pair that meets: index of the move and of the segment."""
        if len(self.segments) == 0 or len(a) == 0:
            none = np.zeros(0, dtype=np.int64)
            return none, none
        blocks = [slice(first, first + _MOVES_PER_BLOCK) for first in range(0, len(a), _MOVES_PER_BLOCK)]
        move = np.concatenate([block.start + self._broad_phase(a[block].T, b[block].T) for block in blocks])
        a, b = a[move].T, b[move].T
        close, segment = self._candidate_pairs(a, b)
        # The whole move is tested, not the piece: cutting it would move its points by rounding.
        meets = _segments_meet(a[:, close], b[:, close], self._p[:, segment], self._q[:, segment])
        return move[close[meets]], segment[meets]

    def _broad_phase(self, a: Floats, b: Floats) -> Ints:
        """Return which moves (2, n) → (2, n) are longer than it is far from their middle to a segment."""
        delta = np.subtract(b, a, order="C")
        middle = np.multiply(delta, 0.5)
        middle += a
        delta *= delta
        return np.flatnonzero(delta[0] + delta[1] >= self._clear_length_m2[self._cells.index_of(middle)])

    def _candidate_pairs(self, a: Floats, b: Floats) -> tuple[Ints, Ints]:
        """Return every pair of a move, (2, n) → (2, n), and a segment that might meet: index of each."""
        delta = b - a
        half = 0.5 * np.hypot(*delta)
        if half.max(initial=0.0) <= _MAX_HALF_PIECE_M:
            move, middle = np.arange(len(half)), a + 0.5 * delta
        else:
            pieces = np.maximum(1, np.ceil(half / _MAX_HALF_PIECE_M).astype(np.int64))
            move = np.repeat(np.arange(len(half)), pieces)
            number = np.arange(len(move)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
            middle, half = a[:, move] + (number + 0.5) / pieces[move] * delta[:, move], (half / pieces)[move]
        at = (middle - self._origin) / _CANDIDATE_CELL_M
        inside = np.flatnonzero(((at >= 0.0) & (at < self._shape)).all(axis=0))
        column, row = corner = np.floor(at[:, inside])
        cell = (row * self._shape[0] + column).astype(np.int64)
        # From the cell's centre, a piece reaches no further than to its middle and then half its length.
        off = middle[:, inside] - (self._origin + _CANDIDATE_CELL_M * (corner + 0.5))
        reach = np.hypot(*off) + half[inside] + _ROUNDING_M
        counts = self._counts[cell]
        piece = np.repeat(np.arange(len(cell)), counts)
        candidate = np.arange(len(piece)) + np.repeat(self._offsets[cell] - (np.cumsum(counts) - counts), counts)
        near = np.flatnonzero(self._distances[candidate] <= reach[piece])
        return move[inside[piece[near]]], self._candidates[candidate[near]]


def _segments_meet(a: Floats, b: Floats, p: Floats, q: Floats) -> Bools:
    """Return for each pair whether the closed segments ab and pq, ends (2, n), share a point: (n,) bool."""
    delta, wall, ap, aq, pb = b - a, q - p, p - a, q - a, b - p
    # Each of the two must not lie wholly on one side of the other …
    straddle = np.sign(_cross_product(delta, ap)) * np.sign(_cross_product(delta, aq)) <= 0
    straddle &= (
        np.sign(_cross_product(wall, ap)) * np.sign(_cross_product(wall, pb)) >= 0
    )  # a is on the side that ap comes from
    # … and where both are on one line, their extents must overlap.
    overlap = (np.minimum(a, b) <= np.maximum(p, q)) & (np.minimum(p, q) <= np.maximum(a, b))
    meets: Bools = straddle & overlap[0] & overlap[1]
    return meets


def _cross_product(u: Floats, v: Floats) -> Floats:
    product: Floats = u[0] * v[1] - u[1] * v[0]
    return product
