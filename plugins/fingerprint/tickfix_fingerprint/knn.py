"""Fingerprint ``knn``: the mean of the k nearest reference points in signal space.

Source: [bahl2000] Bahl and Padmanabhan, "RADAR: an in-building RF-based user location and tracking system",
INFOCOM 2000, section 4.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tickfix.api import Floats
from tickfix_fingerprint.neighbours import NearestNeighbours, NeighbourParams
from tickfix_fingerprint.representation import Representation
from tickfix_fingerprint.similarity import Similarity


@dataclass(frozen=True)
class KnnParams(NeighbourParams):
    """Parameters of ``knn``."""


class Knn(NearestNeighbours[KnnParams]):
    """Mean of the k reference points whose mean RSS in dBm is nearest to what is heard; all weigh the same."""

    name = "knn"
    source = "[bahl2000] section 4.3"
    Params = KnnParams

    @staticmethod
    def comparison(params: KnnParams) -> tuple[Representation, Similarity]:  # noqa: ARG004 - there is no choice
        """Compare dBm by their Euclidean distance."""
        return "positive", "euclidean"

    def weigh(self, distances: Floats) -> Floats:
        """Let all weigh the same."""
        return np.ones(len(distances))
