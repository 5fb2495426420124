"""Base of nearest-neighbour fingerprints.

Representations of signal strengths, distances to all reference points together, and the k nearest points of the radio
map. Representations and similarities after [torres-sospedra2015] Torres-Sospedra et al., "Comprehensive analysis of
distance and similarity measures for Wi-Fi fingerprinting indoor positioning systems", Expert Systems with Applications
42 (2015), sections 3.1 and 3.2. What was not heard is zero in every representation, so the cost of a distance grows
with what was heard, not with what exists.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final, Literal, TypeAlias, TypeVar

import numpy as np

from tickfix.api import (
    Bools,
    Context,
    Floats,
    Ints,
    RadioMap,
    Readings,
    SurveyWalk,
    TrainedModel,
    Window,
    frozen,
    parameter,
)
from tickfix.toolkit.surveyed_fingerprint import MIN_DISTANCE, SurveyedFingerprint, SurveyedParams, window_of_last_scans

Representation: TypeAlias = Literal["positive", "exponential", "powed"]

_ALPHA: Final = 24.0
_BETA: Final = np.e


def represent(rssi_dbm: Floats, representation: Representation, missing_dbm: float) -> Floats:
    """Return ``rssi_dbm`` (any shape; ``missing_dbm`` or less, or NaN: not heard) in another representation.

    ``positive`` is linear in dBm: differences between values are those between the dBm. ``exponential`` and ``powed``
    are normalised to 1 at 0 dBm and let weak readings, which are mostly noise, count less.
    """
    positive = np.maximum(np.nan_to_num(rssi_dbm, nan=missing_dbm) - missing_dbm, 0.0)
    if representation == "positive":
        return positive
    if representation == "exponential":
        exponential: Floats = np.where(positive > 0.0, np.exp((positive + missing_dbm) / _ALPHA), 0.0)
        return exponential
    powed: Floats = (positive / -missing_dbm) ** _BETA
    return powed


Similarity: TypeAlias = Literal["euclidean", "manhattan", "cosine", "sorensen"]


class ReferenceMatrix:
    """Reference vectors, ready to be compared.

    Args:
        matrix: (P, T) float64, each row a point's representation, ≥ 0, zero where it hears nothing.
    """

    def __init__(self, matrix: Floats) -> None:
        """Keep the matrix by transmitter, so that what was heard picks whole rows."""
        self._by_transmitter = frozen(matrix.T)
        self._total = frozen(matrix.sum(axis=1))
        self._squares = frozen((matrix**2).sum(axis=1))

    def distances(self, similarity: Similarity, heard: Ints, values: Floats) -> Floats:
        """Return how far each point is: (P,) float64.

        Args:
            similarity: ``euclidean`` √Σ(p−q)², ``manhattan`` Σ|p−q|, ``cosine`` 1 − p·q/|p||q|, ``sorensen`` (also
                called Bray–Curtis) Σ|p−q|/Σ(p+q).
            heard: (h,) int64, indices of the transmitters heard.
            values: (h,) float64, their representation q.
        """
        p = self._by_transmitter[heard]
        q = values[:, None]
        if similarity in ("euclidean", "cosine"):
            return self._by_squares(similarity, p, q)
        manhattan: Floats = np.abs(p - q).sum(axis=0) + self._total - p.sum(axis=0)
        if similarity == "manhattan":
            return np.maximum(manhattan, 0.0)
        both: Floats = self._total + values.sum()
        return np.divide(manhattan, both, out=np.ones_like(both), where=both > 0.0)

    def _by_squares(self, similarity: Similarity, p: Floats, q: Floats) -> Floats:
        if similarity == "euclidean":
            squares: Floats = ((p - q) ** 2).sum(axis=0) + self._squares - (p**2).sum(axis=0)
            return np.sqrt(np.maximum(squares, 0.0))
        norms: Floats = np.sqrt(self._squares * (q**2).sum())
        cosine: Floats = np.divide((p * q).sum(axis=0), norms, out=np.zeros_like(norms), where=norms > 0.0)
        return 1.0 - cosine


@dataclass(frozen=True)
class NeighbourParams(SurveyedParams):
    """Parameters that every nearest-neighbour fingerprint has."""

    k: Annotated[int, parameter("neighbours averaged", ge=1, trains=True)] = 5
    n: Annotated[
        int,
        parameter(
            "N, the last scans whose mean is compared; 0: the newest reading of each transmitter",
            source="[sun2013] section 4.2.1",
            ge=0,
            trains=True,
        ),
    ] = 0


P = TypeVar("P", bound=NeighbourParams)


class ReferencePoints:
    """The points of a radio map in one representation.

    Args:
        radio_map: the survey.
        representation, missing_dbm: see :func:`~tickfix.toolkit.nearest_neighbours.represent`.
        sample_mask: (S,) bool, the samples to use; all by default.
        sources: whose transmitters to use; readings of other sources are not compared.
    """

    def __init__(
        self,
        radio_map: RadioMap,
        representation: Representation,
        missing_dbm: float,
        sample_mask: Bools | None = None,
        sources: Sequence[str] = ("wifi",),
    ) -> None:
        """Average the samples of each point; points without any are left out."""
        mean = radio_map.mean_matrix(np.nan, sample_mask)
        mean[:, ~radio_map.of_sources(sources)] = np.nan
        known = ~np.isnan(mean).all(axis=1)
        self._representation: Representation = representation
        self._missing_dbm = missing_dbm
        self._numbers = {source: radio_map.transmitter_numbers(source) for source in sources}
        self.floors = radio_map.floors
        self.xy = frozen(radio_map.point_xy[known])
        self.floor = frozen(radio_map.point_floor[known], np.int64)
        self.references = ReferenceMatrix(represent(mean[known], representation, missing_dbm))

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.xy)

    def heard(self, window: Readings, *, averaged: bool = False) -> tuple[Ints, Floats]:
        """Return the known transmitters of the window, each with the representation of its newest or its mean RSS."""
        readings: dict[int, list[float]] = {}
        numbers = self._numbers.get(window.source, {})
        for transmitter, rssi_dbm in zip(window.transmitters, window.rssi_dbm.tolist(), strict=True):
            n = numbers.get(transmitter)
            if n is not None and rssi_dbm == rssi_dbm:  # noqa: PLR0124 - not NaN
                readings.setdefault(n, []).append(rssi_dbm)  # readings come oldest first
        heard = np.fromiter(readings, np.int64, len(readings))
        values = [sum(dbm) / len(dbm) if averaged else dbm[-1] for dbm in readings.values()]
        return heard, represent(np.array(values, np.float64), self._representation, self._missing_dbm)


class NearestNeighbours(SurveyedFingerprint[P]):
    """Base: the mean of the k nearest reference points; subclasses define distance and weights."""

    def __init__(
        self, params: P, context: Context, trained: TrainedModel | None = None, sample_mask: Bools | None = None
    ) -> None:
        """Average the radio map (``sample_mask``: only these samples); the error learnt becomes the covariance of
        fixes.
        """
        super().__init__(params, context, trained, sample_mask)
        representation, self._similarity = self.comparison(params)
        self._points = ReferencePoints(
            self.radio_map, representation, params.missing_dbm, sample_mask, self.window.sources
        )

    @staticmethod
    @abstractmethod
    def comparison(params: P) -> tuple[Representation, Similarity]:
        """Return how readings are represented and compared."""

    @abstractmethod
    def neighbour_weights(self, distances: Floats) -> Floats:
        """Return the neighbours' weights (k,), > 0, for their distances (k,), nearest first."""

    @property
    def window(self) -> Window:
        """The last N scans, or all that was heard within the greatest age."""
        return Window(seconds=self.params.max_age_s, scans=self.params.n) if self.params.n else super().window

    def survey_window(self, walk: SurveyWalk, n: int) -> Readings:
        """Return the window of N scans that ends with the walk's ``n``-th, of one without N."""
        if self.params.n == 0:
            return super().survey_window(walk, n)
        return window_of_last_scans(walk, n, self.params.n, self.params.max_age_s)

    def nearest(self, window: Readings) -> tuple[str, Floats, float] | None:
        """Return floor, place (2,) and distance of the nearest point in signal space; None without enough readings.

        The floor is the one that most of the neighbours' weight lies on, the place their weighted mean there.
        """
        heard, values = self._points.heard(window, averaged=self.params.n > 0)
        if len(heard) < self.params.min_readings or len(self._points) == 0:
            return None
        distances = self._points.references.distances(self._similarity, heard, values)
        order = np.argsort(distances, kind="stable")[: self.params.k]
        weights = self.neighbour_weights(distances[order])
        votes = np.bincount(self._points.floor[order], weights=weights, minlength=len(self._points.floors))
        floor = int(votes.argmax())
        here = self._points.floor[order] == floor
        xy = weights[here] @ self._points.xy[order[here]] / weights[here].sum()
        return self._points.floors[floor], xy, max(float(distances[order[0]]), MIN_DISTANCE)
