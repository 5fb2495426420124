"""Fingerprint ``wknn``: the weighted mean of the k nearest reference points, with a choice of what is near.

Sources: [bahl2000] for the idea, [torres-sospedra2015] for representations and similarities; a non-linear one is
theirs and pays on walked surveys, where weak readings are mostly noise. Errors of the cosine are less alike from scan
to scan than those of the others, and that is what a filter lives on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final

from tickfix.api import Floats, Preset, parameter
from tickfix_fingerprint.neighbours import NearestNeighbours, NeighbourParams
from tickfix_fingerprint.representation import Representation
from tickfix_fingerprint.similarity import Similarity

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

    def weigh(self, distances: Floats) -> Floats:
        """Weigh by the inverse distance."""
        return 1.0 / (distances + _EPSILON)
