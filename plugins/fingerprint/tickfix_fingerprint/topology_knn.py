"""Fingerprint ``topology-knn``: as many points as the lattice around the nearest one offers, [wang2015] section 2.

The order of work is the paper's (Figure 4): sub-region, nearest reference point, its topology, K, the K points,
eq. (2). How the sub-region is found from what is heard is not printed: here it is the one of most of the points that
correlate best over all access points. The columns of an RSSI matrix are the access points available in its sub-region,
eq. (1): over these the correlation r_j with the measured matrix, that of ``fncc``, is taken anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final

import numpy as np

from tickfix.api import Bools, Context, Floats, Ints, Preset, Readings, SurveyWalk, Trained, Window, parameter
from tickfix_fingerprint.blocks import online
from tickfix_fingerprint.fncc import Fncc, FnccParams
from tickfix_fingerprint.surveyed import SMALLEST, SurveyedFingerprint, SurveyedParams
from tickfix_fingerprint.topology import topology_of

_LEAST_WEIGHT: Final = 1e-9


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
    centre: Annotated[
        float,
        parameter(
            "so near its centre, in spacings, all four of a square count", source="[wang2015] 2.2", ge=0, trains=True
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
        self, params: TopologyKnnParams, context: Context, trained: Trained | None = None, use: Bools | None = None
    ) -> None:
        """Derive the topology from the reference points; ``use`` (S,) bool, only these samples."""
        super().__init__(params, context, trained, use)
        shared = {name: getattr(params, name) for name in ("max_age_s", "missing_dbm", "min_readings", "n", "sample_s")}
        self._fncc = Fncc(FnccParams(**shared), context, None, use)
        self._xy, self._floor = self._fncc.blocks.xy, self._fncc.blocks.floor
        self.topology = topology_of(self._xy, self._floor, params.region_m)
        self._available = self._available_by_region()

    @property
    def window(self) -> Window:
        """The last ``n`` scans."""
        return self._fncc.window

    def observed(self, walk: SurveyWalk, n: int) -> Readings:
        """Return the window that ends with the walk's ``n``-th scan."""
        return self._fncc.observed(walk, n)

    def nearest(self, window: Readings) -> tuple[str, Floats, float] | None:
        """Return floor, place and 1 − r of the nearest reference point."""
        found = self._fncc.ranked(window)
        if found is None:
            return None
        elected = int(np.bincount(self.topology.region[found[0][: self.params.votes]]).argmax())
        r = self._coefficients(window, elected)
        best = int(np.where(self.topology.region == elected, r, -np.inf).argmax())
        xy = self._mean(self.chosen(best, r), r)
        return self.radio_map.floors[self._floor[best]], xy, max(1.0 - float(r[best]), SMALLEST)

    def chosen(self, best: int, r: Floats) -> Ints:
        """Return the K points that describe a place near point ``best``.

        Args:
            best: the nearest reference point.
            r: (P,) float64, correlation coefficients.
        """
        around = self.topology.neighbours[best]
        adjacent = around[around >= 0]
        if len(adjacent) == 0:
            return np.array([best])
        line = np.array([best, adjacent[r[adjacent].argmax()]])
        if len(adjacent) <= self.params.line_gsss:
            return line  # K = 2, the optimal line of Figure 3(b)
        # Each square that meets at the point is a straight neighbour, the diagonal one and the next straight one.
        squares = [np.array([p for p in around[[d, d + 1, (d + 2) % 8]] if p >= 0], np.int64) for d in (0, 2, 4, 6)]
        squares = [corners[np.argsort(-r[corners], kind="stable")] for corners in squares if len(corners) >= 2]
        if not squares:
            return line
        corners = max(squares, key=lambda others: float(r[others[:2]].sum()))
        triangle = np.append(best, corners[:2])  # K = 3, the optimal triangle of Figure 3(a)
        square = np.append(best, corners)
        off_m = float(np.hypot(*(self._mean(triangle, r) - self._xy[square].mean(axis=0))))
        if len(square) == 4 and off_m <= self.params.centre * self.topology.spacing_m[best]:
            return square  # K = 4
        return triangle

    def _coefficients(self, window: Readings, region: int) -> Floats:
        """Return r_j (P,) over the access points of a sub-region; it means something for the sub-region's points."""
        blocks, available = self._fncc.blocks, self._available[region]
        M, N = blocks.shape
        cells, values, _ = online(window, self._fncc.index, N, self.params.missing_dbm)
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
        weights = np.maximum(r[points], _LEAST_WEIGHT)  # a negative correlation must not push the mean out
        mean: Floats = weights @ self._xy[points] / weights.sum()  # [wang2015] eq. (2)
        return mean
