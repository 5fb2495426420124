"""Why claims do not hold on the twin: measured after the first results were seen, and deciding no claim."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tickfix.api import Bools, Fix, Floats, Readings, Scan
from tickfix.kernel import Pipeline
from tickfix.reproduction.sun2013 import choices
from tickfix.reproduction.sun2013.campaign import Campaign
from tickfix.reproduction.sun2013.pipelines import AGILE, FINGERPRINTS, FNCC, KF, KMF
from tickfix.reproduction.sun2013.results import errors, perfect, track
from tickfix.reproduction.sun2013.variants import located

LOUDER_DB: Final = 5.0
FILTERED: Final = tuple(f"{agile}{FNCC}{aid}" for agile in ("", AGILE) for aid in (KF, KMF))


@dataclass(frozen=True, slots=True, kw_only=True)
class Causes:
    """What one seed tells of causes.

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


def causes(
    built: Mapping[str, Pipeline],
    done: Campaign,
    said: Mapping[str, Floats],
    windows: Sequence[Sequence[Readings]],
    fixes: Sequence[Sequence[Fix | None]],
) -> Causes:
    """Return the causes of one seed.

    Args:
        built: the pipelines.
        done: survey and test.
        said: by fingerprint, (passes, T, 2).
        windows, fixes: queries of the first passes, and what FNCC made of them.
    """
    gap = np.array([_gaps(samples) for samples in done.samples]).T
    error_m = {name: errors(said[name], done.xy) for name in FINGERPRINTS}
    louder = [[replace(query, rssi_dbm=query.rssi_dbm + LOUDER_DB) for query in one] for one in windows]
    return Causes(
        gaps=100.0 * float(gap.mean()),
        whole_m={name: float(error[~gap].mean()) for name, error in error_m.items()},
        gap_m={name: float(error[gap].mean()) for name, error in error_m.items()},
        louder_m={name: float(located(built[name], louder, done.xy).mean()) for name in FINGERPRINTS},
        correlation={name: _correlation(said[name] - done.xy) for name in FINGERPRINTS},
        lag_m={name: float(errors(track(built[name], perfect(done.xy)), done.xy).mean()) for name in FILTERED},
        filtered_m={name: float(errors(_tracks(built[name], fixes), done.xy).mean()) for name in FILTERED},
    )


def _tracks(pipeline: Pipeline, fixes: Sequence[Sequence[Fix | None]]) -> Floats:
    return np.array([track(pipeline, one) for one in fixes])


def _gaps(samples: Sequence[Scan]) -> Bools:
    """Tell of each pass whether its samples lack an access point that at least half of all samples have."""
    names = sorted({name for scan in samples for name in scan.transmitters})
    heard = np.array([[name in scan.transmitters for name in names] for scan in samples])
    usual = heard.mean(axis=0) >= 0.5
    passes = heard.reshape(-1, choices.ONLINE_SAMPLES, len(names)).any(axis=1)
    gap: Bools = (~passes & usual).any(axis=1)
    return gap


def _correlation(error: Floats) -> float:
    """Return how alike the errors (passes, T, 2) of neighbouring results are, 0 not at all, 1 the same."""
    neighbours = (error[:, 1:] * error[:, :-1]).sum(axis=-1).mean()
    return float(neighbours / (error**2).sum(axis=-1).mean())
