"""The result of a comparison.

Metrics of every pipeline, differences from the baseline, overall and by site, and its provenance.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from tickfix.api import ConfigError
from tickfix.evaluation.comparison.pooled_metrics import (
    PooledSamples,
    Scope,
    chain_names,
    cost_metrics,
    pool_samples,
    scope_metrics,
    scored,
    seed_deviation,
    sum_counts,
    whole_track_metrics,
)
from tickfix.evaluation.comparison.trial_outcomes import TrialOutcome
from tickfix.evaluation.comparison.trials import Trial
from tickfix.evaluation.error_metrics import penalised_errors
from tickfix.evaluation.paired_comparison import PairedComparison, compare_with_baseline
from tickfix.evaluation.paired_statistics import STATISTICS, Percentile
from tickfix.evaluation.scoring import PipelineScore, WalkScore
from tickfix.evaluation.walk_runs import RunSummary, WalkResult, summarise

METRICS: Final = (*STATISTICS, "ipin")
_INTERPOLATED_METRICS: Final = ("mean", "rmse")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SiteResult:
    """The result on one site: mean errors, and their differences from the baseline."""

    site: str
    walks: int
    means_m: Mapping[str, float | None]
    comparisons: tuple[PairedComparison, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the object that stands under ``sites``."""
        return {
            "name": self.site,
            "walks": self.walks,
            "mean_m": dict(self.means_m),
            "comparisons": [comparison.as_json() for comparison in self.comparisons],
        }


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ComparisonResult:
    """A comparison.

    Attributes:
        baseline, metric: name of the pipeline and of the metric that the verdicts are about.
        trials: every walk with every seed.
        samples: by scope.
        summary: in the shape of ``tickfix replay``; a walk stands there once for each seed.
        metrics: by pipeline; see ``docs/metrics.md``.
        comparisons: each pipeline against the baseline in each metric and scope.
        sites: mean errors and their differences by site.
        provenance: settings, versions, digests, and the command.
    """

    baseline: str
    metric: str
    trials: tuple[Trial, ...]
    samples: Mapping[Scope, PooledSamples]
    summary: RunSummary
    metrics: Mapping[str, Mapping[str, Any]]
    comparisons: tuple[PairedComparison, ...]
    sites: tuple[SiteResult, ...]
    provenance: Mapping[str, Any]

    @property
    def pipelines(self) -> tuple[str, ...]:
        """Names, in the order of the configuration."""
        return tuple(self.summary.pipelines)

    def verdicts(self, scope: Scope = Scope.ALL) -> tuple[PairedComparison, ...]:
        """Return the comparisons in the chosen metric: those over all scored waypoints decide."""
        return tuple(c for c in self.comparisons if (c.metric, c.scope) == (self.metric, scope.value))

    @property
    def partly_covered(self) -> bool:
        """Whether some, but not all, scored waypoints are covered by the survey."""
        return 0 < len(self.samples[Scope.COVERED]) < len(self.samples[Scope.ALL])

    @property
    def failures(self) -> Mapping[str, int]:
        """Ticks in which stages failed, by pipeline and stage."""
        return {
            f"{name}: {what}": count
            for name in self.pipelines
            for what, count in sum_counts(t.outcomes[name].failures for t in self.trials).items()
        }

    def as_json(self) -> dict[str, Any]:
        """Return the object that ``tickfix compare --json`` prints; it holds no NaN."""
        shape = self.summary.as_json()
        for name, pipeline in shape["pipelines"].items():
            pipeline["metrics"] = self.metrics[name]
        chains = chain_names(self.trials)
        for walk, trial in zip(shape["walks"], self.trials, strict=True):
            walk["site"], walk["seed"] = trial.site, trial.seed
            walk["chain"] = chains.get((trial.site, trial.walk))
        return shape | {
            "baseline": self.baseline,
            "metric": self.metric,
            "comparisons": [comparison.as_json() for comparison in self.comparisons],
            "sites": [part.as_json() for part in self.sites],
            "provenance": dict(self.provenance),
        }


