"""One seed of the experiment: all systems on the same samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tickfix.api import Floats
from tickfix.kernel import Pipeline
from tickfix.plugins import Registry
from tickfix.reproduction.sun2013 import choices, pipelines, site
from tickfix.reproduction.sun2013.campaign import Campaign, campaign
from tickfix.reproduction.sun2013.causes import Causes, causes
from tickfix.reproduction.sun2013.results import errors, fingerprint_of, track, window
from tickfix.reproduction.sun2013.variants import same_points, surface, variant_errors
from tickfix.reproduction.twins import survey_twin


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Repetition:
    """What one seed gives.

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


def repeat(registry: Registry, seed: int) -> Repetition:
    """Run the experiment on the radio, survey and test of one seed."""
    done = campaign(seed)
    built = _pipelines(registry, done, seed)
    n = choices.ONLINE_SAMPLES
    windows = [
        [window(samples[i * n : i * n + n], t) for t, samples in enumerate(done.samples)] for i in range(choices.PASSES)
    ]
    fixes = {
        name: [[fingerprint_of(built[name]).locate(query) for query in one] for one in windows]
        for name in pipelines.FINGERPRINTS
    }
    said = {
        name + aid: np.array([track(built[name + aid], found) for found in fixes[name]])
        for aid in pipelines.AIDS
        for name in pipelines.FINGERPRINTS
    }
    compared = windows[: choices.COMPARED_PASSES]
    unanswered = sum(fix is None for found in fixes.values() for one in found for fix in one)
    return Repetition(
        error_m={name: errors(places, done.xy) for name, places in said.items()},
        variant_error_m=variant_errors(built, compared, done.xy),
        same_points=same_points(built, compared),
        surface_m={name: surface(built, done, name) for name in (pipelines.KNN, pipelines.FNCC)},
        first_pass={name: places[0] for name, places in said.items()},
        causes=causes(built, done, said, compared, fixes[pipelines.FNCC][: choices.COMPARED_PASSES]),
        failures={"queries without a result": unanswered} if unanswered else {},
    )


def _pipelines(registry: Registry, done: Campaign, seed: int) -> dict[str, Pipeline]:
    with TemporaryDirectory() as folder:
        bench = survey_twin(
            done.survey,
            [site.floor()],
            pipelines.configuration(*site.draw_plans(Path(folder))),
            registry,
            name="sun2013",
            seed=seed,
            spacing_m=0.5,
            reach_m=0.0,
            # What training would add is the fixes' covariance, for which the paper has the R it prints.
            trained=False,
        )
    return {pipeline.name: pipeline for pipeline in bench.pipelines}
