"""What ``ncc`` and ``fncc`` share: the K points that correlate best with the last N scans, [sun2013] section 3.1."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, Final, Literal, TypeVar

import numpy as np

from tickfix.api import Bools, Context, Floats, Ints, Preset, Readings, SurveyWalk, Trained, Window, frozen, parameter
from tickfix_fingerprint.blocks import Blocks, online
from tickfix_fingerprint.surveyed import SMALLEST, SurveyedFingerprint, SurveyedParams
from tickfix_fingerprint.windows import last_scans

COLLAPSED: Final = 1e-9
"""A variance below this share of the mean square is rounding, not variation."""
_DIGITS: Final = 9


@dataclass(frozen=True)
class CorrelationParams(SurveyedParams):
    """Parameters of ``ncc`` and ``fncc``."""

    k: Annotated[int, parameter("K, points averaged", source="[sun2013] (3)", ge=1, trains=True)] = 5
    max_age_s: Annotated[float, parameter("greatest age of a reading", unit="s", gt=0, trains=True)] = 5.0
    n: Annotated[
        int, parameter("N, on-line scans, and survey samples of a block", source="[sun2013] (1)", ge=1, trains=True)
    ] = 2
    reference: Annotated[
        Literal["blocks", "mean"],
        parameter("what a point is compared by: blocks of N survey samples, or their mean N times", trains=True),
    ] = "blocks"
    pool: Annotated[Literal["best", "mean"], parameter("which coefficient of its blocks a point has", trains=True)] = (
        "best"
    )
    sample_s: Annotated[
        float, parameter("readings of a point within this time can be one survey sample", unit="s", gt=0, trains=True)
    ] = 4.0


P = TypeVar("P", bound=CorrelationParams)

SUN2013: Final = Preset("[sun2013] section 4.2: N = 2 samples, K = 7 points", {"n": 2, "k": 7})


class Correlation(SurveyedFingerprint[P]):
    """Base: mean of the K points of greatest correlation coefficient; subclasses say how it is computed.

    Where coefficients are equal (all of them are zero when the on-line variance has collapsed) points come in the order
    of how near their mean RSS is to the on-line mean. The fix's uncertainty is learnt from 1 − r of the best point.
    """

    def __init__(self, params: P, context: Context, trained: Trained | None = None, use: Bools | None = None) -> None:
        """Cut the survey into blocks; ``use`` (S,) bool, only these samples."""
        super().__init__(params, context, trained, use)
        self.index = {transmitter: i for i, transmitter in enumerate(self.radio_map.transmitters)}
        self.blocks = Blocks(
            self.radio_map,
            params.n,
            means=params.reference == "mean",
            missing_dbm=params.missing_dbm,
            sample_s=params.sample_s,
            use=use,
        )
        m, n = self.blocks.shape
        variation = self.blocks.squares - self.blocks.sums**2 / max(m * n, 1)
        self.varied: Bools = frozen(variation > COLLAPSED * self.blocks.squares, np.bool_)

    @abstractmethod
    def scores(self, cells: Ints, values: Floats) -> Floats:
        """Return (B,) a rising function of each block's correlation with **rss**; ``cells`` hold what is not zero."""

    @abstractmethod
    def coefficients(self, scores: Floats) -> Floats:
        """Return the correlation coefficients r_l that scores stand for."""

    @property
    def window(self) -> Window:
        """The last N scans."""
        return Window(seconds=self.params.max_age_s, scans=self.params.n)

    def ranked(self, window: Readings) -> tuple[Ints, Floats] | None:
        """Return all points, the best first, with their coefficients; None without enough readings."""
        cells, values, heard = online(window, self.index, self.params.n, self.params.missing_dbm)
        if heard < self.params.min_readings or len(self.blocks.xy) == 0:
            return None
        scores, starts = self.scores(cells, values), self.blocks.starts
        count = np.diff(np.append(starts, len(scores)))
        if self.params.pool == "mean":
            pooled = np.add.reduceat(self.coefficients(scores), starts) / count
        else:
            pooled = np.maximum.reduceat(scores, starts)
        # Rounded, so that rounding errors decide no tie and both methods see the same ones.
        pooled = np.round(pooled, _DIGITS)
        mean = np.add.reduceat(self.blocks.sums, starts) / count
        order = np.lexsort((np.abs(mean - values.sum()), -pooled))  # "sorted in descending order", below eq. (2)
        ranked = pooled[order]
        return order, ranked if self.params.pool == "mean" else self.coefficients(ranked)

    def nearest(self, window: Readings) -> tuple[str, Floats, float] | None:
        """Return floor, place and 1 − r of the best point; the floor is that of most of the K points."""
        found = self.ranked(window)
        if found is None:
            return None
        order, r = found
        chosen = order[: self.params.k]
        floors = self.blocks.floor[chosen]
        floor = int(np.bincount(floors).argmax())
        xy: Floats = self.blocks.xy[chosen[floors == floor]].mean(axis=0)  # [sun2013] eq. (3)
        return self.radio_map.floors[floor], xy, max(1.0 - float(r[0]), SMALLEST)

    def observed(self, walk: SurveyWalk, n: int) -> Readings:
        """Return the window of N scans that ends with the walk's ``n``-th, each reading at its first delivery."""
        return last_scans(walk, n, self.params.n, self.params.max_age_s)
