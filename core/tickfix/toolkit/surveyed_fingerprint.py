"""Base of fingerprints that learn from a survey.

The error of a fix as a function of the distance in signal space, and the time offset between a scan and the position it
describes, both cross-validated over chains of walks; and windows of several scans assembled from a survey walk as the
kernel assembles them on line.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Final, TypeVar

import numpy as np

from tickfix.api import (
    Bools,
    Context,
    Fix,
    Floats,
    RadioMap,
    Readings,
    Rng,
    StatelessFingerprint,
    Survey,
    SurveyWalk,
    TrainedModel,
    Window,
    frozen,
    parameter,
)


def window_of_last_scans(walk: SurveyWalk, number: int, scans: int, max_age_s: float) -> Readings:
    """Return the window of the last ``scans`` scans that ends with the walk's ``number``-th.

    Each reading stands at its first delivery; those older than ``max_age_s`` are left out.
    """
    last = walk.scans[number]
    oldest_ns = last.t_ns - round(max_age_s * 1e9)
    chosen = [s for s in walk.scans[: number + 1] if s.source == last.source and s.t_ns >= oldest_ns][-scans:]
    seen: set[tuple[str, int]] = set()
    rows: list[tuple[int, int, str, float]] = []
    for place, scan in enumerate(chosen):
        for transmitter, rssi_dbm, heard_ns in zip(
            scan.transmitters, scan.rssi_dbm.tolist(), scan.heard_ns.tolist(), strict=True
        ):
            if heard_ns >= oldest_ns and (transmitter, heard_ns) not in seen:
                seen.add((transmitter, heard_ns))
                rows.append((place, heard_ns, transmitter, rssi_dbm))
    rows.sort()
    return Readings(
        t_ns=last.t_ns,
        transmitters=tuple(row[2] for row in rows),
        rssi_dbm=frozen([row[3] for row in rows]),
        heard_ns=frozen([row[1] for row in rows], np.int64),
        scan=frozen([row[0] for row in rows], np.int64),
        scan_t_ns=tuple(scan.t_ns for scan in chosen),
        source=last.source,
    )


_FOLDS: Final = 6
_BINS: Final = 6
MIN_DISTANCE: Final = 1e-6
"""The smallest distance in signal space; its logarithm is taken."""


@dataclass(frozen=True)
class SurveyedParams:
    """Parameters that every fingerprint has that finds its points in a survey."""

    max_age_s: Annotated[float, parameter("greatest age of a reading", unit="s", gt=0, trains=True)] = 3.0
    missing_dbm: Annotated[
        float, parameter("stands for a transmitter that is not heard", unit="dBm", lt=0, trains=True)
    ] = -100.0
    min_readings: Annotated[int, parameter("fewer known transmitters than this give no fix", ge=1)] = 3
    sigma_m: Annotated[float, parameter("error per axis where no survey taught one", unit="m", gt=0)] = 5.0


P = TypeVar("P", bound=SurveyedParams)


class SurveyedFingerprint(StatelessFingerprint[P]):
    """Base: subclasses find the nearest points in signal space; errors of fixes are learnt from the survey."""

    def __init__(
        self, params: P, context: Context, trained: TrainedModel | None = None, sample_mask: Bools | None = None
    ) -> None:
        """Take what was learnt; ``sample_mask`` (S,) bool, the samples of the radio map to use, is for subclasses."""
        super().__init__(params, context, trained)
        if context.radio_map is None:
            raise ValueError("the site has no radio map")
        self.radio_map: RadioMap = context.radio_map
        self.sample_mask = sample_mask
        self._distances, self._sigmas_m, self._lead_ns = np.ones(1), np.full(1, params.sigma_m), 0
        if trained is not None and "distance" in trained:
            self._distances, self._sigmas_m = trained["distance"], trained["sigma_m"]
            self._lead_ns = round(float(trained["lead_s"]) * 1e9)

    @abstractmethod
    def nearest(self, window: Readings) -> tuple[str, Floats, float] | None:
        """Return floor, place (2,) and distance > 0 of the nearest point in signal space; None without enough readings.

        The distance is in whatever unit the method compares; it only has to grow with what a fix is wrong by.
        """

    def transmitter_numbers(self, window: Readings) -> Mapping[str, int]:
        """Return the radio map's number of each id of the window's source; empty for a source not asked for.

        The same id of another source is another transmitter.
        """
        return self._numbers_by_source.get(window.source, {})

    @cached_property
    def _numbers_by_source(self) -> Mapping[str, Mapping[str, int]]:
        return {source: self.radio_map.transmitter_numbers(source) for source in self.window.sources}

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

    def survey_window(self, walk: SurveyWalk, n: int) -> Readings:
        """Return the window that ends with the walk's ``n``-th scan, as ``train`` shows it to the method."""
        return Readings.of(walk.scans[n], self.params.max_age_s)

    @classmethod
    def fit_model(cls, params: P, radio_map: RadioMap, sample_mask: Bools, rng: Rng) -> dict[str, Any]:  # noqa: ARG003
        """Return the model that locating itself needs, learnt from the samples ``sample_mask`` (S,) bool; most need
        none.
        """
        return {}

    @classmethod
    def train(cls, params: P, survey: Survey, rng: Rng) -> TrainedModel:
        """Learn the method's own model, and two things of a fix: which instant it describes, and how far off it is.

        Chains of walks are assigned to folds, and each fold's scans are located with the samples of the others only; so
        places that no other walk came near show the error of fixes outside the survey.
        """
        all_samples = np.ones(len(survey.radio_map.sample_point), np.bool_)
        model = cls.fit_model(params, survey.radio_map, all_samples, rng)
        rows: list[Floats] = []
        for fold in range(_FOLDS):
            sample_mask = survey.radio_map.sample_chain % _FOLDS != fold
            walks = [walk for n, walk in _walks_with_chain_number(survey) if n % _FOLDS == fold]
            if not walks or not sample_mask.any():
                continue
            fitted = cls.fit_model(params, survey.radio_map, sample_mask, rng)
            method = cls(params, Context(radio_map=survey.radio_map), fitted, sample_mask)
            rows += [method.fix_errors(walk) for walk in walks]
        found = np.concatenate([np.zeros((0, 5)), *rows])
        distance, error, velocity = found[:, 0], found[:, 1:3], found[:, 3:5]
        lead_s = estimate_lead_s(distance, error, velocity)
        model["lead_s"] = np.array(lead_s)
        return model | error_by_distance(distance, np.hypot(*(error - lead_s * velocity).T), params.sigma_m)

    def fix_errors(self, walk: SurveyWalk) -> Floats:
        """Return (n, 5) for the scans between a walk's first and last waypoint.

        Columns: distance in signal space; error of the fix at the scan's time, x and y, metres; velocity, x and y, m/s.
        """
        t_ns = np.array([truth.t_ns for truth in walk.truth], np.float64)
        xy = np.array([truth.xy for truth in walk.truth])
        rows = []
        for n, scan in enumerate(walk.scans):
            if scan.source not in self.window.sources or not t_ns[0] <= scan.t_ns < t_ns[-1]:
                continue
            found = self.nearest(self.survey_window(walk, n))
            if found is not None and found[0] == walk.floor:
                leg = int(np.searchsorted(t_ns, scan.t_ns, side="right"))
                velocity = (xy[leg] - xy[leg - 1]) / ((t_ns[leg] - t_ns[leg - 1]) * 1e-9)
                place = xy[leg - 1] + velocity * (scan.t_ns - t_ns[leg - 1]) * 1e-9
                rows.append([found[2], *(found[1] - place), *velocity])
        return np.array(rows).reshape(-1, 5)


