"""The report model: what a report of a comparison shows, independent of its format.

:func:`build_report` makes a :class:`ReportData` of a result: verdicts, tables, the worst walks and the provenance. The
terminal, HTML, Markdown and JSON renderers format it and compute nothing of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from tickfix.evaluation.comparison.comparison_result import ComparisonResult
from tickfix.evaluation.comparison.pooled_metrics import Scope, scored
from tickfix.evaluation.comparison.trials import Trial
from tickfix.evaluation.report.report_tables import (
    ReportTable,
    comparison_table,
    cost_table,
    error_tables,
    pooled_metrics_table,
    provenance_tables,
    site_table,
    track_table,
    uncertainty_table,
)


@dataclass(frozen=True, slots=True)
class Chart:
    """A figure of the report.

    Attributes:
        path: the SVG file.
        title, caption: above and below it.
        keeps_colors: whether its colours carry values, so that a dark page must not exchange them.
    """

    path: Path
    title: str
    caption: str
    keeps_colors: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class WorstCase:
    """The worst waypoint of one pipeline on one walk.

    Attributes:
        mean_m: mean error at the scored waypoints, metres.
        worst_m, worst_s: the greatest error, metres, and its time, seconds since the first waypoint.
        worst_sample: index of that waypoint.
        covered: whether the survey covers the waypoint.
        floor_right: whether the estimate was on the right floor.
        diagnosis: status, reasons and ages of the estimate there.
    """

    pipeline: str
    mean_m: float
    worst_m: float
    worst_s: float
    worst_sample: int
    covered: bool
    floor_right: bool
    diagnosis: str

    @property
    def remarks(self) -> str:
        """The diagnosis, preceded by what else explains the error."""
        floor = "" if self.floor_right else "wrong floor"
        return "; ".join(filter(None, (floor, "" if self.covered else "not surveyed", self.diagnosis)))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WorstWalk:
    """A walk with the worst waypoint of each pipeline; empty if no waypoint was scored."""

    trial: Trial
    worst_cases: tuple[WorstCase, ...]

    @property
    def mean_m(self) -> float:
        """Mean error of the worst pipeline, metres."""
        return max((worst_case.mean_m for worst_case in self.worst_cases), default=0.0)

    def table(self) -> ReportTable:
        """Return the worst waypoint of each pipeline as a table."""
        rows = tuple(
            (case.pipeline, f"{case.mean_m:.1f}", f"{case.worst_m:.1f}", f"{case.worst_s:.0f}", case.remarks)
            for case in self.worst_cases
        )
        columns = ("pipeline", "mean, m", "worst, m", "at, s", "state of the pipeline there")
        return ReportTable(caption="", columns=columns, rows=rows)


def worst_walks(trials: Sequence[Trial]) -> tuple[WorstWalk, ...]:
    """Return every walk once, with its worst seed, by falling mean error; walks without a scored waypoint last."""
    worst: dict[tuple[str, str], WorstWalk] = {}
    for trial in trials:
        walk = WorstWalk(trial=trial, worst_cases=_worst_cases(trial))
        name = (trial.site, trial.walk)
        if name not in worst or walk.mean_m > worst[name].mean_m:
            worst[name] = walk
    return tuple(sorted(worst.values(), key=lambda walk: (-walk.mean_m, walk.trial.site, walk.trial.walk)))


def _worst_cases(trial: Trial) -> tuple[WorstCase, ...]:
    kept = np.flatnonzero(scored(trial, Scope.ALL))
    if len(kept) == 0:
        return ()
    found = []
    for name, outcome in trial.outcomes.items():
        sample_errors = outcome.at_samples
        i = int(kept[np.argmax(sample_errors.error_m[kept])])
        found.append(
            WorstCase(
                pipeline=name,
                mean_m=float(np.mean(sample_errors.error_m[kept])),
                worst_m=float(sample_errors.error_m[i]),
                worst_s=float(outcome.samples.t_ns[i] - outcome.samples.t_ns[0]) * 1e-9,
                worst_sample=i,
                covered=bool(outcome.covered[i]),
                floor_right=bool(sample_errors.floor_right[i]),
                diagnosis=str(outcome.diagnoses[i]),
            )
        )
    return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """The verdict on one pipeline.

    Attributes:
        conclusion: ``better``, ``worse``, ``inconclusive`` or ``identical``.
        sentence: the verdict in words.
        worse_on: the walks on which the pipeline is worse than the baseline, as text; empty if there is none.
    """

    conclusion: str
    sentence: str
    worse_on: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportSection:
    """Tables under one title, with a note below them."""

    title: str
    tables: tuple[ReportTable, ...]
    note: str = ""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReportData:
    """What a report of a comparison shows, in any format.

    Attributes:
        pipelines: names, in the order of the configuration.
        summary: what was compared, in one sentence.
        pooled: the table of ``tickfix replay``.
        verdicts: on all scored waypoints; empty if there is nothing to compare, and ``no_verdict`` says why.
        covered_verdicts: on the waypoints covered by the survey, if it covers only part of them.
        verdict_note: how to read the verdicts.
        errors: error metrics of the pipelines by scope.
        details: differences, whole tracks, uncertainty, cost, and sites if there are several.
        walks: every walk, the worst first.
        several_seeds: whether walks were run with more than one seed.
        command: the command line that made the report.
        provenance: names and values.
        provenance_tables: parameters and digests.
        document: the object that ``tickfix compare --json`` prints.
    """

    pipelines: tuple[str, ...]
    summary: str
    pooled: ReportTable
    verdicts: tuple[Verdict, ...]
    covered_verdicts: tuple[Verdict, ...]
    no_verdict: str
    verdict_note: str
    errors: ReportSection
    details: tuple[ReportSection, ...]
    walks: tuple[WorstWalk, ...]
    several_seeds: bool
    command: str
    provenance: tuple[tuple[str, str], ...]
    provenance_tables: tuple[ReportTable, ...]
    document: Mapping[str, Any]

    @property
    def title(self) -> str:
        """The title: the pipelines, or their number if their names are long."""
        names = ", ".join(self.pipelines)
        return f"Comparison of {names if len(names) < 120 else f'{len(self.pipelines)} pipelines'}"


def build_report(result: ComparisonResult) -> ReportData:
    """Return the report model of a comparison."""
    walks = worst_walks(result.trials)
    seeds = result.provenance.get("seeds", [0])
    verdicts = _verdicts(result, Scope.ALL)
    alone = len(result.pipelines) == 1
    return ReportData(
        pipelines=result.pipelines,
        summary=_summary(result, len(walks), len(seeds)),
        pooled=pooled_metrics_table(result.summary),
        verdicts=verdicts,
        covered_verdicts=_verdicts(result, Scope.COVERED) if result.partly_covered else (),
        no_verdict="There is nothing to compare one pipeline with." if alone else "No waypoint was scored.",
        verdict_note=(
            "Differences are pipeline minus baseline. Intervals and tests resample whole chains of walks; p is "
            f"corrected for {_counted(len(verdicts), 'pipeline')} compared (Holm). The verdict is about the "
            f"{result.metric} over all scored waypoints."
        )
        if verdicts
        else "",
        errors=ReportSection(title="Errors", tables=error_tables(result)),
        details=_detail_sections(result),
        walks=walks,
        several_seeds=len(seeds) > 1,
        command=str(result.provenance.get("command", "")),
        provenance=_provenance_rows(result),
        provenance_tables=tuple(table for table in provenance_tables(result) if table.rows),
        document=result.as_json(),
    )


_MAX_WALKS_NAMED: Final = 12


def _verdicts(result: ComparisonResult, scope: Scope) -> tuple[Verdict, ...]:
    found = []
    for c in result.verdicts(scope):
        worse_on = ""
        if c.worse_walks and scope is Scope.ALL:
            named = ", ".join(f"{walk} (+{by_m:.1f} m)" for walk, by_m in c.worse_walks[:_MAX_WALKS_NAMED])
            rest = len(c.worse_walks) - _MAX_WALKS_NAMED
            worse_on = f"{named}{f' and {rest} more' if rest > 0 else ''}"
        found.append(Verdict(conclusion=c.conclusion.value, sentence=c.verdict, worse_on=worse_on))
    return tuple(found)


def _summary(result: ComparisonResult, walks: int, seeds: int) -> str:
    return (
        f"{_counted(walks, 'walk')} on {_counted(len(result.sites), 'site')}, {_counted(seeds, 'seed')}; "
        f"{len(result.samples[Scope.ALL])} errors at waypoints where every pipeline has an estimate, "
        f"{len(result.samples[Scope.COVERED])} of them covered by the survey. Baseline: {result.baseline}."
    )


def _detail_sections(result: ComparisonResult) -> tuple[ReportSection, ...]:
    sections = []
    if result.comparisons:
        caption = (
            f"Differences from {result.baseline} in metres; p of the paired test, alone and corrected for the "
            "pipelines of a metric and scope; number of walks that would show a difference of this size, and the "
            "difference that these walks would have shown, with a power of 80 %"
        )
        note = (
            "The verdict is about one metric that was chosen before the run. A search through this table for a small p "
            "finds one by chance sooner or later."
        )
        sections.append(
            ReportSection(title="Differences", tables=(comparison_table(result.comparisons, caption),), note=note)
        )
    sections += [
        ReportSection(title="Tracks", tables=(track_table(result),)),
        ReportSection(title="Uncertainty", tables=(uncertainty_table(result),)),
        ReportSection(title="Cost", tables=(cost_table(result),)),
    ]
    if len(result.sites) > 1:
        sections.append(ReportSection(title="Sites", tables=(site_table(result),)))
    return tuple(sections)


def _provenance_rows(result: ComparisonResult) -> tuple[tuple[str, str], ...]:
    p = result.provenance
    folds = p.get("crossvalidation")
    rows = (
        ("command", p.get("command", "")),
        ("folder", p.get("folder", "")),
        ("versions", ", ".join(f"{name} {version}" for name, version in p.get("versions", {}).items())),
        ("seeds", ", ".join(map(str, p.get("seeds", [])))),
        ("start", "first waypoint given" if p.get("start_known") else "unknown"),
        (
            "cross-validation",
            f"{folds['folds']} folds per floor, {folds['holdout_share']:g} of the walks held out" if folds else "",
        ),
        ("messages", ", ".join(f"{name} {count}" for name, count in result.summary.intake.items())),
        ("stage failures", ", ".join(f"{name} ({n} ticks)" for name, n in result.failures.items()) or "none"),
    )
    return tuple((name, str(value)) for name, value in rows if value != "")


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
