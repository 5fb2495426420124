"""Readings of the correlation beside each other, and the error over N and K."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tickfix.api import Floats, Readings
from tickfix.kernel import Pipeline
from tickfix.reproduction.sun2013 import choices, pipelines
from tickfix.reproduction.sun2013.campaign import Campaign
from tickfix.reproduction.sun2013.results import errors, fingerprint_of, window

_VARIANTS = (
    pipelines.FNCC,
    pipelines.POOLED,
    pipelines.FNCC_OF_MEANS,
    pipelines.LITERAL,
    pipelines.LITERAL_OF_MEANS,
)


def variant_errors(
    built: Mapping[str, Pipeline], windows: Sequence[Sequence[Readings]], xy: Floats
) -> dict[str, Floats]:
    """Return the errors of each reading of FNCC: (passes, T)."""
    return {name: located(built[name], windows, xy) for name in _VARIANTS}


def located(pipeline: Pipeline, windows: Sequence[Sequence[Readings]], xy: Floats) -> Floats:
    """Return the errors of a fingerprint alone: (passes, T)."""
    fingerprint = fingerprint_of(pipeline)
    return errors(np.array([[fingerprint.locate(query).xy for query in one] for one in windows]), xy)


def same_points(built: Mapping[str, Pipeline], windows: Sequence[Sequence[Readings]]) -> dict[str, float]:
    """Return how often variants choose the K points of eq. (1), per cent.

    The plain NCC compares block by block and takes its time: with blocks it is asked some queries only, and the literal
    form, which differs from the signed one as it does from eq. (1), is compared with that one.
    """
    every = [query for one in windows for query in one]
    some = windows[0][:: -(-len(windows[0]) // choices.PLAIN_POINTS)]
    pairs = {
        pipelines.FNCC: (pipelines.NCC, some),
        pipelines.FNCC_OF_MEANS: (pipelines.NCC_OF_MEANS, every),
        pipelines.LITERAL: (pipelines.FNCC, every),
        pipelines.LITERAL_OF_MEANS: (pipelines.NCC_OF_MEANS, every),
    }
    shares = {}
    for name, (other, queries) in pairs.items():
        same = [_chosen(built[name], query) == _chosen(built[other], query) for query in queries]
        shares[name] = 100.0 * float(np.mean(same))
    return shares


def surface(built: Mapping[str, Pipeline], done: Campaign, name: str) -> Floats:
    """Return the mean error of KNN or FNCC by N and K, figure 4: (8, 8)."""
    rows = []
    for n in choices.SURFACE_N:
        windows = [[window(samples[i : i + n], 0) for samples in done.samples] for i in choices.SURFACE_STARTS]
        said = np.array([[_by_k(built, name, n, query) for query in one] for one in windows])
        rows.append(errors(np.moveaxis(said, 2, 0), done.xy).mean(axis=(1, 2)))
    return np.array(rows)


def _chosen(pipeline: Pipeline, query: Readings) -> frozenset[int]:
    order, _ = fingerprint_of(pipeline).ranked(query)
    return frozenset(order[: choices.POINTS_AVERAGED].tolist())


def _by_k(built: Mapping[str, Pipeline], name: str, n: int, query: Readings) -> Floats:
    """Return the places for each K: (8, 2)."""
    if name == pipelines.KNN:
        of_k = [fingerprint_of(built[pipelines.surface(name, n, k)]) for k in choices.SURFACE_K]
        return np.array([fingerprint.locate(query).xy for fingerprint in of_k])
    # One ranking serves every K, eq. (3).
    fingerprint = fingerprint_of(built[pipelines.surface(name, n, choices.POINTS_AVERAGED)])
    order, _ = fingerprint.ranked(query)
    return np.array([fingerprint.blocks.xy[order[:k]].mean(axis=0) for k in choices.SURFACE_K])
