"""The systems of [sun2013] as pipelines, and how they run on results instead of a stream.

A result from each N samples, one a second, without motion sensors; fingerprints and filters are called as the kernel
would call them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from tickfix.api import Fix, Floats, Floor, Motion, Observation, Prior, Readings, Recording, Scan, SiteError, frozen
from tickfix.config import Pipeline, Registry, parse_config
from tickfix.evaluation import RunSetup, prepare
from tickfix.replay import survey_and_train
from tickfix_papers.sun2013 import twin


def survey_twin(
    recordings: Iterable[Recording],
    floors: Sequence[Floor],
    pipelines: str,
    registry: Registry,
    *,
    name: str,
    seed: int,
    spacing_m: float = 2.0,
    reach_m: float = 3.0,
    trained: bool = True,
) -> RunSetup:
    """Survey a twin and build pipelines for it.

    Args:
        recordings: of the survey, with truth.
        floors: of the twin.
        pipelines: a TOML configuration, see :mod:`tickfix.config`.
        registry: what the plugins offer.
        name: of the site; errors in the configuration name it, too.
        seed: of training and of the filters' random streams.
        spacing_m, reach_m: see :func:`tickfix.site.survey_builder.survey_recordings`; points that a surveyor stood at
            stay as they are
            with a spacing below 0.7 of their distance and a reach of 0.
        trained: whether algorithms learn from the survey what they can; without, they run untrained.

    Raises:
        SiteError: when something cannot be trained.
        TickfixError: when a pipeline cannot be parsed or built.
    """
    parsed = parse_config(pipelines, name, registry)
    config = replace(parsed, kernel=replace(parsed.kernel, seed=seed))
    surveyed = survey_and_train(
        recordings,
        floors,
        config.pipelines if trained else (),
        name=name,
        seed=seed,
        spacing_m=spacing_m,
        reach_m=reach_m,
    )
    if surveyed.problems:
        raise SiteError(f"{name}: {'; '.join(surveyed.problems)}")
    return prepare(surveyed.site, config)


KNN: Final = "KNN"
WKNN: Final = "WKNN"
FNCC: Final = "FNCC"
FINGERPRINTS: Final = (KNN, WKNN, FNCC)
FINGERPRINT_ONLY: Final = ""
MAP: Final = " + Map"
KF: Final = " + KF"
KMF: Final = " + KMF"
FILTERS: Final = (FINGERPRINT_ONLY, MAP, KF, KMF)
HIGH_ACCELERATION: Final = "0.5 m/s²: "
"""Before the name of a system whose filter lets the walker accelerate ten times as much as printed."""

NCC: Final = "NCC (1), blocks"
NCC_OF_MEANS: Final = "NCC (1), means"
LITERAL: Final = "FNCC (6) as printed"
FNCC_OF_MEANS: Final = "FNCC (6), means"
LITERAL_OF_MEANS: Final = "FNCC (6) as printed, means"
POOLED: Final = "FNCC (6), mean of blocks"

# A sample of the survey is one scan of half a second. However little is heard, there is a result.
_SHARED: Final = "min_readings = 1"
_CORRELATION: Final = f"{_SHARED}, sample_s = 0.5"
_METHODS: Final = {
    KNN: f'{{ use = "knn", preset = "sun2013", {_SHARED} }}',
    WKNN: f'{{ use = "wknn", preset = "sun2013", {_SHARED} }}',
    FNCC: f'{{ use = "fncc", preset = "sun2013", {_CORRELATION} }}',
}
_VARIANT_FINGERPRINTS: Final = {
    POOLED: f'{{ use = "fncc", preset = "sun2013", pool = "mean", {_CORRELATION} }}',
    FNCC_OF_MEANS: f'{{ use = "fncc", preset = "sun2013", reference = "mean", {_CORRELATION} }}',
    LITERAL: f'{{ use = "fncc", preset = "literal", {_CORRELATION} }}',
    LITERAL_OF_MEANS: f'{{ use = "fncc", preset = "literal", reference = "mean", {_CORRELATION} }}',
    NCC: f'{{ use = "ncc", preset = "sun2013", {_CORRELATION} }}',
    NCC_OF_MEANS: f'{{ use = "ncc", preset = "sun2013", reference = "mean", {_CORRELATION} }}',
}


def configuration(plan: Path, plan_with_walkways: Path) -> str:
    """Return the TOML of all pipelines; the two drawings are those of eq. (7)."""
    image = f'{{ use = "image", preset = "sun2013", plan = "{plan}", plan_with_walkways = "{plan_with_walkways}" }}'
    filters = {
        FINGERPRINT_ONLY: 'filter = "fixes"',
        MAP: f'filter = {{ use = "fixes", map_matching = true }}\nmap = {image}',
        KF: _kalman(),
        KMF: f"{_kalman()}\nmap = {image}",
    }
    tables = [
        _pipeline_table(f"{name}{filter_name}", method, filter_)
        for filter_name, filter_ in filters.items()
        for name, method in _METHODS.items()
    ]
    tables += [_pipeline_table(name, method) for name, method in _VARIANT_FINGERPRINTS.items()]
    agile = _kalman(", acceleration_mps2 = 0.5")
    tables.append(_pipeline_table(f"{HIGH_ACCELERATION}{FNCC}{KF}", _METHODS[FNCC], agile))
    tables.append(_pipeline_table(f"{HIGH_ACCELERATION}{FNCC}{KMF}", _METHODS[FNCC], f"{agile}\nmap = {image}"))
    for n in twin.SURFACE_N:
        fncc = f'{{ use = "fncc", preset = "sun2013", n = {n}, {_CORRELATION} }}'
        tables.append(_pipeline_table(surface_system(FNCC, n, twin.POINTS_AVERAGED), fncc))
        for k in twin.SURFACE_K:
            knn = f'{{ use = "knn", preset = "sun2013", n = {n}, k = {k}, {_SHARED} }}'
            tables.append(_pipeline_table(surface_system(KNN, n, k), knn))
    return "\n".join(tables)


def surface_system(fingerprint: str, n: int, k: int) -> str:
    """Return the name of the pipeline for one point of figure 4."""
    return f"{fingerprint} N={n} K={k}"


def _kalman(parameters: str = "") -> str:
    return f'filter = {{ use = "kalman-map", preset = "sun2013"{parameters} }}'


def _pipeline_table(name: str, fingerprint: str, filter_: str = 'filter = "fixes"') -> str:
    return f'[pipelines."{name}"]\nfingerprint = {fingerprint}\n{filter_}\n'


STEP_NS: Final = round(twin.STEP_S * 1e9)


def readings_window(scans: Sequence[Scan], place: int) -> Readings:
    """Return scans as the window of the ``place``-th result of a pass: the last of them ends at its instant."""
    last = len(scans) - 1
    times = [place * STEP_NS - (last - n) * STEP_NS // twin.ONLINE_SAMPLES for n in range(len(scans))]
    rows = sorted(
        (n, transmitter, rssi_dbm)
        for n, scan in enumerate(scans)
        for transmitter, rssi_dbm in zip(scan.transmitters, scan.rssi_dbm.tolist(), strict=True)
    )
    return Readings(
        t_ns=times[-1],
        transmitters=tuple(row[1] for row in rows),
        rssi_dbm=frozen([row[2] for row in rows]),
        heard_ns=frozen([times[row[0]] for row in rows], np.int64),
        scan=frozen([row[0] for row in rows], np.int64),
        scan_t_ns=tuple(times),
    )


def fingerprint_algorithm(pipeline: Pipeline) -> Any:
    """Return the algorithm of a pipeline's fingerprint."""
    assert pipeline.fingerprint is not None  # noqa: S101 - each of ours has one
    return pipeline.fingerprint.algorithm


