"""Fingerprints ``knn`` and ``wknn``.

The plain and the weighted mean of the k nearest reference points in signal space. Sources: [bahl2000] Bahl and
Padmanabhan, "RADAR: an in-building RF-based user location and tracking system", INFOCOM 2000, section 4.3;
representations and similarities of ``wknn`` from [torres-sospedra2015]: a non-linear one pays on walked surveys, where
weak readings are mostly noise. Errors of the cosine are less correlated from scan to scan than those of the others,
which is what a filter benefits from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final

import numpy as np

from tickfix.api import Floats, Preset, parameter
from tickfix.toolkit.nearest_neighbours import NearestNeighbours, NeighbourParams, Representation, Similarity


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

    def neighbour_weights(self, distances: Floats) -> Floats:
        """Let all weigh the same."""
        return np.ones(len(distances))


_EPSILON: Final = 1e-6


@dataclass(frozen=True)
class WknnParams(NeighbourParams):
    """Parameters of ``wknn``."""

    representation: Annotated[
        Representation, parameter("of signal strengths", source="[torres-sospedra2015] 3.1", trains=True)
    ] = "powed"
    similarity: Annotated[Similarity, parameter("what is near", source="[torres-sospedra2015] 3.2", trains=True)] = (
        "cosine"
    )


class Wknn(NearestNeighbours[WknnParams]):
    """Mean of the k nearest reference points, each weighing the inverse of its distance."""

    name = "wknn"
    source = "[bahl2000], [torres-sospedra2015]"
    Params = WknnParams
    presets: ClassVar[Mapping[str, Preset]] = {
        "euclid": Preset(
            "[jiang2015] eq. (20) and [sun2013] compare with it",
            {"representation": "positive", "similarity": "euclidean"},
        ),
        "sun2013": Preset(
            "[sun2013] section 4.2.1: K = 7, mean of N = 2 samples",
            {"k": 7, "n": 2, "representation": "positive", "similarity": "euclidean"},
        ),
    }

    @staticmethod
    def comparison(params: WknnParams) -> tuple[Representation, Similarity]:
        """Compare as chosen."""
        return params.representation, params.similarity

    def neighbour_weights(self, distances: Floats) -> Floats:
        """Weigh by the inverse distance."""
        return 1.0 / (distances + _EPSILON)