def estimate_lead_s(distances: Floats, errors_m: Floats, velocities_mps: Floats) -> float:
    """Return the typical time from a scan to the instant that its fix describes, seconds; often not zero.

    Phones date readings early or late, report old ones again, and surveyors tap late: what of all this does not cancel
    between survey and use shows as an error along the direction of walking, e = τ·v. It is estimated from the better
    half of the fixes by least squares, τ = Σ e·v / Σ v·v, and limited to two seconds.

    Args:
        distances: (n,) of the nearest neighbour in signal space.
        errors_m, velocities_mps: (n, 2).
    """
    if len(distances) < _BINS:
        return 0.0
    good = distances <= np.median(distances)
    e, v = errors_m[good], velocities_mps[good]
    return float(np.clip((e * v).sum() / max(float((v * v).sum()), 1.0), -2.0, 2.0))


def error_by_distance(distances: Floats, errors_m: Floats, default_m: float) -> dict[str, Floats]:
    """Return σ per axis as a rising function of the distance in signal space, tabulated at a few quantiles.

    Args:
        distances, errors_m: (n,) float64, of fixes whose error is known.
        default_m: σ where there are too few of them to learn from.
    """
    if len(distances) < 4 * _BINS:
        return {"distance": np.ones(1), "sigma_m": np.full(1, default_m)}
    bins = np.array_split(np.argsort(distances, kind="stable"), _BINS)
    middle = np.array([np.median(distances[b]) for b in bins])
    sigma_m = np.array([np.sqrt(0.5 * np.mean(errors_m[b] ** 2)) for b in bins])
    steps = np.flatnonzero(np.diff(middle, prepend=-1.0) > 0)
    return {"distance": middle[steps], "sigma_m": np.maximum.accumulate(np.maximum(sigma_m, 0.1))[steps]}


def _walks_with_chain_number(survey: Survey) -> list[tuple[int, SurveyWalk]]:
    """Return each walk with its chain's number in the radio map: chains are numbered in the order of their names."""
    numbers = {chain: n for n, chain in enumerate(sorted({walk.chain for walk in survey.walks}))}
    return [(numbers[walk.chain], walk) for walk in survey.walks if len(walk.truth) > 1]
