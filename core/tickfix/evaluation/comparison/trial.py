"""One walk, one seed: the pipelines whose outcome is not kept yet are run on it, and their outcomes kept."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from tickfix.config import Config, PipelineConfig
from tickfix.drivers.replay import known_start, replay
from tickfix.drivers.workers import spread
from tickfix.evaluation.comparison.grounds import Ground, Walk
from tickfix.evaluation.comparison.outcome import Outcome, outcomes
from tickfix.evaluation.comparison.store import Store, key_of
from tickfix.evaluation.comparison.versions import code_digest, versions
from tickfix.evaluation.metrics.cost import Meter
from tickfix.evaluation.metrics.walls import Plan, plans
from tickfix.evaluation.run import Bench, prepare
from tickfix.kernel import Pipeline


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Trial:
    """One walk with one seed, and what became of it.

    Attributes:
        ground: name of the ground.
        walk: name of the recording.
        seed: of the random streams.
        sha256: of the file.
        path: of the file.
        outcomes: by pipeline, in the order of the configuration.
    """

    ground: str
    walk: str
    seed: int
    sha256: str
    path: str
    outcomes: Mapping[str, Outcome]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Plot:
    """What all runs on a ground share."""

    bench: Bench
    plans: Mapping[str, Plan]
    levels: Mapping[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Terms:
    """What a comparison runs, beside the grounds.

    Attributes:
        config: the pipelines, and the kernel's settings.
        seeds: each walk is run once with each.
        start_known: tell the pipelines the first waypoint.
        store: where outcomes are kept.
    """

    config: Config
    seeds: tuple[int, ...]
    start_known: bool
    store: Store

    def key(self, ground: Ground, walk: Walk, seed: int, pipeline: PipelineConfig) -> str:
        """Return the key of an outcome: its name changes nothing, its algorithms, their code and parameters do."""
        return key_of(
            {
                "stages": [choice.key for choice in pipeline.choices],
                "code": code_digest(pipeline),
                "versions": dict(versions([pipeline])),
                "site": ground.digest,
                "walk": walk.sha256,
                "name": walk.source.path.name,
                "reader": walk.source.name,
                "seed": seed,
                "horizon_s": self.config.kernel.horizon_s,
                "start_known": self.start_known,
            }
        )


def run_ground(terms: Terms, ground: Ground, *, processes: int | None = None) -> Iterator[Trial]:
    """Run every walk of a ground with every seed, on several processes, and give the trials in their order.

    Raises:
        TickfixError: when a walk cannot be read, an algorithm cannot be built, or, in a strict run, a stage fails.
    """
    items = [(walk, seed) for walk in ground.walks for seed in terms.seeds]
    keys = [terms.key(ground, walk, seed, p) for walk, seed in items for p in terms.config.pipelines]
    # Where all outcomes are kept, the site need not even be there.
    plot = None if all(terms.store.has(key) for key in keys) else _plot(terms, ground)
    return spread(partial(_run, terms, ground, plot), items, processes=processes)


def _plot(terms: Terms, ground: Ground) -> Plot:
    site = ground.site()
    return Plot(
        bench=prepare(site, terms.config),
        plans=plans(site.floors),
        levels={floor.name: floor.level for floor in site.floors},
    )


def _run(terms: Terms, ground: Ground, plot: Plot | None, item: tuple[Walk, int]) -> Trial:
    walk, seed = item
    keys = {p.name: terms.key(ground, walk, seed, p) for p in terms.config.pipelines}
    found: dict[str, Outcome] = {}
    missing: dict[str, str] = {}
    for name, key in keys.items():
        kept = terms.store.get(key)
        if kept is not None:
            found[name] = kept
        elif key not in missing.values():
            missing[name] = key
    if missing:
        found |= _compute(terms, plot or _plot(terms, ground), walk, seed, missing)
    by_key = {keys[name]: outcome for name, outcome in found.items()}
    whole = {name: by_key[key] for name, key in keys.items()}
    return Trial(
        ground=ground.name,
        walk=next(iter(whole.values())).walk,
        seed=seed,
        sha256=walk.sha256,
        path=str(walk.source.path),
        outcomes=whole,
    )


def _compute(terms: Terms, plot: Plot, walk: Walk, seed: int, missing: Mapping[str, str]) -> Mapping[str, Outcome]:
    bench = plot.bench
    recording = walk.source.read()
    pipelines: Sequence[Pipeline] = [p for p in bench.pipelines if p.name in missing]
    meter = Meter(pipelines, time.thread_time_ns)
    start = known_start(recording) if terms.start_known else None
    replayed = replay(recording, meter.pipelines, replace(bench.settings, seed=seed), start=start)
    costs = {p.name: meter.cost(p, len(replayed.published[p.name])) for p in pipelines}
    kept = outcomes(replayed, costs, bench.coverage, plot.plans, plot.levels)
    for name, outcome in kept.items():
        terms.store.put(missing[name], outcome)
    return kept


def settings_of(pipeline: PipelineConfig) -> Mapping[str, Any]:
    """Return the choices of a pipeline by stage, all parameters spelt out, for a report."""
    return {choice.offer.kind: choice.key.partition(":")[2] for choice in pipeline.choices}
