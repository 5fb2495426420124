"""Trials: one walk with one seed.

Pipelines without a stored outcome are run; the key of an outcome covers versions and a digest of the code.
"""

from __future__ import annotations

import platform
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy

from tickfix.config import Config, PipelineConfig
from tickfix.evaluation.comparison.evaluation_sites import EvaluationSite, EvaluationWalk
from tickfix.evaluation.comparison.trial_outcomes import OutcomeStore, TrialOutcome, outcome_key, trial_outcomes
from tickfix.evaluation.track_metrics import FloorGeometry, StageTimer, floor_geometries
from tickfix.evaluation.walk_runs import RunSetup, prepare
from tickfix.kernel import Pipeline
from tickfix.replay.driver import replay_recording, start_at_first_waypoint
from tickfix.replay.process_pool import parallel_map
from tickfix.version import __version__

_NOT_HASHED: Final = (
    "cli/",
    "client/",
    "evaluation/comparison/comparison_result.py",
    "evaluation/comparison/comparison_run.py",
    "evaluation/comparison/pooled_metrics.py",
    "evaluation/paired_comparison.py",
    "evaluation/paired_statistics.py",
    "evaluation/report/",
    "journal/",
    "ports/",
    "simulation/",
    "testing/",
    "wire/",
    "workflow/",
)


def versions(pipelines: Iterable[PipelineConfig]) -> Mapping[str, str]:
    """Return the versions of Python, numpy, scipy, tickfix, and of the packages that the algorithms came from."""
    offers = [choice.offer for pipeline in pipelines for choice in pipeline.choices]
    return {
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "tickfix": __version__,
        **{offer.distribution: offer.version for offer in sorted(offers, key=lambda offer: offer.distribution)},
    }


def code_digest(pipeline: PipelineConfig) -> str:
    """Return the SHA-256 of the source of tickfix and of the packages of the pipeline's algorithms.

    Versions of packages under work stay the same while their code does not; results must not outlive their code. Of
    tickfix only those rooms count that a walk goes through.
    """
    modules = {choice.offer.cls.__module__ for choice in pipeline.choices} | {"tickfix"}
    return sha256("".join(_source_digest(module) for module in sorted(modules)).encode()).hexdigest()


