"""What nearest-neighbour fingerprints share: the radio map as reference points, and how wrong a fix usually is."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, Final, TypeVar

import numpy as np

from tickfix.api import (
    Bools,
    Context,
    Fix,
    Floats,
    Ints,
    RadioMap,
    Readings,
    Rng,
    StatelessFingerprint,
    Survey,
    SurveyWalk,
    Trained,
    Window,
    frozen,
    parameter,
)
from tickfix_fingerprint.representation import Representation, represent
from tickfix_fingerprint.similarity import References, Similarity

_FOLDS: Final = 6
_BINS: Final = 6
_SMALLEST: Final = 1e-6


@dataclass(frozen=True)
class NeighbourParams:
    """Parameters that every nearest-neighbour fingerprint has."""

    k: Annotated[int, parameter("neighbours averaged", ge=1, trains=True)] = 5
    max_age_s: Annotated[float, parameter("greatest age of a reading", unit="s", gt=0, trains=True)] = 3.0
    missing_dbm: Annotated[
        float, parameter("stands for a transmitter that is not heard", unit="dBm", lt=0, trains=True)
    ] = -100.0
    min_readings: Annotated[int, parameter("fewer known transmitters than this give no fix", ge=1)] = 3
    sigma_m: Annotated[float, parameter("error per axis where no survey taught one", unit="m", gt=0)] = 5.0


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

    def heard(self, window: Readings) -> tuple[Ints, Floats]:
        """Return the known transmitters of the window, each with the representation of its newest reading."""
        newest: dict[int, float] = {}
        for transmitter, rssi_dbm in zip(window.transmitters, window.rssi_dbm.tolist(), strict=True):
            n = self._index.get(transmitter)
            if n is not None:
                newest[n] = rssi_dbm  # readings come oldest first
        heard = np.fromiter(newest, np.int64, len(newest))
        rssi_dbm = np.fromiter(newest.values(), np.float64, len(newest))
        return heard, represent(rssi_dbm, self._representation, self._missing_dbm)


class NearestNeighbours(StatelessFingerprint[P]):
    """Base: the mean of the k nearest reference points; subclasses say what is near and how neighbours weigh."""

    def __init__(self, params: P, context: Context, trained: Trained | None = None, use: Bools | None = None) -> None:
        """Average the radio map (``use``: only these samples); the error learnt becomes the covariance of fixes."""
        super().__init__(params, context, trained)
        if context.radio_map is None:
            raise ValueError("the site has no radio map")
        representation, self._similarity = self.comparison(params)
        self._points = ReferencePoints(context.radio_map, representation, params.missing_dbm, use)
        self._distances, self._sigmas_m, self._lead_ns = np.ones(1), np.full(1, params.sigma_m), 0
        if trained is not None:
            self._distances, self._sigmas_m = trained["distance"], trained["sigma_m"]
            self._lead_ns = round(float(trained["lead_s"]) * 1e9)

    @staticmethod
    @abstractmethod
    def comparison(params: P) -> tuple[Representation, Similarity]:
        """Return how readings are represented and compared."""

    @abstractmethod
    def weigh(self, distances: Floats) -> Floats:
        """Return the neighbours' weights (k,), > 0, for their distances (k,), nearest first."""

    @property
    def window(self) -> Window:
        """Everything heard within the greatest age."""
        return Window(seconds=self.params.max_age_s)

    def locate(self, window: Readings) -> Fix | None:
        """Average the k nearest points; the further the nearest of them, the less sure is the fix."""
        found = self.nearest(window)
        if found is None:
            return None
        floor, xy, distance = found
        sigma_m = np.exp(np.interp(np.log(distance), np.log(self._distances), np.log(self._sigmas_m)))
        t_ns = max(0, window.t_ns + self._lead_ns)
        return Fix(t_ns=t_ns, floor=floor, xy=xy, covariance=sigma_m**2 * np.eye(2), source=self.name)

    def nearest(self, window: Readings) -> tuple[str, Floats, float] | None:
        """Return floor, place (2,) and distance of the nearest point in signal space; None without enough readings.

        The floor is the one that most of the neighbours' weight lies on, the place their weighted mean there.
        """
        heard, values = self._points.heard(window)
        if len(heard) < self.params.min_readings or len(self._points) == 0:
            return None
        distances = self._points.references.distances(self._similarity, heard, values)
        order = np.argsort(distances, kind="stable")[: self.params.k]
        weights = self.weigh(distances[order])
        votes = np.bincount(self._points.floor[order], weights=weights, minlength=len(self._points.floors))
        floor = int(votes.argmax())
        here = self._points.floor[order] == floor
        xy = weights[here] @ self._points.xy[order[here]] / weights[here].sum()
        return self._points.floors[floor], xy, max(float(distances[order[0]]), _SMALLEST)

    @classmethod
    def train(cls, params: P, survey: Survey, rng: Rng) -> Trained:  # noqa: ARG003 - nothing is drawn
        """Learn two things of a fix: which instant it describes, and how far off it is.

        Chains of walks are dealt to folds, and each fold's scans are located with the samples of the others only; so
        places that no other walk came near teach what a fix is worth where nobody surveyed.
        """
        rows: list[Floats] = []
        for fold in range(_FOLDS):
            use = survey.radio_map.sample_chain % _FOLDS != fold
            walks = [walk for n, walk in _by_chain(survey) if n % _FOLDS == fold]
            if not walks or not use.any():
                continue
            method = cls(params, Context(radio_map=survey.radio_map), None, use)
            rows += [method.errors(walk) for walk in walks]
        found = np.concatenate([np.zeros((0, 5)), *rows])
        distance, error, velocity = found[:, 0], found[:, 1:3], found[:, 3:5]
        lead_s = usual_lead_s(distance, error, velocity)
        return {"lead_s": np.array(lead_s)} | error_by_distance(
            distance, np.hypot(*(error - lead_s * velocity).T), params.sigma_m
        )

    def errors(self, walk: SurveyWalk) -> Floats:
        """Return (n, 5) for the scans between a walk's first and last waypoint.

        Columns: distance in signal space; error of the fix at the scan's time, x and y, metres; velocity, x and y, m/s.
        """
        t_ns = np.array([truth.t_ns for truth in walk.truth], np.float64)
        xy = np.array([truth.xy for truth in walk.truth])
        rows = []
        for scan in walk.scans:
            if scan.source not in self.window.sources or not t_ns[0] <= scan.t_ns < t_ns[-1]:
                continue
            found = self.nearest(Readings.of(scan, self.params.max_age_s))
            if found is not None and found[0] == walk.floor:
                leg = int(np.searchsorted(t_ns, scan.t_ns, side="right"))
                velocity = (xy[leg] - xy[leg - 1]) / ((t_ns[leg] - t_ns[leg - 1]) * 1e-9)
                place = xy[leg - 1] + velocity * (scan.t_ns - t_ns[leg - 1]) * 1e-9
                rows.append([found[2], *(found[1] - place), *velocity])
        return np.array(rows).reshape(-1, 5)


