"""What small square cells of a floor tell at once of every point in them, so that few points need exact geometry."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tickfix.api import Bools, Floats, Ints, frozen
from tickfix_maps.raster import drawn

MARGIN_M: Final = 2.0
_SIDE_M: Final = 0.1
_MOST: Final = 2_000_000  # cells; those of a larger floor are coarser


class Cells:
    """Cells over some segments and a margin around them.

    Args:
        segments: (m, 2, 2) float64, metres, at least one.
    """

    def __init__(self, segments: Floats) -> None:
        """Lay the cells over the segments."""
        corners = segments.reshape(-1, 2)
        low, high = corners.min(axis=0) - MARGIN_M, corners.max(axis=0) + MARGIN_M
        self.side_m = max(_SIDE_M, float(np.sqrt(np.prod(high - low) / _MOST)))
        self._origin = low
        self._columns, self._rows = np.ceil((high - low) / self.side_m).astype(int).tolist()
        self._last = np.array([[self._columns - 1.0], [self._rows - 1.0]])
        #: (rows, columns): which cells a segment passes.
        self.passed: Bools = drawn((segments - low) / self.side_m, (self._rows, self._columns))

    def of(self, places: Floats) -> Ints:
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
        off = ndimage.distance_transform_edt(~self.passed) - np.sqrt(2.0)
        return frozen(np.clip(self.side_m * off, 0.0, MARGIN_M).ravel())

    def alike(self, holds: Callable[[Floats], Bools]) -> tuple[Bools, Bools]:
        """Return what changes across segments only: whether it ``holds`` in each cell, and whether the cell tells.

        Args:
            holds: tells for points (n, 2); asked once for every region that segments separate.

        Returns:
            Both (rows · columns,). A cell near a segment does not tell.
        """
        # A point may be taken for one of the next cell, by rounding.
        mixed = ndimage.binary_dilation(self.passed, np.ones((3, 3), np.bool_))
        region: NDArray[np.int32]
        region, count = ndimage.label(~mixed)
        _, first = np.unique(region, return_index=True)
        row, column = np.divmod(first, self._columns)
        middle = self._origin + (np.stack([column, row], axis=1) + 0.5) * self.side_m
        answers = np.zeros(count + 1, dtype=np.bool_)
        answers[region.ravel()[first]] = holds(middle)
        return frozen(answers[region.ravel()], np.bool_), frozen(~mixed.ravel(), np.bool_)