@cache
def _source_digest(module: str) -> str:
    root = sys.modules[module.partition(".")[0]]
    place = getattr(root, "__file__", None) or getattr(sys.modules[module], "__file__", None)
    if place is None:
        return ""
    file = Path(place)
    files = sorted(file.parent.rglob("*.py")) if file.name == "__init__.py" else [file]
    sha = sha256()
    for one in files:
        name = one.relative_to(file.parent).as_posix()
        if module != "tickfix" or not name.startswith(_NOT_HASHED):
            sha.update(name.encode() + b"\0" + one.read_bytes())
    return sha.hexdigest()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Trial:
    """One walk with one seed, and the outcome of each pipeline.

    Attributes:
        site: name of the evaluation site.
        walk: name of the recording.
        seed: of the random streams.
        sha256: of the file.
        path: of the file.
        outcomes: by pipeline, in the order of the configuration.
    """

    site: str
    walk: str
    seed: int
    sha256: str
    path: str
    outcomes: Mapping[str, TrialOutcome]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SiteSetup:
    """What all runs on a site share."""

    setup: RunSetup
    geometries: Mapping[str, FloorGeometry]
    levels: Mapping[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialOptions:
    """The options of a comparison, apart from its sites.

    Attributes:
        config: the pipelines, and the kernel's settings.
        seeds: each walk is run once with each.
        start_known: tell the pipelines the first waypoint.
        store: where outcomes are kept, None to keep none.
    """

    config: Config
    seeds: tuple[int, ...]
    start_known: bool
    store: OutcomeStore | None = None

    def key(self, evaluation_site: EvaluationSite, walk: EvaluationWalk, seed: int, pipeline: PipelineConfig) -> str:
        """Return the key of an outcome: it depends on algorithms, their code and parameters, not on names."""
        return outcome_key(
            {
                "stages": [choice.key for choice in pipeline.choices],
                "code": code_digest(pipeline),
                "versions": dict(versions([pipeline])),
                "site": evaluation_site.digest,
                "walk": walk.sha256,
                "name": walk.source.path.name,
                "reader": walk.source.name,
                "seed": seed,
                "horizon_s": self.config.kernel.horizon_s,
                "start_known": self.start_known,
            }
        )


def run_site(
    trial_options: TrialOptions, evaluation_site: EvaluationSite, *, processes: int | None = None
) -> Iterator[Trial]:
    """Run every walk of a site with every seed in several processes; yield the trials in their order.

    Raises:
        TickfixError: when a walk cannot be read, an algorithm cannot be built, or, in a strict run, a stage fails.
    """
    items = [(walk, seed) for walk in evaluation_site.walks for seed in trial_options.seeds]
    keys = [
        trial_options.key(evaluation_site, walk, seed, p)
        for walk, seed in items
        for p in trial_options.config.pipelines
    ]
    # Where all outcomes are kept, the site need not even be there.
    site_setup = (
        None
        if trial_options.store is not None and all(trial_options.store.has(key) for key in keys)
        else _site_setup(trial_options, evaluation_site)
    )
    return parallel_map(partial(_run_trial, trial_options, evaluation_site, site_setup), items, processes=processes)


def _site_setup(trial_options: TrialOptions, evaluation_site: EvaluationSite) -> SiteSetup:
    site = evaluation_site.site()
    return SiteSetup(
        setup=prepare(site, trial_options.config),
        geometries=floor_geometries(site.floors),
        levels={floor.name: floor.level for floor in site.floors},
    )


def _run_trial(
    trial_options: TrialOptions,
    evaluation_site: EvaluationSite,
    site_setup: SiteSetup | None,
    item: tuple[EvaluationWalk, int],
) -> Trial:
    walk, seed = item
    keys = {p.name: trial_options.key(evaluation_site, walk, seed, p) for p in trial_options.config.pipelines}
    found: dict[str, TrialOutcome] = {}
    missing: dict[str, str] = {}
    for name, key in keys.items():
        kept = None if trial_options.store is None else trial_options.store.get(key)
        if kept is not None:
            found[name] = kept
        elif key not in missing.values():
            missing[name] = key
    if missing:
        found |= _replay_missing(
            trial_options, site_setup or _site_setup(trial_options, evaluation_site), walk, seed, missing
        )
    by_key = {keys[name]: outcome for name, outcome in found.items()}
    all_outcomes = {name: by_key[key] for name, key in keys.items()}
    return Trial(
        site=evaluation_site.name,
        walk=next(iter(all_outcomes.values())).walk,
        seed=seed,
        sha256=walk.sha256,
        path=str(walk.source.path),
        outcomes=all_outcomes,
    )


def _replay_missing(
    trial_options: TrialOptions, site_setup: SiteSetup, walk: EvaluationWalk, seed: int, missing: Mapping[str, str]
) -> Mapping[str, TrialOutcome]:
    setup = site_setup.setup
    recording = walk.source.read()
    pipelines: Sequence[Pipeline] = [p for p in setup.pipelines if p.name in missing]
    timer = StageTimer(pipelines, time.thread_time_ns)
    start = start_at_first_waypoint(recording) if trial_options.start_known else None
    replayed = replay_recording(recording, timer.pipelines, replace(setup.settings, seed=seed), start=start)
    costs = {p.name: timer.cost(p, len(replayed.published[p.name])) for p in pipelines}
    kept = trial_outcomes(replayed, costs, setup.coverage, site_setup.geometries, site_setup.levels)
    for name, outcome in kept.items():
        if trial_options.store is not None:
            trial_options.store.put(missing[name], outcome)
    return kept


def stage_choices(pipeline: PipelineConfig) -> Mapping[str, Any]:
    """Return the choices of a pipeline by stage, with all parameters, for a report."""
    return {choice.offer.kind: choice.key.partition(":")[2] for choice in pipeline.choices}
