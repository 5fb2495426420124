"""Fingerprints ``fncc`` and ``ncc``.

The K points that correlate best with the last N scans, [sun2013] section 3.1. ``fncc`` computes eqs. (3)-(6) for all
points at once; ``ncc`` is its plain reference, eqs. (1)-(3) as printed, point by point and slow. Eqs. (5) and (6)
square the coefficient and lose its sign, so a point that is strong where the phone hears little would rank like one
that agrees; here the squares keep the sign of the numerator, and so the order of eq. (1). Preset ``literal`` ranks by
eq. (6) as printed.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, Literal, TypeVar

import numpy as np

from tickfix.api import (
    Bools,
    Context,
    Floats,
    Ints,
    Preset,
    Readings,
    Rng,
    Survey,
    SurveyWalk,
    TrainedModel,
    Window,
    frozen,
    parameter,
)
from tickfix.toolkit.surveyed_fingerprint import MIN_DISTANCE, SurveyedFingerprint, SurveyedParams, window_of_last_scans
from tickfix_fingerprint.rss_matrices import RssBlocks, online_matrix

MIN_VARIANCE_SHARE: Final = 1e-9
"""A variance below this share of the mean square is rounding, not variation."""
_TIE_DIGITS: Final = 9


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


class CorrelationFingerprint(SurveyedFingerprint[P]):
    """Base: mean of the K points of greatest correlation coefficient; subclasses define how it is computed.

    Where coefficients are equal (all of them are zero when the on-line variance has collapsed) points come in the order
    of how near their mean RSS is to the on-line mean. The fix's uncertainty is learnt from 1 − r of the best point.
    """

    def __init__(
        self, params: P, context: Context, trained: TrainedModel | None = None, sample_mask: Bools | None = None
    ) -> None:
        """Cut the survey into blocks; ``sample_mask`` (S,) bool, only these samples."""
        super().__init__(params, context, trained, sample_mask)
        self.blocks = RssBlocks(
            self.radio_map,
            params.n,
            means=params.reference == "mean",
            missing_dbm=params.missing_dbm,
            sample_s=params.sample_s,
            sample_mask=sample_mask,
            sources=self.window.sources,
        )
        m, n = self.blocks.shape
        variation = self.blocks.squares - self.blocks.sums**2 / max(m * n, 1)
        self.varied: Bools = frozen(variation > MIN_VARIANCE_SHARE * self.blocks.squares, np.bool_)

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
        numbers = self.transmitter_numbers(window)
        cells, values, heard = online_matrix(window, numbers, self.blocks.shape, self.params.missing_dbm)
        if heard < self.params.min_readings or len(self.blocks.xy) == 0:
            return None
        scores, starts = self.scores(cells, values), self.blocks.starts
        count = np.diff(np.append(starts, len(scores)))
        if self.params.pool == "mean":
            pooled = np.add.reduceat(self.coefficients(scores), starts) / count
        else:
            pooled = np.maximum.reduceat(scores, starts)
        # Rounded, so that rounding errors decide no tie and both methods see the same ones.
        pooled = np.round(pooled, _TIE_DIGITS)
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
        return self.radio_map.floors[floor], xy, max(1.0 - float(r[0]), MIN_DISTANCE)

    def survey_window(self, walk: SurveyWalk, n: int) -> Readings:
        """Return the window of N scans that ends with the walk's ``n``-th, each reading at its first delivery."""
        return window_of_last_scans(walk, n, self.params.n, self.params.max_age_s)


@dataclass(frozen=True)
class FnccParams(CorrelationParams):
    """Parameters of ``fncc``."""

    literal: Annotated[bool, parameter("rank by the square without its sign", source="[sun2013] (6)", trains=True)] = (
        False
    )


