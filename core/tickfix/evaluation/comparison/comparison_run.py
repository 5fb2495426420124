"""Runs a comparison from its options to its result: every trial on every site, and the record of how it was made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tickfix.api import Floor
from tickfix.evaluation.comparison.comparison_result import ComparisonResult, compare_trials
from tickfix.evaluation.comparison.evaluation_sites import EvaluationSite
from tickfix.evaluation.comparison.trials import Trial, TrialOptions, code_digest, run_site, stage_choices, versions
from tickfix.replay.recording_files import Progress, no_progress


def run_comparison(
    trial_options: TrialOptions,
    evaluation_sites: Sequence[EvaluationSite],
    *,
    baseline: str,
    metric: str = "mean",
    command: str = "",
    crossvalidation: Mapping[str, Any] | None = None,
    processes: int | None = None,
    progress: Progress = no_progress,
) -> ComparisonResult:
    """Run every walk of every site with every seed, and compare the pipelines.

    Args:
        trial_options: what to run.
        evaluation_sites: where.
        baseline: the pipeline that the others are compared with.
        metric: what the verdicts are about.
        command: recorded in the report as what made it.
        crossvalidation: recorded in the report, None without one.
        processes: how many walks run at once, by default one per core.
        progress: called after each trial.

    Raises:
        ConfigError: when there are no walks, or no pipeline or metric of that name.
        TickfixError: when a walk cannot be read, an algorithm cannot be built, or, in a strict run, a stage fails.
    """
    total = sum(len(evaluation_site.walks) for evaluation_site in evaluation_sites) * len(trial_options.seeds)
    trials: list[Trial] = []
    progress("comparing", 0, total)
    for evaluation_site in evaluation_sites:
        for trial in run_site(trial_options, evaluation_site, processes=processes):
            trials.append(trial)
            progress("comparing", len(trials), total)
    provenance = _provenance(trial_options, evaluation_sites, command, crossvalidation)
    return compare_trials(trials, baseline=baseline, metric=metric, provenance=provenance)


def floors_by_site(evaluation_sites: Sequence[EvaluationSite]) -> dict[tuple[str, str], Floor]:
    """Return the plans of all floors by names of site and floor, as a report draws them."""
    return {
        (evaluation_site.name, floor.name): floor
        for evaluation_site in evaluation_sites
        for floor in evaluation_site.floors
    }


def _provenance(
    trial_options: TrialOptions,
    evaluation_sites: Sequence[EvaluationSite],
    command: str,
    crossvalidation: Mapping[str, Any] | None,
) -> dict[str, Any]:
    pipelines = trial_options.config.pipelines
    return {
        "command": command,
        "folder": str(Path.cwd()),
        "versions": dict(versions(pipelines)),
        "code": {pipeline.name: code_digest(pipeline) for pipeline in pipelines},
        "pipelines": {pipeline.name: dict(stage_choices(pipeline)) for pipeline in pipelines},
        "sweeps": {p.name: {"table": p.table, "values": dict(p.swept)} for p in pipelines if p.swept},
        "seeds": list(trial_options.seeds),
        "start_known": trial_options.start_known,
        "horizon_s": trial_options.config.kernel.horizon_s,
        "crossvalidation": None if crossvalidation is None else dict(crossvalidation),
        "sites": [{"name": g.name, "digest": g.digest, "walks": len(g.walks)} for g in evaluation_sites],
    }
