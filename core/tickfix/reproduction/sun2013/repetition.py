"""One seed of the experiment: all systems on the same samples.

The paper's experiment is one of results, not of a stream: a result from each two samples, one a second, and no motion
sensors. So the fingerprints and filters of the pipelines are called once per result, as the kernel would call them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tickfix.api import Fix, Floats, Motion, Observation, Prior, Readings, Scan, frozen
from tickfix.kernel import Pipeline
from tickfix.plugins import Registry
from tickfix.reproduction.sun2013 import choices, pipelines, site
from tickfix.reproduction.sun2013.campaign import Campaign, campaign
from tickfix.reproduction.twins import survey_twin

_STEP_NS = round(choices.STEP_S * 1e9)
_PASSES = choices.TEST_SAMPLES // choices.ONLINE_SAMPLES


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Repetition:
    """What one seed gives.

    Attributes:
        error_m: by system, (passes, T) at the T test points.
        variant_error_m: by variant of FNCC, (passes, T) on the first passes.
        same_points: by variant, the share of queries, in per cent, in which it chooses the K points of eq. (1).
        surface_m: of KNN and FNCC, mean error by N and K: (8, 8).
        first_pass: by system, (T, 2) where it says the first pass went.
        unanswered: queries without a result.
    """

    error_m: Mapping[str, Floats]
    variant_error_m: Mapping[str, Floats]
    same_points: Mapping[str, float]
    surface_m: Mapping[str, Floats]
    first_pass: Mapping[str, Floats]
    unanswered: int


def repeat(registry: Registry, seed: int) -> Repetition:
    """Run the experiment on the radio, survey and test of one seed."""
    done = campaign(seed)
    with TemporaryDirectory() as folder:
        toml = pipelines.configuration(*site.draw_plans(Path(folder)))
        bench = survey_twin(
            done.survey,
            [site.floor()],
            toml,
            registry,
            name="sun2013",
            seed=seed,
            spacing_m=0.5,
            reach_m=0.0,
            # What training would add is the fixes' covariance, for which the paper has the R it prints.
            trained=False,
        )
    built = {pipeline.name: pipeline for pipeline in bench.pipelines}
    n = choices.ONLINE_SAMPLES
    windows = [
        [_window(samples[i * n : i * n + n], t) for t, samples in enumerate(done.samples)] for i in range(_PASSES)
    ]
    fixes = {
        name: [[_fingerprint(built[name]).locate(window) for window in one] for one in windows]
        for name in pipelines.FINGERPRINTS
    }
    said = {
        f"{name}{aid}": np.array([_track(built[f"{name}{aid}"], found) for found in fixes[name]])
        for aid in (pipelines.ALONE, pipelines.MAP, pipelines.KF, pipelines.KMF)
        for name in pipelines.FINGERPRINTS
    }
    compared = windows[: choices.COMPARED_PASSES]
    return Repetition(
        error_m={name: _errors(places, done.xy) for name, places in said.items()},
        variant_error_m=_variants(built, compared, done.xy),
        same_points=_same_points(built, compared),
        surface_m={name: _surface(built, done, name) for name in (pipelines.KNN, pipelines.FNCC)},
        first_pass={name: places[0] for name, places in said.items()},
        unanswered=sum(fix is None for found in fixes.values() for one in found for fix in one),
    )


def _window(scans: Sequence[Scan], place: int) -> Readings:
    """Return scans as the window of the ``place``-th result of a pass: the last of them ends at its instant."""
    times = [place * _STEP_NS - (len(scans) - 1 - n) * _STEP_NS // choices.ONLINE_SAMPLES for n in range(len(scans))]
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


def _fingerprint(pipeline: Pipeline) -> Any:
    assert pipeline.fingerprint is not None  # noqa: S101 - each of ours has one
    return pipeline.fingerprint.algorithm


def _track(pipeline: Pipeline, fixes: Sequence[Fix | None]) -> Floats:
    """Return (T, 2) what a filter says at the instant of each result; NaN before the first."""
    filter_: Any = pipeline.filter.algorithm
    rng = np.random.default_rng(0)  # none of these filters draws
    state: Any = None
    said = np.full((len(fixes), 2), np.nan)
    for n, fix in enumerate(fixes):
        observation = Observation(t_ns=n * _STEP_NS, source="fingerprint", fix=fix)
        if state is None:
            state = filter_.start(Prior(t_ns=n * _STEP_NS, fix=fix, observation=observation), rng)
        else:
            state, _ = filter_.step(state, Motion.unknown((n - 1) * _STEP_NS, n * _STEP_NS), [observation], rng)
        if state is not None:
            said[n] = filter_.estimate(state).xy
    return said


def _errors(said: Floats, xy: Floats) -> Floats:
    """Return the distances of (…, T, 2) from the test points (T, 2)."""
    away = said - xy
    errors: Floats = np.hypot(away[..., 0], away[..., 1])
    return errors


def _variants(built: Mapping[str, Pipeline], windows: Sequence[Sequence[Readings]], xy: Floats) -> dict[str, Floats]:
    errors = {}
    for name in (
        pipelines.FNCC,
        pipelines.POOLED,
        pipelines.FNCC_OF_MEANS,
        pipelines.LITERAL,
        pipelines.LITERAL_OF_MEANS,
    ):
        fingerprint = _fingerprint(built[name])
        errors[name] = _errors(np.array([[fingerprint.locate(w).xy for w in one] for one in windows]), xy)
    return errors


def _same_points(built: Mapping[str, Pipeline], windows: Sequence[Sequence[Readings]]) -> dict[str, float]:
    """Return how often variants choose the K points of eq. (1), per cent.

    The plain NCC compares block by block and takes its time: with blocks it is asked some queries only, and the literal
    form, which differs from the signed one as it does from eq. (1), is compared with that one.
    """
    every = [window for one in windows for window in one]
    some = windows[0][:: -(-len(windows[0]) // choices.PLAIN_POINTS)]
    pairs = {
        pipelines.FNCC: (pipelines.NCC, some),
        pipelines.FNCC_OF_MEANS: (pipelines.NCC_OF_MEANS, every),
        pipelines.LITERAL: (pipelines.FNCC, every),
        pipelines.LITERAL_OF_MEANS: (pipelines.NCC_OF_MEANS, every),
    }
    shares = {}
    for name, (other, queries) in pairs.items():
        same = [_chosen(built[name], window) == _chosen(built[other], window) for window in queries]
        shares[name] = 100.0 * float(np.mean(same))
    return shares


def _chosen(pipeline: Pipeline, window: Readings) -> frozenset[int]:
    order, _ = _fingerprint(pipeline).ranked(window)
    return frozenset(order[: choices.POINTS_AVERAGED].tolist())


def _surface(built: Mapping[str, Pipeline], done: Campaign, name: str) -> Floats:
    """Return the mean error by N and K, figure 4."""
    rows = []
    for n in choices.SURFACE_N:
        windows = [[_window(samples[i : i + n], 0) for samples in done.samples] for i in choices.SURFACE_STARTS]
        said = np.array([[_by_k(built, name, n, window) for window in one] for one in windows])
        rows.append(_errors(np.moveaxis(said, 2, 0), done.xy).mean(axis=(1, 2)))
    return np.array(rows)


def _by_k(built: Mapping[str, Pipeline], name: str, n: int, window: Readings) -> Floats:
    """Return the places for each K: (8, 2)."""
    if name == pipelines.KNN:
        return np.array(
            [_fingerprint(built[pipelines.surface(name, n, k)]).locate(window).xy for k in choices.SURFACE_K]
        )
    # One ranking serves every K, eq. (3).
    fingerprint = _fingerprint(built[pipelines.surface(name, n, choices.POINTS_AVERAGED)])
    order, _ = fingerprint.ranked(window)
    return np.array([fingerprint.blocks.xy[order[:k]].mean(axis=0) for k in choices.SURFACE_K])