def compare_trials(
    trials: Sequence[Trial], *, baseline: str, metric: str = "mean", provenance: Mapping[str, Any] | None = None
) -> ComparisonResult:
    """Pool the trials of a comparison and compare every pipeline with the baseline.

    Raises:
        ConfigError: when there are no trials, or no pipeline or metric of that name.
    """
    if not trials:
        raise ConfigError("compare", "no walks", "at least one")
    names = list(trials[0].outcomes)
    if baseline not in names:
        raise ConfigError("--baseline", repr(baseline), f"one of {', '.join(names)}")
    if metric not in METRICS:
        raise ConfigError("--metric", repr(metric), f"one of {', '.join(METRICS)}")
    samples = {scope: pool_samples(trials, scope) for scope in Scope}
    metrics = {
        name: {
            **{scope.value: scope_metrics(samples[scope].sample_errors[name]) for scope in Scope},
            "tracks": whole_track_metrics([trial.outcomes[name] for trial in trials]),
            "cost": cost_metrics([trial.outcomes[name] for trial in trials]),
            "seed_deviation_m": seed_deviation(samples[Scope.ALL], trials, name),
        }
        for name in names
    }
    return ComparisonResult(
        baseline=baseline,
        metric=metric,
        trials=tuple(trials),
        samples=samples,
        summary=_run_summary(trials),
        metrics=metrics,
        comparisons=tuple(_compare_all_metrics(samples, baseline)),
        sites=_site_results(trials, samples[Scope.ALL], baseline),
        provenance=dict(provenance or {}),
    )


def _compare_all_metrics(samples: Mapping[Scope, PooledSamples], baseline: str) -> list[PairedComparison]:
    found: list[PairedComparison] = []
    for scope in Scope:
        for metric in METRICS if scope is not Scope.INTERPOLATED else _INTERPOLATED_METRICS:
            found += _compare_metric(samples[scope], scope, metric, baseline)
    return found


def _compare_metric(samples: PooledSamples, scope: Scope, metric: str, baseline: str) -> tuple[PairedComparison, ...]:
    errors = None
    if metric == "ipin":
        errors = {
            name: penalised_errors(sample_errors.error_m, sample_errors.storeys_off)
            for name, sample_errors in samples.sample_errors.items()
        }
    return compare_with_baseline(
        {name: samples.paired(baseline, name, errors) for name in samples.sample_errors if name != baseline},
        baseline=baseline,
        metric=metric,
        scope=scope.value,
        statistic=Percentile(75) if metric == "ipin" else STATISTICS[metric],
        walks=samples.walks,
    )


def _site_results(trials: Sequence[Trial], samples: PooledSamples, baseline: str) -> tuple[SiteResult, ...]:
    sites = list(dict.fromkeys(trial.site for trial in trials))
    if len(sites) == 1:
        return (_site_result(trials, sites[0], samples, baseline),)
    by_site = [pool_samples(trials, Scope.ALL, [trial.site == site for trial in trials]) for site in sites]
    return tuple(
        _site_result(trials, site, samples_there, baseline) for site, samples_there in zip(sites, by_site, strict=True)
    )


def _site_result(trials: Sequence[Trial], site: str, samples: PooledSamples, baseline: str) -> SiteResult:
    means = {name: scope_metrics(sample_errors)["mean_m"] for name, sample_errors in samples.sample_errors.items()}
    walks = len({trial.walk for trial in trials if trial.site == site})
    return SiteResult(
        site=site, walks=walks, means_m=means, comparisons=_compare_metric(samples, Scope.ALL, "mean", baseline)
    )


def _run_summary(trials: Sequence[Trial]) -> RunSummary:
    intake: Counter[str] = Counter()
    for trial in trials:
        intake.update(dict(_any_outcome(trial).intake))
    return summarise([_walk_result(trial) for trial in trials], dict(sorted(intake.items())))


def _walk_result(trial: Trial) -> WalkResult:
    outcome = _any_outcome(trial)
    score = WalkScore(
        name=trial.walk,
        floor=outcome.floor,
        t_ns=outcome.samples.t_ns,
        covered=outcome.covered,
        scored=scored(trial, Scope.ALL),
        pipelines={
            name: PipelineScore(error_m=o.at_samples.error_m, floor_right=o.at_samples.floor_right)
            for name, o in trial.outcomes.items()
        },
    )
    return WalkResult(
        score=score,
        published={name: o.published for name, o in trial.outcomes.items()},
        settled={name: o.settled for name, o in trial.outcomes.items()},
        diagnostics={name: {key: (total, n) for key, total, n in o.diagnostics} for name, o in trial.outcomes.items()},
    )


def _any_outcome(trial: Trial) -> TrialOutcome:
    return next(iter(trial.outcomes.values()))
