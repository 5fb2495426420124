"""A comparison as a whole: figures of every pipeline, differences from the baseline, and how it came about."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from tickfix.api import ConfigError
from tickfix.evaluation.comparison.outcome import Outcome
from tickfix.evaluation.comparison.points import Points, Scope, chain_names, points_of, scored
from tickfix.evaluation.comparison.pooled import cost_figures, counted, scope_figures, seed_spread, track_figures
from tickfix.evaluation.comparison.trial import Trial
from tickfix.evaluation.metrics.penalised import penalised_errors
from tickfix.evaluation.scoring import PipelineScore, WalkScore
from tickfix.evaluation.statistics.comparison import Comparison, compare
from tickfix.evaluation.statistics.quantities import QUANTITIES, Quantile
from tickfix.evaluation.summary import Summary, WalkResult, summarise

METRICS: Final = (*QUANTITIES, "ipin")
_BETWEEN_METRICS: Final = ("mean", "rmse")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Part:
    """One ground of the comparison: differences in mean there."""

    ground: str
    walks: int
    means_m: Mapping[str, float | None]
    comparisons: tuple[Comparison, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the object that stands under ``grounds``."""
        return {
            "name": self.ground,
            "walks": self.walks,
            "mean_m": dict(self.means_m),
            "comparisons": [comparison.as_json() for comparison in self.comparisons],
        }


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Result:
    """A comparison.

    Attributes:
        baseline, metric: what the verdicts are about.
        trials: every walk with every seed.
        points: by scope.
        summary: in the shape of ``tickfix replay``; a walk stands there once for each seed.
        figures: by pipeline; see ``docs/metrics.md``.
        comparisons: each pipeline against the baseline in each metric and scope.
        grounds: the same in mean, ground by ground.
        provenance: settings, versions, digests, and the command.
    """

    baseline: str
    metric: str
    trials: tuple[Trial, ...]
    points: Mapping[Scope, Points]
    summary: Summary
    figures: Mapping[str, Mapping[str, Any]]
    comparisons: tuple[Comparison, ...]
    grounds: tuple[Part, ...]
    provenance: Mapping[str, Any]

    @property
    def pipelines(self) -> tuple[str, ...]:
        """Names, in the order of the configuration."""
        return tuple(self.summary.pipelines)

    def verdicts(self, scope: Scope = Scope.ALL) -> tuple[Comparison, ...]:
        """Return the comparisons in the chosen metric: those over all scored waypoints decide."""
        return tuple(c for c in self.comparisons if (c.metric, c.scope) == (self.metric, scope.value))

    @property
    def partly_covered(self) -> bool:
        """Whether some, but not all, scored waypoints are covered by the survey."""
        return 0 < len(self.points[Scope.COVERED]) < len(self.points[Scope.ALL])

    @property
    def failures(self) -> Mapping[str, int]:
        """Ticks in which stages failed, by pipeline and stage."""
        return {
            f"{name}: {what}": count
            for name in self.pipelines
            for what, count in counted(t.outcomes[name].failures for t in self.trials).items()
        }

    def as_json(self) -> dict[str, Any]:
        """Return the object that ``tickfix compare --json`` prints; it holds no NaN."""
        shape = self.summary.as_json()
        for name, pipeline in shape["pipelines"].items():
            pipeline["figures"] = self.figures[name]
        chains = chain_names(self.trials)
        for walk, trial in zip(shape["walks"], self.trials, strict=True):
            walk["ground"], walk["seed"] = trial.ground, trial.seed
            walk["chain"] = chains.get((trial.ground, trial.walk))
        return shape | {
            "baseline": self.baseline,
            "metric": self.metric,
            "comparisons": [comparison.as_json() for comparison in self.comparisons],
            "grounds": [part.as_json() for part in self.grounds],
            "provenance": dict(self.provenance),
        }


def result_of(
    trials: Sequence[Trial], *, baseline: str, metric: str = "mean", provenance: Mapping[str, Any] | None = None
) -> Result:
    """Bring the trials of a comparison together and compare.

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
    points = {scope: points_of(trials, scope) for scope in Scope}
    figures = {
        name: {
            **{scope.value: scope_figures(points[scope].said[name]) for scope in Scope},
            "tracks": track_figures([trial.outcomes[name] for trial in trials]),
            "cost": cost_figures([trial.outcomes[name] for trial in trials]),
            "seed_spread_m": seed_spread(points[Scope.ALL], trials, name),
        }
        for name in names
    }
    return Result(
        baseline=baseline,
        metric=metric,
        trials=tuple(trials),
        points=points,
        summary=_summary(trials),
        figures=figures,
        comparisons=tuple(_compared(points, baseline)),
        grounds=_parts(trials, points[Scope.ALL], baseline),
        provenance=dict(provenance or {}),
    )


def _compared(points: Mapping[Scope, Points], baseline: str) -> list[Comparison]:
    found: list[Comparison] = []
    for scope in Scope:
        for metric in METRICS if scope is not Scope.INTERPOLATED else _BETWEEN_METRICS:
            found += _in_one(points[scope], scope, metric, baseline)
    return found


def _in_one(points: Points, scope: Scope, metric: str, baseline: str) -> tuple[Comparison, ...]:
    errors = None
    if metric == "ipin":
        errors = {name: penalised_errors(said.error_m, said.floors_off) for name, said in points.said.items()}
    return compare(
        {name: points.paired(baseline, name, errors) for name in points.said if name != baseline},
        baseline=baseline,
        metric=metric,
        scope=scope.value,
        quantity=Quantile(75) if metric == "ipin" else QUANTITIES[metric],
        walks=points.walks,
    )


def _parts(trials: Sequence[Trial], points: Points, baseline: str) -> tuple[Part, ...]:
    grounds = list(dict.fromkeys(trial.ground for trial in trials))
    if len(grounds) == 1:
        return (_part(trials, grounds[0], points, baseline),)
    apart = [points_of(trials, Scope.ALL, [trial.ground == ground for trial in trials]) for ground in grounds]
    return tuple(_part(trials, ground, there, baseline) for ground, there in zip(grounds, apart, strict=True))


def _part(trials: Sequence[Trial], ground: str, points: Points, baseline: str) -> Part:
    means = {name: scope_figures(said)["mean_m"] for name, said in points.said.items()}
    walks = len({trial.walk for trial in trials if trial.ground == ground})
    return Part(ground=ground, walks=walks, means_m=means, comparisons=_in_one(points, Scope.ALL, "mean", baseline))


def _summary(trials: Sequence[Trial]) -> Summary:
    intake: Counter[str] = Counter()
    for trial in trials:
        intake.update(dict(_any(trial).intake))
    return summarise([_walk_result(trial) for trial in trials], dict(sorted(intake.items())))


def _walk_result(trial: Trial) -> WalkResult:
    outcome = _any(trial)
    score = WalkScore(
        name=trial.walk,
        floor=outcome.floor,
        t_ns=outcome.points.t_ns,
        covered=outcome.covered,
        scored=scored(trial, Scope.ALL),
        pipelines={
            name: PipelineScore(error_m=o.at_points.error_m, floor_right=o.at_points.floor_right)
            for name, o in trial.outcomes.items()
        },
    )
    return WalkResult(
        score=score,
        published={name: o.published for name, o in trial.outcomes.items()},
        settled={name: o.settled for name, o in trial.outcomes.items()},
    )


def _any(trial: Trial) -> Outcome:
    return next(iter(trial.outcomes.values()))
