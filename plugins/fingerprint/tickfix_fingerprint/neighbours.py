"""What nearest-neighbour fingerprints share: the radio map as reference points."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, TypeVar

import numpy as np

from tickfix.api import (
    Bools,
    Context,
    Floats,
    Ints,
    RadioMap,
    Readings,
    SurveyWalk,
    Trained,
    Window,
    frozen,
    parameter,
)
from tickfix_fingerprint.representation import Representation, represent
from tickfix_fingerprint.similarity import References, Similarity
from tickfix_fingerprint.surveyed import SMALLEST, SurveyedFingerprint, SurveyedParams
from tickfix_fingerprint.windows import last_scans


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
        representation, missing_dbm: see :func:`~tickfix_fingerprint.representation.represent`.
        use: (S,) bool, the samples to use; all by default.
    """

    def __init__(
        self, radio_map: RadioMap, representation: Representation, missing_dbm: float, use: Bools | None = None
    ) -> None:
        """Average the samples of each point; points without any are left out."""
        mean = radio_map.mean_matrix(np.nan, use)
        mean[:, [transmitter.startswith("ble:") for transmitter in radio_map.transmitters]] = np.nan
        known = ~np.isnan(mean).all(axis=1)
        self._representation: Representation = representation
        self._missing_dbm = missing_dbm
        self._index = {transmitter: n for n, transmitter in enumerate(radio_map.transmitters)}
        self.floors = radio_map.floors
        self.xy = frozen(radio_map.point_xy[known])
        self.floor = frozen(radio_map.point_floor[known], np.int64)
        self.references = References(represent(mean[known], representation, missing_dbm))

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.xy)

    def heard(self, window: Readings, *, averaged: bool = False) -> tuple[Ints, Floats]:
        """Return the known transmitters of the window, each with the representation of its newest or its mean RSS."""
        readings: dict[int, list[float]] = {}
        for transmitter, rssi_dbm in zip(window.transmitters, window.rssi_dbm.tolist(), strict=True):
            n = self._index.get(transmitter)
            if n is not None:
                readings.setdefault(n, []).append(rssi_dbm)  # readings come oldest first
        heard = np.fromiter(readings, np.int64, len(readings))
        values = [sum(dbm) / len(dbm) if averaged else dbm[-1] for dbm in readings.values()]
        return heard, represent(np.array(values, np.float64), self._representation, self._missing_dbm)


class NearestNeighbours(SurveyedFingerprint[P]):
    """Base: the mean of the k nearest reference points; subclasses say what is near and how neighbours weigh."""

    def __init__(self, params: P, context: Context, trained: Trained | None = None, use: Bools | None = None) -> None:
        """Average the radio map (``use``: only these samples); the error learnt becomes the covariance of fixes."""
        super().__init__(params, context, trained, use)
        representation, self._similarity = self.comparison(params)
        self._points = ReferencePoints(self.radio_map, representation, params.missing_dbm, use)

    @staticmethod
    @abstractmethod
    def comparison(params: P) -> tuple[Representation, Similarity]:
        """Return how readings are represented and compared."""

    @abstractmethod
    def weigh(self, distances: Floats) -> Floats:
        """Return the neighbours' weights (k,), > 0, for their distances (k,), nearest first."""

    @property
    def window(self) -> Window:
        """The last N scans, or all that was heard within the greatest age."""
        return Window(seconds=self.params.max_age_s, scans=self.params.n) if self.params.n else super().window

    def observed(self, walk: SurveyWalk, n: int) -> Readings:
        """Return the window of N scans that ends with the walk's ``n``-th, of one without N."""
        if self.params.n == 0:
            return super().observed(walk, n)
        return last_scans(walk, n, self.params.n, self.params.max_age_s)

    def nearest(self, window: Readings) -> tuple[str, Floats, float] | None:
        """Return floor, place (2,) and distance of the nearest point in signal space; None without enough readings.

        The floor is the one that most of the neighbours' weight lies on, the place their weighted mean there.
        """
        heard, values = self._points.heard(window, averaged=self.params.n > 0)
        if len(heard) < self.params.min_readings or len(self._points) == 0:
            return None
        distances = self._points.references.distances(self._similarity, heard, values)
        order = np.argsort(distances, kind="stable")[: self.params.k]
        weights = self.weigh(distances[order])
        votes = np.bincount(self._points.floor[order], weights=weights, minlength=len(self._points.floors))
        floor = int(votes.argmax())
        here = self._points.floor[order] == floor
        xy = weights[here] @ self._points.xy[order[here]] / weights[here].sum()
        return self._points.floors[floor], xy, max(float(distances[order[0]]), SMALLEST)
