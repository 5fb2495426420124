"""Fingerprint ``knn``: the mean of the k nearest reference points in signal space.

Source: [bahl2000] Bahl and Padmanabhan, "RADAR: an in-building RF-based user location and tracking system",
INFOCOM 2000, section 4.3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tickfix.api import Floats, Preset
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
    presets: ClassVar[Mapping[str, Preset]] = {
        "sun2013": Preset("[sun2013] section 4.2.1: K = 7, mean of N = 2 samples", {"k": 7, "n": 2})
    }

    @staticmethod
    def comparison(params: KnnParams) -> tuple[Representation, Similarity]:  # noqa: ARG004 - there is no choice
        """Compare dBm by their Euclidean distance."""
        return "positive", "euclidean"

    def weigh(self, distances: Floats) -> Floats:
        """Let all weigh the same."""
        return np.ones(len(distances))
