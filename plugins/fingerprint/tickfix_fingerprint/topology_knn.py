"""Fingerprint ``topology-knn``.

As many points as the lattice around the nearest one offers, [wang2015] section 2. The paper draws lattice and sub-
regions by hand on the floor plan; here both are derived from the positions of the reference points: a sub-region is a
connected component of points linked by steps of about the lattice spacing, cut by a square grid. Order of work as in
Figure 4: sub-region, nearest reference point, its topology, K, the K points, eq. (2). How the sub-region is found is
not printed: it is the one of most of the points that correlate best over all access points. The correlation r_j, that
of ``fncc``, is then recomputed over the access points available in the sub-region, eq. (1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tickfix.api import (
    Bools,
    Context,
    Floats,
    Ints,
    Preset,
    Readings,
    SurveyWalk,
    TrainedModel,
    Window,
    frozen,
    parameter,
)
from tickfix.toolkit.surveyed_fingerprint import MIN_DISTANCE, SurveyedFingerprint, SurveyedParams
from tickfix_fingerprint.cross_correlation import Fncc, FnccParams
from tickfix_fingerprint.rss_matrices import online_matrix

LATTICE_DIRECTIONS: Final = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")
_LINK_SPACINGS: Final = 1.6  # of the spacing: a diagonal is 1.41 of it, and surveyed points stand askew


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


def derive_topology(xy: Floats, floor: Ints, region_m: float) -> Topology:
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
        pairs = tree.query_pairs(_LINK_SPACINGS * spacing_m[here[0]], output_type="ndarray")
        a, b = np.append(a, here[pairs[:, 0]]), np.append(b, here[pairs[:, 1]])
    cell = np.floor(xy / region_m + 1e-9).astype(np.int64)
    same_cell = (cell[a] == cell[b]).all(axis=1)
    a, b = np.append(a[same_cell], b[same_cell]), np.append(b[same_cell], a[same_cell])
    graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(len(xy), len(xy)))
    region = connected_components(graph, directed=False)[1] if len(xy) else np.zeros(0)
    return Topology(
        region=frozen(region, np.int64), neighbours=_lattice_neighbours(xy, a, b), spacing_m=frozen(spacing_m)
    )


def _lattice_neighbours(xy: Floats, a: Ints, b: Ints) -> Ints:
    """Return for each point the nearest of its linked ones in each direction, (P, 8)."""
    delta = xy[b] - xy[a]
    length = np.hypot(*delta.T)
    direction = np.round(np.arctan2(delta[:, 1], delta[:, 0]) / (np.pi / 4)).astype(np.int64) % 8
    neighbours = np.full((len(xy), 8), -1)
    farthest_first = np.lexsort((b, -length))
    neighbours[a[farthest_first], direction[farthest_first]] = b[farthest_first]
    found: Ints = frozen(neighbours, np.int64)
    return found


_MIN_WEIGHT: Final = 1e-9


@dataclass(frozen=True)
class TopologyKnnParams(SurveyedParams):
    """Parameters of ``topology-knn``."""

    max_age_s: Annotated[float, parameter("greatest age of a reading", unit="s", gt=0, trains=True)] = 5.0
    n: Annotated[int, parameter("v, RSSI measurements of a matrix", source="[wang2015] (1)", ge=1, trains=True)] = 2
    sample_s: Annotated[
        float, parameter("readings of a point within this time can be one survey sample", unit="s", gt=0, trains=True)
    ] = 4.0
    region_m: Annotated[float, parameter("greatest extent of a sub-region", unit="m", gt=0, trains=True)] = 20.0
    votes: Annotated[int, parameter("best points that elect the sub-region", ge=1, trains=True)] = 5
    line_gsss: Annotated[
        int,
        parameter("up to this many neighbours a line describes the place", source="[wang2015] 2.2", ge=0, trains=True),
    ] = 2
    square_centre_tolerance: Annotated[
        float,
        parameter(
            "so near its centre, in spacings, all four of a square count",
            source="[wang2015] 2.2",
            ge=0,
            trains=True,
            formerly="centre",
        ),
    ] = 0.25


class TopologyKnn(SurveyedFingerprint[TopologyKnnParams]):
    """Mean of two to four reference points around the best one, weighted by their correlation with what is heard."""

    name = "topology-knn"
    source = "[wang2015] eqs. (1)–(2)"
    Params = TopologyKnnParams
    presets: ClassVar[Mapping[str, Preset]] = {
        "wang2015": Preset("[wang2015] section 2.2: K = 2 where GSSS ≤ 2; it prints no other value", {"line_gsss": 2})
    }

    def __init__(
        self,
        params: TopologyKnnParams,
        context: Context,
        trained: TrainedModel | None = None,
        sample_mask: Bools | None = None,
    ) -> None:
        """Derive the topology from the reference points; ``sample_mask`` (S,) bool, only these samples."""
        super().__init__(params, context, trained, sample_mask)
        shared = {name: getattr(params, name) for name in ("max_age_s", "missing_dbm", "min_readings", "n", "sample_s")}
        self._fncc = Fncc(FnccParams(**shared), context, None, sample_mask)
        self._xy, self._floor = self._fncc.blocks.xy, self._fncc.blocks.floor
        self.topology = derive_topology(self._xy, self._floor, params.region_m)
        self._available = self._available_by_region()

    @property
    def window(self) -> Window:
        """The last ``n`` scans."""
        return self._fncc.window

    def survey_window(self, walk: SurveyWalk, n: int) -> Readings:
        """Return the window that ends with the walk's ``n``-th scan."""
        return self._fncc.survey_window(walk, n)

    def nearest(self, window: Readings) -> tuple[str, Floats, float] | None:
        """Return floor, place and 1 − r of the nearest reference point."""
        found = self._fncc.ranked(window)
        if found is None:
            return None
        elected = int(np.bincount(self.topology.region[found[0][: self.params.votes]]).argmax())
        r = self._coefficients(window, elected)
        best = int(np.where(self.topology.region == elected, r, -np.inf).argmax())
        xy = self._mean(self.points_around(best, r), r)
        return self.radio_map.floors[self._floor[best]], xy, max(1.0 - float(r[best]), MIN_DISTANCE)

    def points_around(self, best: int, r: Floats) -> Ints:
        """Return the K points that describe a place near point ``best``.

        Args:
            best: the nearest reference point.
            r: (P,) float64, correlation coefficients.
        """
        lattice = self.topology.neighbours[best]
        adjacent = lattice[lattice >= 0]
        if len(adjacent) == 0:
            return np.array([best])
        line = np.array([best, adjacent[r[adjacent].argmax()]])
        if len(adjacent) <= self.params.line_gsss:
            return line  # K = 2, the optimal line of Figure 3(b)
        # Each square that meets at the point is a straight neighbour, the diagonal one and the next straight one.
        squares = [np.array([p for p in lattice[[d, d + 1, (d + 2) % 8]] if p >= 0], np.int64) for d in (0, 2, 4, 6)]
        squares = [corners[np.argsort(-r[corners], kind="stable")] for corners in squares if len(corners) >= 2]
        if not squares:
            return line
        corners = max(squares, key=lambda others: float(r[others[:2]].sum()))
        triangle = np.append(best, corners[:2])  # K = 3, the optimal triangle of Figure 3(a)
        square = np.append(best, corners)
        off_m = float(np.hypot(*(self._mean(triangle, r) - self._xy[square].mean(axis=0))))
        if len(square) == 4 and off_m <= self.params.square_centre_tolerance * self.topology.spacing_m[best]:
            return square  # K = 4
        return triangle

    def _coefficients(self, window: Readings, region: int) -> Floats:
        """Return r_j (P,) over the access points of a sub-region; it means something for the sub-region's points."""
        blocks, available = self._fncc.blocks, self._available[region]
        M, _ = blocks.shape
        numbers = self._fncc.transmitter_numbers(window)
        cells, values, _ = online_matrix(window, numbers, blocks.shape, self.params.missing_dbm)
        kept = available[cells % M]
        scores = self._fncc.scores(cells[kept], values[kept], int(available.sum()))
        return self._fncc.coefficients(np.maximum.reduceat(scores, blocks.starts))

    def _available_by_region(self) -> Bools:
        """Return which access points (regions, M) some point of each sub-region heard."""
        by_cell = self._fncc.blocks.by_cell.tocoo()
        M, _ = self._fncc.blocks.shape
        available = np.zeros((int(self.topology.region.max(initial=-1)) + 1, M), np.bool_)
        available[self.topology.region[self._fncc.blocks.point[by_cell.col]], by_cell.row % M] = True
        return available

    def _mean(self, points: Ints, r: Floats) -> Floats:
        weights = np.maximum(r[points], _MIN_WEIGHT)  # a negative correlation must not push the mean out
        mean: Floats = weights @ self._xy[points] / weights.sum()  # [wang2015] eq. (2)
        return mean
