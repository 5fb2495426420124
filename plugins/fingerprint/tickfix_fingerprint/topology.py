"""Which reference points are neighbours, and in which sub-region: [wang2015] sections 2.1 and 2.2.

The paper draws lattices and sub-regions by hand on the floor plan. A fingerprint is built before any map is, so both
are derived here from where the reference points lie. Sub-regions are what hangs together: points of one floor that are
linked by steps of about the lattice spacing, cut by a square grid where that would grow too large to tell anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tickfix.api import Floats, Ints, frozen

DIRECTIONS: Final = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")
_REACH: Final = 1.6  # of the spacing: a diagonal is 1.41 of it, and surveyed points stand askew


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Topology:
    """The layout of P reference points.

    Attributes:
        region: (P,) int64, number of the sub-region of each.
        neighbours: (P, 8) int64: the nearest point of the same sub-region in each of :data:`DIRECTIONS`, −1 for none.
        spacing_m: (P,) float64, of the lattice of the point's floor.
    """

    region: Ints
    neighbours: Ints
    spacing_m: Floats

    @property
    def gsss(self) -> Ints:
        """(P,) int64: how many of its eight neighbours each point has, 0 to 8."""
        count: Ints = (self.neighbours >= 0).sum(axis=1).astype(np.int64)
        return count


def topology_of(xy: Floats, floor: Ints, region_m: float) -> Topology:
    """Derive the topology of points.

    Args:
        xy: (P, 2) float64, metres.
        floor: (P,) int64.
        region_m: no sub-region is longer or wider than this.
    """
    spacing_m, a, b = np.ones(len(xy)), np.zeros(0, np.int64), np.zeros(0, np.int64)
    for level in np.unique(floor):
        here = np.flatnonzero(floor == level)
        if len(here) < 2:
            continue
        tree = cKDTree(xy[here])
        nearest = tree.query(xy[here], k=2)[0][:, 1]
        spacing_m[here] = max(float(np.median(nearest)), 1e-6)
        pairs = tree.query_pairs(_REACH * spacing_m[here[0]], output_type="ndarray")
        a, b = np.append(a, here[pairs[:, 0]]), np.append(b, here[pairs[:, 1]])
    cell = np.floor(xy / region_m + 1e-9).astype(np.int64)
    together = (cell[a] == cell[b]).all(axis=1)
    a, b = np.append(a[together], b[together]), np.append(b[together], a[together])
    graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(len(xy), len(xy)))
    region = connected_components(graph, directed=False)[1] if len(xy) else np.zeros(0)
    return Topology(region=frozen(region, np.int64), neighbours=_neighbours(xy, a, b), spacing_m=frozen(spacing_m))


def _neighbours(xy: Floats, a: Ints, b: Ints) -> Ints:
    """Return for each point the nearest of its linked ones in each direction, (P, 8)."""
    way = xy[b] - xy[a]
    length = np.hypot(*way.T)
    direction = np.round(np.arctan2(way[:, 1], way[:, 0]) / (np.pi / 4)).astype(np.int64) % 8
    neighbours = np.full((len(xy), 8), -1)
    farthest_first = np.lexsort((b, -length))
    neighbours[a[farthest_first], direction[farthest_first]] = b[farthest_first]
    found: Ints = frozen(neighbours, np.int64)
    return found
