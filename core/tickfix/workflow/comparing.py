"""Compares pipelines on the same walks, and writes the report."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from tickfix.api import Floats, Floor
from tickfix.evaluation.comparison.comparison_result import ComparisonResult
from tickfix.evaluation.comparison.comparison_run import floors_by_site, run_comparison
from tickfix.evaluation.comparison.evaluation_sites import surveyed_site
from tickfix.evaluation.comparison.pooled_metrics import Scope
from tickfix.evaluation.comparison.trials import TrialOptions
from tickfix.replay.recording_files import Progress, no_progress
from tickfix.workflow.pipelines import PipelineSpec, resolve_pipelines, warn_each
from tickfix.workflow.tracking import SiteSource, as_site, warn_untrained
from tickfix.workflow.walks import WalkSource, check_walks, find_walks

if TYPE_CHECKING:
    from pandas import DataFrame


def compare(
    pipelines: PipelineSpec,
    walks: WalkSource | Iterable[WalkSource] | None,
    site: SiteSource,
    *,
    baseline: str | None = None,
    metric: str = "mean",
    seeds: int = 1,
    seed: int | None = None,
    start_known: bool = False,
    strict: bool = False,
    workers: int | None = None,
    progress: Progress = no_progress,
) -> Comparison:
    """Run pipelines on the same walks and compare their errors at the waypoints.

    Args:
        pipelines: see :func:`tickfix.workflow.pipelines.resolve_pipelines`; a list, or a dictionary that names them.
        walks: recordings with waypoints, files, or folders; None for those that the site's survey held out.
        site: what the pipelines are built for.
        baseline: the pipeline that the others are compared with, by default the first.
        metric: what the verdicts are about: ``mean``, ``median``, ``p75``, ``p90``, ``p95``, ``rmse`` or ``ipin``.
            Choose it before looking at results.
        seeds: how many seeds each walk is run with, counted from ``seed``.
        seed: the first of the random seeds.
        start_known: give the pipelines the first waypoint.
        strict: raise where a stage fails.
        workers: processes; one for each core by default.
        progress: called as ``progress(what, done, total)``.

    Raises:
        ConfigError: for an unknown pipeline, baseline or metric, or no walks.
        TickfixError: when a walk cannot be read or an algorithm cannot be built.
    """
    config = resolve_pipelines(pipelines, seed=seed, strict=strict)
    surveyed = as_site(site)
    warn_untrained(surveyed, config)
    sources = find_walks(surveyed.held_out if walks is None else walks)
    warn_each(check_walks("walks", sources, surveyed))
    evaluation_site = surveyed_site(surveyed, surveyed.name, sources)
    first = config.kernel.seed
    options = TrialOptions(config=config, seeds=tuple(range(first, first + seeds)), start_known=start_known)
    result = run_comparison(
        options,
        [evaluation_site],
        baseline=baseline if baseline is not None else config.pipelines[0].name,
        metric=metric,
        command="tickfix.compare(…)  # from Python",
        processes=workers,
        progress=progress,
    )
    warn_each([f"{what} ({count} ticks)" for what, count in result.failures.items()])
    return Comparison(result=result, floors=floors_by_site([evaluation_site]))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class Comparison:
    """A comparison of pipelines on the same walks.

    Attributes:
        result: all of it; its ``as_json`` is what ``tickfix compare --json`` prints.
        floors: plans by names of site and floor, for the report.
    """

    result: ComparisonResult
    floors: Mapping[tuple[str, str], Floor]

    @property
    def pipelines(self) -> tuple[str, ...]:
        """Names of the pipelines, in their order."""
        return self.result.pipelines

    @property
    def verdicts(self) -> tuple[str, ...]:
        """One sentence for each pipeline against the baseline: which is better, by how much, how surely."""
        return tuple(comparison.verdict for comparison in self.result.verdicts())

    @property
    def errors(self) -> Mapping[str, Floats]:
        """By pipeline (m,) float64, metres: errors at the waypoints at which every pipeline had an estimate."""
        samples = self.result.samples[Scope.ALL]
        return MappingProxyType({name: errors.error_m for name, errors in samples.sample_errors.items()})

    def report(self, folder: str | PathLike[str], *, draw: int = 100) -> Path:
        """Write the report (HTML, Markdown, JSON, CSV) and return the path of its page.

        Args:
            folder: is made where it is missing; a report in it is replaced.
            draw: greatest number of walks to draw, the worst first.
        """
        from tickfix.evaluation.report.report_files import write_report  # noqa: PLC0415 - matplotlib is slow to import

        path = Path(folder)
        path.mkdir(parents=True, exist_ok=True)
        return write_report(self.result, self.floors, path, draw=draw)

    def to_pandas(self) -> DataFrame:
        """Return the figures of each pipeline, one row a pipeline, as ``tickfix compare`` prints them.

        Raises:
            ImportError: when pandas is not installed; the extra ``tickfix[pandas]`` brings it.
        """
        try:
            import pandas as pd  # noqa: PLC0415 - optional, and slow to import
        except ImportError as error:
            raise ImportError("Comparison.to_pandas needs pandas: pip install 'tickfix[pandas]'") from error
        return pd.DataFrame.from_dict(self._figures(), orient="index").rename_axis("pipeline")

    def __repr__(self) -> str:
        """Return the mean errors and the verdicts as lines of text."""
        means = {name: figures["mean_m"] for name, figures in self._figures().items()}
        known = ", ".join(f"{name} {np.nan if mean is None else mean:.2f} m" for name, mean in means.items())
        return "\n".join([f"<Comparison: {known}>", *self.verdicts])

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the table of figures, and the verdicts."""
        figures = self._figures()
        columns = list(next(iter(figures.values())))
        head = "".join(f"<th>{html.escape(name)}</th>" for name in ("pipeline", *columns))
        rows = []
        for name, row in figures.items():
            cells = "".join(f"<td>{_cell(row[column])}</td>" for column in columns)
            rows.append(f"<tr><th>{html.escape(name)}</th>{cells}</tr>")
        verdicts = "".join(f"<p>{html.escape(verdict)}</p>" for verdict in self.verdicts)
        return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>{verdicts}"

    def _figures(self) -> dict[str, dict[str, Any]]:
        return {
            name: {
                **summary.error_statistics.as_json(),
                "availability": summary.availability,
                "floor_probability": summary.floor_probability,
            }
            for name, summary in self.result.summary.pipelines.items()
        }


def _cell(value: Any) -> str:
    return "" if value is None else f"{value:.2f}" if isinstance(value, float) else html.escape(str(value))
