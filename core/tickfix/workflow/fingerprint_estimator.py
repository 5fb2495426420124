"""Fingerprints in scikit-learn's manners: an object with fit, predict and score, on arrays and on walks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from types import MappingProxyType
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tickfix.api import Bools, ConfigError, Context, Fix, Floats, Floor, Readings, Recording, Scan, Survey, frozen
from tickfix.config import AlgorithmChoice
from tickfix.evaluation.error_metrics import ErrorStatistics
from tickfix.replay.site_survey import site_context, train
from tickfix.site import FingerprintTable, Site, split_into_legs
from tickfix.site.waypoints import to_survey_walk
from tickfix.toolkit.surveyed_fingerprint import window_of_last_scans
from tickfix.workflow.pipelines import resolve_pipeline, warn_each
from tickfix.workflow.sites import FingerprintSource, as_radio_map, as_table
from tickfix.workflow.walks import WalkSource, find_walks

TestData: TypeAlias = FingerprintTable | WalkSource | Iterable[WalkSource] | Any
"""A table, CSV file or data frame of fingerprints; or walks, see :meth:`FingerprintEstimator.evaluate`."""


class FingerprintEstimator:
    """A fingerprint as an estimator: ``fit`` on a table of fingerprints, ``predict`` places, ``score`` against truth.

    It keeps to scikit-learn's conventions (parameters by name in the constructor and in ``get_params``, ``fit`` returns
    the estimator, greater scores are better) without needing that package.

    Args:
        algorithm: name of a registered fingerprint, or a class.
        seed: of training.
        params: of the algorithm, as in a pipeline; ``preset`` among them.

    >>> import numpy as np, tickfix
    >>> rssi = np.array([[-40.0, -70.0, -80.0], [-70.0, -40.0, -75.0], [-80.0, -75.0, -40.0]])
    >>> places = np.array([[0.0, 0.0], [10.0, 0.0], [5.0, 8.0]])
    >>> wknn = tickfix.FingerprintEstimator("wknn", k=1).fit(rssi, places)
    >>> wknn.predict([[-42.0, -69.0, -81.0]]).tolist()
    [[0.0, 0.0]]
    """

    def __init__(self, algorithm: str | type[Any] = "wknn", *, seed: int = 0, **params: Any) -> None:
        """Check the parameters; nothing is built before :meth:`fit`.

        Raises:
            ConfigError: for an unknown algorithm or parameter.
        """
        self.algorithm = algorithm
        self.seed = seed
        self._params = params
        self._choice = self._checked_choice()
        self._built: Any = None
        self.transmitters: tuple[str, ...] = ()

    def get_params(self, deep: bool = True) -> dict[str, Any]:  # noqa: ARG002, FBT001, FBT002 - scikit-learn's signature
        """Return the constructor's arguments."""
        return {"algorithm": self.algorithm, "seed": self.seed, **self._params}

    def set_params(self, **params: Any) -> Self:
        """Change the constructor's arguments; fit again afterwards."""
        self.algorithm = params.pop("algorithm", self.algorithm)
        self.seed = params.pop("seed", self.seed)
        self._params |= params
        self._choice = self._checked_choice()
        self._built = None
        return self

    def fit(self, x: Any, y: ArrayLike | None = None, **table: Any) -> Self:
        """Build the algorithm for fingerprints at known places, trained where it learns.

        Args:
            x: (n, t) dBm, NaN where a transmitter was not heard; or, without ``y``, a table, radio map, CSV file or
                data frame as :func:`tickfix.site_from_fingerprints` takes it.
            y: (n, 2) metres.
            table: ``floors``, ``transmitters``, ``groups`` and ``not_heard`` of
                :meth:`tickfix.FingerprintTable.of`; without ``y`` the columns of ``from_frame``.
        """
        source = FingerprintTable.of(x, y, **table) if y is not None else x
        radio_map = as_radio_map(source) if y is not None else as_radio_map(x, **table)
        floors = tuple(Floor(name=name) for name in radio_map.floors)
        context = Context(floors=MappingProxyType({f.name: f for f in floors}), radio_map=radio_map)
        models: Mapping[str, Any] = {}
        if hasattr(self._choice.offer.cls, "train"):
            data = Survey(floors=floors, radio_map=radio_map, walks=())
            models, problems = train([self._choice], data, self.seed)
            warn_each(problems)
        named = source.transmitters if isinstance(source, FingerprintTable) else radio_map.transmitters
        return self._build(context, models, named)

    def fit_site(self, site: Site) -> Self:
        """Build the algorithm for a site, with the model that was trained when the site was surveyed."""
        return self._build(site_context(site), site.models, site.radio_map.transmitters)

    def locate(self, x: FingerprintTable | ArrayLike) -> list[Fix | None]:
        """Return the fix of each fingerprint, None where its readings do not determine one.

        Args:
            x: (n, t) dBm, the columns being those of ``fit``; or a table, whose columns are matched by their ids.
        """
        algorithm = self._algorithm()
        table = x if isinstance(x, FingerprintTable) else None
        rssi = table.rssi_dbm if table is not None else np.atleast_2d(np.asarray(x, dtype=np.float64))
        names = table.transmitters if table is not None else self.transmitters
        if rssi.shape[1] != len(names):
            raise ConfigError("x", f"{rssi.shape[1]} columns", f"{len(names)}, one for each transmitter of fit")
        return [algorithm.step(algorithm.start(), _readings(row, names))[1].fix for row in rssi]

    def predict(self, x: FingerprintTable | ArrayLike) -> Floats:
        """Return (n, 2) metres: the place of each fingerprint, NaN where its readings do not determine one."""
        fixes = self.locate(x)
        return np.array([(np.nan, np.nan) if fix is None else fix.xy for fix in fixes]).reshape(-1, 2)

    def predict_floor(self, x: FingerprintTable | ArrayLike) -> NDArray[np.str_]:
        """Return (n,) the name of each fingerprint's floor, empty where its readings do not determine one."""
        return np.array(["" if fix is None else fix.floor for fix in self.locate(x)], dtype=np.str_)

    def score(self, x: Any, y: ArrayLike | None = None) -> float:
        """Return the negated mean error in metres over the fingerprints that were located; greater is better.

        NaN where none was. A table holds its own truth; :meth:`evaluate` says how many were located.
        """
        table = x if y is None else FingerprintTable.of(x, y, transmitters=self.transmitters)
        return 0.0 - float(self.evaluate(table).mean)

    def evaluate(self, test: TestData) -> FingerprintEvaluation:
        """Compare fixes with the truth.

        Args:
            test: a table, CSV file or data frame of fingerprints; or walks with waypoints, whose scans are located one
                by one with the windows that the algorithm asks for, and compared with the place at the time of the fix.
        """
        rows = list(self._rows(test))
        return FingerprintEvaluation(
            algorithm=self._choice.offer.name,
            error_m=frozen([np.nan if fix is None else np.hypot(*(fix.xy - xy)) for fix, _, xy in rows]),
            floor_right=frozen([fix is not None and fix.floor == floor for fix, floor, _ in rows], np.bool_),
        )

    def _rows(self, test: TestData) -> Iterator[tuple[Fix | None, str, Floats]]:
        path = isinstance(test, (str, PathLike))
        if isinstance(test, FingerprintTable) or hasattr(test, "columns") or (path and str(test).endswith(".csv")):
            table = as_table(test)
            yield from zip(self.locate(table), table.floors, table.xy, strict=True)
            return
        for source in find_walks(test):
            yield from self._rows_of_walk(source.read())

    def _rows_of_walk(self, recording: Recording) -> Iterator[tuple[Fix | None, str, Floats]]:
        if not recording.truth:
            return
        algorithm = self._algorithm()
        window = algorithm.window
        walk, legs = to_survey_walk(recording, recording.name), split_into_legs(recording.truth)
        state = algorithm.start()
        for number, scan in enumerate(walk.scans):
            if scan.source not in window.sources:
                continue
            readings = window_of_last_scans(walk, number, window.scans, window.seconds)
            state, observation = algorithm.step(state, readings)
            t_ns = np.array([scan.t_ns if observation.fix is None else observation.fix.t_ns])
            for leg in legs:
                if leg.covers(t_ns)[0]:
                    yield observation.fix, leg.floor, leg.at(t_ns)[0]

    def _checked_choice(self) -> AlgorithmChoice:
        stages = {"fingerprint": {"use": self.algorithm, **self._params}, "filter": "fixes"}
        choice = resolve_pipeline(stages).pipelines[0].fingerprint
        if choice is None:
            raise ConfigError("algorithm", repr(self.algorithm), "a fingerprint")
        return choice

    def _build(self, context: Context, models: Mapping[str, Any], transmitters: Sequence[str]) -> Self:
        choice = self._choice
        self._built = choice.offer.cls(choice.params, context, models.get(choice.model))
        self.transmitters = tuple(transmitters)
        return self

    def _algorithm(self) -> Any:
        if self._built is None:
            raise ConfigError("FingerprintEstimator", "no fingerprints", "fit or fit_site before")
        return self._built


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class FingerprintEvaluation:
    """The errors of a fingerprint on n tests.

    Attributes:
        algorithm: its name.
        error_m: (n,) float64, metres, NaN where a test was not located.
        floor_right: (n,) bool, False where a test was not located.
    """

    algorithm: str
    error_m: Floats
    floor_right: Bools

    @property
    def located(self) -> Bools:
        """(n,) bool: which tests were located."""
        return np.isfinite(self.error_m)

    @property
    def statistics(self) -> ErrorStatistics:
        """Mean, percentiles and RMSE of the errors of the located tests."""
        return ErrorStatistics.of(self.error_m[self.located])

    @property
    def mean(self) -> float:
        """Mean error of the located tests, metres; NaN where none was located."""
        mean_m = self.statistics.mean_m
        return np.nan if mean_m is None else mean_m

    def __len__(self) -> int:
        """Return n."""
        return len(self.error_m)

    def __repr__(self) -> str:
        """Return one line: mean error, share located, share on the right floor."""
        located = int(self.located.sum())
        right = f", floor right {100 * self.floor_right[self.located].mean():.1f} %" if located else ""
        return f"<{self.algorithm}: mean error {self.mean:.2f} m, {located} of {len(self)} located{right}>"