def usual_lead_s(distances: Floats, errors_m: Floats, velocities_mps: Floats) -> float:
    """Return how much later than its scan the instant is that a fix usually describes, seconds; often not nought.

    Phones date readings early or late, report old ones again, and surveyors tap late: what of all this does not cancel
    between survey and use shows as an error along the way, e = τ·v. The better half of the fixes is asked, by least
    squares: τ = Σ e·v / Σ v·v. Beyond two seconds nothing is believed.

    Args:
        distances: (n,) of the nearest neighbour in signal space.
        errors_m, velocities_mps: (n, 2).
    """
    if len(distances) < _BINS:
        return 0.0
    good = distances <= np.median(distances)
    e, v = errors_m[good], velocities_mps[good]
    return float(np.clip((e * v).sum() / max(float((v * v).sum()), 1.0), -2.0, 2.0))


def error_by_distance(distances: Floats, errors_m: Floats, otherwise_m: float) -> dict[str, Floats]:
    """Return σ per axis as a rising function of the distance in signal space, tabulated at a few quantiles.

    Args:
        distances, errors_m: (n,) float64, of fixes whose error is known.
        otherwise_m: σ where there are too few of them to learn from.
    """
    if len(distances) < 4 * _BINS:
        return {"distance": np.ones(1), "sigma_m": np.full(1, otherwise_m)}
    bins = np.array_split(np.argsort(distances, kind="stable"), _BINS)
    middle = np.array([np.median(distances[b]) for b in bins])
    sigma_m = np.array([np.sqrt(0.5 * np.mean(errors_m[b] ** 2)) for b in bins])
    steps = np.flatnonzero(np.diff(middle, prepend=-1.0) > 0)
    return {"distance": middle[steps], "sigma_m": np.maximum.accumulate(np.maximum(sigma_m, 0.1))[steps]}


def _by_chain(survey: Survey) -> list[tuple[int, SurveyWalk]]:
    """Return each walk with its chain's number in the radio map: chains are numbered in the order of their names."""
    numbers = {chain: n for n, chain in enumerate(sorted({walk.chain for walk in survey.walks}))}
    return [(numbers[walk.chain], walk) for walk in survey.walks if len(walk.truth) > 1]