class Fncc(CorrelationFingerprint[FnccParams]):
    """Mean of the K points whose survey samples correlate best with the last N scans, by sums known beforehand."""

    name = "fncc"
    source = "[sun2013] eqs. (3)–(6)"
    Params = FnccParams
    presets: ClassVar[Mapping[str, Preset]] = {
        "sun2013": SUN2013,
        "literal": Preset("[sun2013] eq. (6) as printed, without the sign", {**SUN2013.values, "literal": True}),
    }

    def scores(self, cells: Ints, values: Floats, transmitters: int | None = None) -> Floats:
        """Return r_l² (B,) with the sign of r_l, of all blocks; zero where a variance has collapsed.

        Args:
            cells, values: what of **rss** is not zero.
            transmitters: M where only some of them are compared; it holds for blocks that hear none of the others.
        """
        M, N = self.blocks.shape
        M = M if transmitters is None else transmitters
        NM = N * M
        rss_sum, RSS_sums = values.sum(), self.blocks.sums
        online_squares = (values**2).sum() - rss_sum**2 / NM
        if online_squares <= MIN_VARIANCE_SHARE * (values**2).sum():
            return np.zeros(len(RSS_sums))
        products = self.blocks.by_cell[cells].T @ values  # Σ_j Σ_i rss_{i,j} RSS_{i,j,l}: the rest of rss is zero
        numerator = products - rss_sum * RSS_sums / NM  # [sun2013] eq. (6)
        denominator = self.blocks.squares - RSS_sums**2 / NM  # [sun2013] eq. (6)
        signs = np.ones(len(numerator)) if self.params.literal else np.sign(numerator)
        varied = self.varied if transmitters is None else denominator > MIN_VARIANCE_SHARE * self.blocks.squares
        squared = np.divide(numerator**2, denominator, out=np.zeros_like(numerator), where=varied)
        # Eq. (4) leaves out the on-line factor, which changes no order; with it, r is known beside the order.
        signed: Floats = signs * squared / online_squares
        return signed

    def coefficients(self, scores: Floats) -> Floats:
        """Return r_l."""
        r: Floats = np.sign(scores) * np.sqrt(np.abs(scores))
        return r


@dataclass(frozen=True)
class NccParams(CorrelationParams):
    """Parameters of ``ncc``."""


class Ncc(CorrelationFingerprint[NccParams]):
    """Mean of the K points whose survey samples correlate best with the last N scans."""

    name = "ncc"
    source = "[sun2013] eqs. (1)–(3)"
    Params = NccParams
    presets: ClassVar[Mapping[str, Preset]] = {"sun2013": SUN2013}

    def scores(self, cells: Ints, values: Floats) -> Floats:
        """Return r_l (B,); zero where a variance has collapsed."""
        M, N = self.blocks.shape
        flat = np.zeros(N * M)
        flat[cells] = values
        rss = flat.reshape(N, M).T
        mu_rss = rss.sum() / (N * M)  # [sun2013] eq. (2)
        online_squares = ((rss - mu_rss) ** 2).sum()
        r = np.zeros(len(self.blocks.point))
        if online_squares <= MIN_VARIANCE_SHARE * (rss**2).sum():
            return r
        for b in np.flatnonzero(self.varied):
            RSS = self.blocks.dense(int(b))
            mu = RSS.sum() / (N * M)  # [sun2013] eq. (2)
            squares = ((RSS - mu) ** 2).sum()
            r[b] = ((rss - mu_rss) * (RSS - mu)).sum() / (np.sqrt(online_squares) * np.sqrt(squares))  # eq. (1)
        return r

    def coefficients(self, scores: Floats) -> Floats:
        """Return the scores: they are the coefficients."""
        return scores

    @classmethod
    def train(cls, params: NccParams, survey: Survey, rng: Rng) -> TrainedModel:
        """Learn what ``fncc`` learns: it finds the same points with the same coefficients, much sooner."""
        shared = {name: getattr(params, name) for name in NccParams.__dataclass_fields__}
        return Fncc.train(FnccParams(**shared), survey, rng)