def filter_track(pipeline: Pipeline, fixes: Sequence[Fix | None]) -> Floats:
    """Return the filter's estimates (T, 2) at the instants of T results, metres; NaN before the first."""
    filter_: Any = pipeline.filter.algorithm
    rng = np.random.default_rng(0)  # none of these filters draws
    state: Any = None
    positions = np.full((len(fixes), 2), np.nan)
    for n, fix in enumerate(fixes):
        observation = Observation(t_ns=n * STEP_NS, source="fingerprint", fix=fix)
        if state is None:
            state = filter_.start(Prior(t_ns=n * STEP_NS, fix=fix, observation=observation), rng)
        else:
            state, _ = filter_.step(state, Motion.unknown((n - 1) * STEP_NS, n * STEP_NS), [observation], rng)
        if state is not None:
            positions[n] = filter_.estimate(state).xy
    return positions


def perfect_fixes(xy: Floats) -> list[Fix]:
    """Return the results of a fingerprint that never errs, at test points (T, 2)."""
    return [Fix(t_ns=n * STEP_NS, floor=twin.FLOOR, xy=place) for n, place in enumerate(xy)]


def position_errors(positions: Floats, xy: Floats) -> Floats:
    """Return the distances of (…, T, 2) from the test points (T, 2)."""
    away = positions - xy
    found: Floats = np.hypot(away[..., 0], away[..., 1])
    return found