def evaluate_fingerprint(
    algorithm: str | type[Any], train: Site | FingerprintSource, test: TestData, *, seed: int = 0, **params: Any
) -> FingerprintEvaluation:
    """Fit a fingerprint on one set and evaluate it on another.

    Args:
        algorithm: name of a registered fingerprint, or a class.
        train: a site, or fingerprints as :meth:`FingerprintEstimator.fit` takes them, ``(x, y)`` too.
        test: see :meth:`FingerprintEstimator.evaluate`, ``(x, y)`` too.
        seed: of training.
        params: of the algorithm.

    Raises:
        ConfigError: for an unknown algorithm or parameter.
    """
    estimator = FingerprintEstimator(algorithm, seed=seed, **params)
    if isinstance(train, Site):
        estimator.fit_site(train)
    elif isinstance(train, tuple):
        estimator.fit(*train)
    else:
        estimator.fit(train)
    if isinstance(test, tuple) and len(test) == 2 and not isinstance(test[0], (Recording, str, PathLike)):
        return estimator.evaluate(FingerprintTable.of(*test, transmitters=estimator.transmitters))
    return estimator.evaluate(test)


def _readings(row: Floats, transmitters: Sequence[str]) -> Readings:
    heard = np.flatnonzero(np.isfinite(row)).tolist()
    scan = Scan(
        transmitters=tuple(transmitters[i] for i in heard),
        rssi_dbm=row[heard],
        heard_ns=np.zeros(len(heard), dtype=np.int64),
        t_ns=0,
    )
    return Readings.of(scan)
