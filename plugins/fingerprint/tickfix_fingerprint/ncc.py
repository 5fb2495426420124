"""Fingerprint ``ncc``: normalised cross correlation as it is printed, [sun2013] eqs. (1)–(3).

The plain reference of ``fncc``, point by point; it takes as long as that sounds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tickfix.api import Floats, Ints, Preset, Rng, Survey, Trained
from tickfix_fingerprint.correlation import COLLAPSED, SUN2013, Correlation, CorrelationParams
from tickfix_fingerprint.fncc import Fncc, FnccParams


@dataclass(frozen=True)
class NccParams(CorrelationParams):
    """Parameters of ``ncc``."""


class Ncc(Correlation[NccParams]):
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
        if online_squares <= COLLAPSED * (rss**2).sum():
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
    def train(cls, params: NccParams, survey: Survey, rng: Rng) -> Trained:
        """Learn what ``fncc`` learns: it finds the same points with the same coefficients, much sooner."""
        shared = {name: getattr(params, name) for name in NccParams.__dataclass_fields__}
        return Fncc.train(FnccParams(**shared), survey, rng)
