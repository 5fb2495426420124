"""Fingerprint ``elm-knn``: an extreme learning machine names the K points, their distances weigh them.

RecordingFile: [jiang2015] section 7. The classes are the reference points, the features the RSS of the most frequent
access points. Eq. (20) prints (n − 1) where (K − 1) makes the weights sum to one; n counts access points there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from tickfix.api import Bools, Context, Floats, Ints, Preset, RadioMap, Readings, Rng, TrainedModel, parameter
from tickfix.toolkit.extreme_learning import classifier_output_weights, hidden_layer
from tickfix.toolkit.surveyed_fingerprint import MIN_DISTANCE, SurveyedFingerprint, SurveyedParams
from tickfix_fingerprint.rss_matrices import RssBlocks

_UNIT_DB = 50.0  # brings the features to about 0…1, where a sigmoid is neither straight nor flat


@dataclass(frozen=True)
class ElmKnnParams(SurveyedParams):
    """Parameters of ``elm-knn``."""

    k: Annotated[int, parameter("K, points averaged", source="[jiang2015] (20)", ge=1, trains=True)] = 5
    missing_dbm: Annotated[
        float,
        parameter(
            "stands for what is not heard, and for what is weaker",
            unit="dBm",
            source="[jiang2015] section 7",
            lt=0,
            trains=True,
        ),
    ] = -95.0
    access_points: Annotated[
        int, parameter("most frequent access points used", source="[jiang2015] section 7", ge=1, trains=True)
    ] = 1000
    hidden: Annotated[int, parameter("hidden nodes, L", source="[jiang2015] (4)", ge=1, trains=True)] = 500
    ridge: Annotated[float, parameter("of the least squares that train the output layer", gt=0, trains=True)] = 1.0
    sample_s: Annotated[
        float, parameter("readings of a point within this time can be one survey sample", unit="s", gt=0, trains=True)
    ] = 4.0


class ElmKnn(SurveyedFingerprint[ElmKnnParams]):
    """Weighted mean of the K points that a trained classifier takes a scan for.

    Without a trained classifier the K candidates are the points nearest in signal space.
    """

    name = "elm-knn"
    source = "[jiang2015] section 7, eq. (20)"
    Params = ElmKnnParams
    presets: ClassVar[Mapping[str, Preset]] = {
        "jiang2015": Preset(
            "[jiang2015] section 7; it prints neither K nor a size of the classifier", {"missing_dbm": -95.0}
        )
    }

    def __init__(
        self,
        params: ElmKnnParams,
        context: Context,
        trained: TrainedModel | None = None,
        sample_mask: Bools | None = None,
    ) -> None:
        """Average the survey over the frequent access points, and take the classifier if there is one."""
        super().__init__(params, context, trained, sample_mask)
        samples = _survey_samples(params, self.radio_map, sample_mask)
        self._xy, self._floor = samples.xy, samples.floor
        self._elm = trained if trained is not None and "beta" in trained else None
        self._frequent = _frequent(samples, params.access_points) if self._elm is None else self._elm["access_points"]
        per_point = np.add.reduceat(self._rows(samples), samples.starts, axis=0) if len(self._xy) else np.zeros((0, 0))
        count = np.diff(np.append(samples.starts, len(samples.point)))
        self._means = per_point / count[:, None]

    def nearest(self, window: Readings) -> tuple[str, Floats, float] | None:
        """Return floor, place and the distance in dB of the nearest candidate, eq. (20)."""
        rss = self._heard(window)[self._frequent]
        if np.count_nonzero(rss) < self.params.min_readings or len(self._xy) == 0:
            return None
        if self._elm is None:
            outputs = -((self._means - rss) ** 2).sum(axis=1)
        else:
            h = hidden_layer(rss[None] / _UNIT_DB, self._elm["a"], self._elm["b"])
            outputs = (h @ self._elm["beta"])[0]
        chosen = np.argsort(-outputs, kind="stable")[: self.params.k]
        dis = np.sqrt(((self._means[chosen] - rss) ** 2).sum(axis=1))  # [jiang2015] eq. (20)
        w = distance_weights(dis)
        floors = self._floor[chosen]
        floor = int(np.bincount(floors, weights=w).argmax())
        here = floors == floor
        xy = w[here] @ self._xy[chosen[here]] / w[here].sum()
        return self.radio_map.floors[floor], xy, max(float(dis.min()), MIN_DISTANCE)

    @classmethod
    def fit_model(cls, params: ElmKnnParams, radio_map: RadioMap, sample_mask: Bools, rng: Rng) -> dict[str, Any]:
        """Train the classifier: every survey sample of a point is an example of that point."""
        samples = _survey_samples(params, radio_map, sample_mask)
        frequent = _frequent(samples, params.access_points)
        a = rng.uniform(-1.0, 1.0, (len(frequent), params.hidden))
        b = rng.uniform(-1.0, 1.0, params.hidden)
        x = samples.by_cell[frequent].T  # sparse: a sample hears few of a building's access points
        H = hidden_layer(x / _UNIT_DB, a, b)
        beta = classifier_output_weights(H, samples.point, len(samples.xy), params.ridge)
        return {"access_points": frequent, "a": a, "b": b, "beta": beta}

    def _heard(self, window: Readings) -> Floats:
        """Return the newest reading of each transmitter in the window, (T,) dB above ``missing_dbm``.

        The newest scan alone will not do: phones miss access points now and then. Taking one for out of reach moves
        the features further than any walk does.
        """
        rss = np.zeros(len(self.radio_map.transmitters))
        numbers = self.transmitter_numbers(window)
        for transmitter, rssi_dbm in zip(window.transmitters, window.rssi_dbm.tolist(), strict=True):
            i = numbers.get(transmitter)
            if i is not None and rssi_dbm == rssi_dbm:  # noqa: PLR0124 - not NaN
                rss[i] = max(rssi_dbm - self.params.missing_dbm, 0.0)  # readings come oldest first
        return rss

    def _rows(self, samples: RssBlocks) -> Floats:
        """Return the samples' features, (B, F) dB above ``missing_dbm``."""
        rows: Floats = samples.by_cell[self._frequent].toarray().T
        return rows


def distance_weights(dis: Floats) -> Floats:
    """Return the weights (K,) of neighbours at distances ``dis`` (K,) ≥ 0: ≥ 0, summing to one.

    Where all are at distance 0 (or there is one only) the equation is undefined, and all have equal weights.
    """
    K, total = len(dis), dis.sum()
    if K == 1 or total <= 0.0:
        return np.full(K, 1.0 / K)
    w: Floats = (total - dis) / ((K - 1) * total)  # [jiang2015] eq. (20)
    return np.maximum(w, 0.0)


def _survey_samples(params: ElmKnnParams, radio_map: RadioMap, sample_mask: Bools | None) -> RssBlocks:
    return RssBlocks(
        radio_map, 1, means=False, missing_dbm=params.missing_dbm, sample_s=params.sample_s, sample_mask=sample_mask
    )


def _frequent(samples: RssBlocks, count: int) -> Ints:
    """Return the numbers of the ``count`` transmitters that most samples heard, the most frequent first."""
    heard = np.diff(samples.by_cell.indptr)
    order: Ints = np.argsort(-heard, kind="stable")[:count].astype(np.int64)
    return order
