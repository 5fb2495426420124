"""Fingerprint ``fncc``: fast normalised cross correlation, [sun2013] eqs. (3)–(6), all points at once.

Eqs. (5) and (6) square the coefficient and lose its sign, so that a point that is strong where the phone hears little
is as good as one that agrees. Here the squares keep the sign of the numerator, and so the order of eq. (1); preset
``literal`` ranks by eq. (6) as printed, and finds other points wherever something correlates negatively.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from tickfix.api import Floats, Ints, Preset, parameter
from tickfix_fingerprint.correlation import COLLAPSED, SUN2013, Correlation, CorrelationParams


@dataclass(frozen=True)
class FnccParams(CorrelationParams):
    """Parameters of ``fncc``."""

    literal: Annotated[bool, parameter("rank by the square without its sign", source="[sun2013] (6)", trains=True)] = (
        False
    )


class Fncc(Correlation[FnccParams]):
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
        if online_squares <= COLLAPSED * (values**2).sum():
            return np.zeros(len(RSS_sums))
        products = self.blocks.by_cell[cells].T @ values  # Σ_j Σ_i rss_{i,j} RSS_{i,j,l}: the rest of rss is zero
        numerator = products - rss_sum * RSS_sums / NM  # [sun2013] eq. (6)
        denominator = self.blocks.squares - RSS_sums**2 / NM  # [sun2013] eq. (6)
        signs = np.ones(len(numerator)) if self.params.literal else np.sign(numerator)
        varied = self.varied if transmitters is None else denominator > COLLAPSED * self.blocks.squares
        squared = np.divide(numerator**2, denominator, out=np.zeros_like(numerator), where=varied)
        # Eq. (4) leaves out the on-line factor, which changes no order; with it, r is known beside the order.
        signed: Floats = signs * squared / online_squares
        return signed

    def coefficients(self, scores: Floats) -> Floats:
        """Return r_l."""
        r: Floats = np.sign(scores) * np.sqrt(np.abs(scores))
        return r
