"""One seed of [sun2013]'s experiment.

All systems on the same samples, variants of the correlation, and measured causes of what does not hold (added after the
first results; they decide no claim).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from tickfix.api import Bools, Fix, Floats, Readings, Scan
from tickfix.config import Pipeline, Registry
from tickfix_papers.sun2013 import systems, twin
from tickfix_papers.sun2013.systems import (
    FINGERPRINTS,
    FNCC,
    HIGH_ACCELERATION,
    KF,
    KMF,
    filter_track,
    fingerprint_algorithm,
    perfect_fixes,
    position_errors,
    readings_window,
    survey_twin,
)
from tickfix_papers.sun2013.twin import Twin, draw_twin

_FNCC_VARIANTS = (
    systems.FNCC,
    systems.POOLED,
    systems.FNCC_OF_MEANS,
    systems.LITERAL,
    systems.LITERAL_OF_MEANS,
)


def variant_errors(
    built: Mapping[str, Pipeline], windows: Sequence[Sequence[Readings]], xy: Floats
) -> dict[str, Floats]:
    """Return the errors of each reading of FNCC: (passes, T)."""
    return {name: fingerprint_errors(built[name], windows, xy) for name in _FNCC_VARIANTS}


def fingerprint_errors(pipeline: Pipeline, windows: Sequence[Sequence[Readings]], xy: Floats) -> Floats:
    """Return the errors of a fingerprint alone: (passes, T)."""
    fingerprint = fingerprint_algorithm(pipeline)
    return position_errors(np.array([[fingerprint.locate(query).xy for query in one] for one in windows]), xy)


def same_points(built: Mapping[str, Pipeline], windows: Sequence[Sequence[Readings]]) -> dict[str, float]:
    """Return how often variants choose the K points of eq. (1), per cent.

    The plain NCC compares block by block and takes its time: with blocks it is asked some queries only, and the literal
    form, which differs from the signed one as it does from eq. (1), is compared with that one.
    """
    every = [query for one in windows for query in one]
    some = windows[0][:: -(-len(windows[0]) // twin.PLAIN_POINTS)]
    pairs = {
        systems.FNCC: (systems.NCC, some),
        systems.FNCC_OF_MEANS: (systems.NCC_OF_MEANS, every),
        systems.LITERAL: (systems.FNCC, every),
        systems.LITERAL_OF_MEANS: (systems.NCC_OF_MEANS, every),
    }
    shares = {}
    for name, (other, queries) in pairs.items():
        same = [_nearest_points(built[name], query) == _nearest_points(built[other], query) for query in queries]
        shares[name] = 100.0 * float(np.mean(same))
    return shares


def error_surface(built: Mapping[str, Pipeline], twin_data: Twin, name: str) -> Floats:
    """Return the mean error of KNN or FNCC by N and K, figure 4: (8, 8)."""
    rows = []
    for n in twin.SURFACE_N:
        windows = [
            [readings_window(samples[i : i + n], 0) for samples in twin_data.samples] for i in twin.SURFACE_STARTS
        ]
        positions = np.array([[_positions_by_k(built, name, n, query) for query in one] for one in windows])
        rows.append(position_errors(np.moveaxis(positions, 2, 0), twin_data.xy).mean(axis=(1, 2)))
    return np.array(rows)


def _nearest_points(pipeline: Pipeline, query: Readings) -> frozenset[int]:
    order, _ = fingerprint_algorithm(pipeline).ranked(query)
    return frozenset(order[: twin.POINTS_AVERAGED].tolist())


def _positions_by_k(built: Mapping[str, Pipeline], name: str, n: int, query: Readings) -> Floats:
    """Return the places for each K: (8, 2)."""
    if name == systems.KNN:
        of_k = [fingerprint_algorithm(built[systems.surface_system(name, n, k)]) for k in twin.SURFACE_K]
        return np.array([fingerprint.locate(query).xy for fingerprint in of_k])
    # One ranking serves every K, eq. (3).
    fingerprint = fingerprint_algorithm(built[systems.surface_system(name, n, twin.POINTS_AVERAGED)])
    order, _ = fingerprint.ranked(query)
    return np.array([fingerprint.blocks.xy[order[:k]].mean(axis=0) for k in twin.SURFACE_K])


LOUDER_DB: Final = 5.0
FILTERED: Final = tuple(f"{agile}{FNCC}{filter_name}" for agile in ("", HIGH_ACCELERATION) for filter_name in (KF, KMF))


@dataclass(frozen=True, slots=True, kw_only=True)
class Causes:
    """Measured causes of one seed.

    Attributes:
        gaps: queries, in per cent, that lack an access point which the test point usually hears.
        whole_m, gap_m: by fingerprint, mean error without and with such a gap.
        louder_m: by fingerprint, mean error on the first passes if the laptop read 5 dB more in the test.
        correlation: by fingerprint, of the errors of neighbouring results.
        lag_m: by system with FNCC and a filter, mean error of the filter where the true points feed it.
        filtered_m: by such a system, mean error on the first passes.
    """

    gaps: float
    whole_m: Mapping[str, float]
    gap_m: Mapping[str, float]
    louder_m: Mapping[str, float]
    correlation: Mapping[str, float]
    lag_m: Mapping[str, float]
    filtered_m: Mapping[str, float]


def measure_causes(
    built: Mapping[str, Pipeline],
    twin_data: Twin,
    positions: Mapping[str, Floats],
    windows: Sequence[Sequence[Readings]],
    fixes: Sequence[Sequence[Fix | None]],
) -> Causes:
    """Return the causes of one seed.

    Args:
        built: the pipelines.
        twin_data: survey and test.
        positions: by fingerprint, (passes, T, 2).
        windows, fixes: queries of the first passes, and what FNCC made of them.
    """
    gap = np.array([_missing_access_points(samples) for samples in twin_data.samples]).T
    error_m = {name: position_errors(positions[name], twin_data.xy) for name in FINGERPRINTS}
    louder = [[replace(query, rssi_dbm=query.rssi_dbm + LOUDER_DB) for query in one] for one in windows]
    return Causes(
        gaps=100.0 * float(gap.mean()),
        whole_m={name: float(error[~gap].mean()) for name, error in error_m.items()},
        gap_m={name: float(error[gap].mean()) for name, error in error_m.items()},
        louder_m={name: float(fingerprint_errors(built[name], louder, twin_data.xy).mean()) for name in FINGERPRINTS},
        correlation={name: _correlation(positions[name] - twin_data.xy) for name in FINGERPRINTS},
        lag_m={
            name: float(position_errors(filter_track(built[name], perfect_fixes(twin_data.xy)), twin_data.xy).mean())
            for name in FILTERED
        },
        filtered_m={
            name: float(position_errors(_tracks(built[name], fixes), twin_data.xy).mean()) for name in FILTERED
        },
    )


def _tracks(pipeline: Pipeline, fixes: Sequence[Sequence[Fix | None]]) -> Floats:
    return np.array([filter_track(pipeline, one) for one in fixes])


def _missing_access_points(samples: Sequence[Scan]) -> Bools:
    """Return for each pass whether its samples lack an access point that at least half of all samples have."""
    names = sorted({name for scan in samples for name in scan.transmitters})
    heard = np.array([[name in scan.transmitters for name in names] for scan in samples])
    usual = heard.mean(axis=0) >= 0.5
    passes = heard.reshape(-1, twin.ONLINE_SAMPLES, len(names)).any(axis=1)
    gap: Bools = (~passes & usual).any(axis=1)
    return gap


def _correlation(error: Floats) -> float:
    """Return the correlation of the errors (passes, T, 2) of neighbouring results."""
    neighbours = (error[:, 1:] * error[:, :-1]).sum(axis=-1).mean()
    return float(neighbours / (error**2).sum(axis=-1).mean())


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SeedRun:
    """The results of one seed.

    Attributes:
        error_m: by system, (passes, T) at the T test points.
        variant_error_m: by variant of FNCC, (passes, T) on the first passes.
        same_points: by variant, the share of queries, in per cent, in which it chooses the K points of eq. (1).
        surface_m: of KNN and FNCC, mean error by N and K: (8, 8).
        first_pass: by system, (T, 2) where it says the first pass went.
        causes: of what does not come out as the paper has it.
        failures: queries without a result, if there are any.
    """

    error_m: Mapping[str, Floats]
    variant_error_m: Mapping[str, Floats]
    same_points: Mapping[str, float]
    surface_m: Mapping[str, Floats]
    first_pass: Mapping[str, Floats]
    causes: Causes
    failures: Mapping[str, int]


def run_seed(registry: Registry, seed: int) -> SeedRun:
    """Run the experiment on the radio, survey and test of one seed."""
    twin_data = draw_twin(seed)
    built = _build_systems(registry, twin_data, seed)
    n = twin.ONLINE_SAMPLES
    windows = [
        [readings_window(samples[i * n : i * n + n], t) for t, samples in enumerate(twin_data.samples)]
        for i in range(twin.PASSES)
    ]
    fixes = {
        name: [[fingerprint_algorithm(built[name]).locate(query) for query in one] for one in windows]
        for name in systems.FINGERPRINTS
    }
    positions = {
        name + filter_name: np.array([filter_track(built[name + filter_name], found) for found in fixes[name]])
        for filter_name in systems.FILTERS
        for name in systems.FINGERPRINTS
    }
    compared = windows[: twin.COMPARED_PASSES]
    unanswered = sum(fix is None for found in fixes.values() for one in found for fix in one)
    return SeedRun(
        error_m={name: position_errors(places, twin_data.xy) for name, places in positions.items()},
        variant_error_m=variant_errors(built, compared, twin_data.xy),
        same_points=same_points(built, compared),
        surface_m={name: error_surface(built, twin_data, name) for name in (systems.KNN, systems.FNCC)},
        first_pass={name: places[0] for name, places in positions.items()},
        causes=measure_causes(built, twin_data, positions, compared, fixes[systems.FNCC][: twin.COMPARED_PASSES]),
        failures={"queries without a result": unanswered} if unanswered else {},
    )


def _build_systems(registry: Registry, twin_data: Twin, seed: int) -> dict[str, Pipeline]:
    with TemporaryDirectory() as folder:
        setup = survey_twin(
            twin_data.survey,
            [twin.floor_plan()],
            systems.configuration(*twin.draw_plans(Path(folder))),
            registry,
            name="sun2013",
            seed=seed,
            spacing_m=0.5,
            reach_m=0.0,
            # What training would add is the fixes' covariance, for which the paper has the R it prints.
            trained=False,
        )
    return {pipeline.name: pipeline for pipeline in setup.pipelines}
