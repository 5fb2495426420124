"""``tickfix compare``: several pipelines on the same walks, and whether the difference can be believed."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from tickfix.api import ConfigError
from tickfix.cli.console import print_json, progress, registry, stdout, warn, warn_each
from tickfix.cli.replay import PipelineNames, StartMode, override_config, select_walks, warn_untrained
from tickfix.cli.survey import ConfigFile, Seed
from tickfix.config import Config, load_config
from tickfix.evaluation.comparison.comparison_result import METRICS
from tickfix.evaluation.comparison.comparison_run import floors_by_site, run_comparison
from tickfix.evaluation.comparison.evaluation_sites import (
    HOLDOUT_SHARE,
    EvaluationSite,
    crossvalidation_sites,
    evaluation_site_names,
    surveyed_site,
)
from tickfix.evaluation.comparison.trial_outcomes import OutcomeStore
from tickfix.evaluation.comparison.trials import TrialOptions
from tickfix.evaluation.report.report_data import build_report
from tickfix.evaluation.report.terminal import render_report
from tickfix.live.journal_replay import journaled_config, journaled_site, write_walks
from tickfix.registry import Registry
from tickfix.replay.recording_files import Progress, find_recordings
from tickfix.replay.site_survey import read_walks
from tickfix.site import is_site, load_site

_OUTCOMES = "outcomes"
_WALKS = "walks"


def compare(
    places: Annotated[
        list[Path] | None,
        typer.Argument(metavar="SITE… [WALK…]", help="Folders that `tickfix survey` made; recordings to run on one."),
    ] = None,
    *,
    report: Annotated[Path, typer.Option("--report", metavar="DIR", help="Folder for report and outcomes.")],
    journal: Annotated[
        Path | None, typer.Option("--journal", metavar="PATH", help="Run what a live run took in, on its site.")
    ] = None,
    holdout: Annotated[bool, typer.Option("--holdout", help="Run the walks that the surveys held out.")] = False,
    crossvalidate: Annotated[
        int | None,
        typer.Option("--crossvalidate", metavar="K", help="The places are recordings: survey and run them in K folds."),
    ] = None,
    holdout_share: Annotated[
        float,
        typer.Option("--holdout-share", min=0.0, max=1.0, help="Share of walks that cross-validation leaves alone."),
    ] = HOLDOUT_SHARE,
    config: ConfigFile = None,
    pipeline: PipelineNames = None,
    baseline: Annotated[
        str | None, typer.Option("--baseline", metavar="NAME", help="Compare with this one; the first without it.")
    ] = None,
    metric: Annotated[
        str, typer.Option("--metric", help=f"What the verdicts are about: {', '.join(METRICS)}. Choose it before.")
    ] = "mean",
    seeds: Annotated[int, typer.Option("--seeds", min=1, metavar="N", help="Run every walk with N seeds.")] = 1,
    seed: Seed = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, metavar="N", help="Processes; one a core without it.")
    ] = None,
    start: Annotated[StartMode, typer.Option("--start", help="What pipelines know of the start.")] = StartMode.UNKNOWN,
    draw: Annotated[
        int, typer.Option("--draw", min=0, metavar="N", help="Draw at most N walks, the worst first.")
    ] = 100,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Stop where a stage fails.")] = False,
) -> None:
    """Compare pipelines on the same walks: how much better, how surely, where, and at what cost."""
    plugins = registry()
    loaded = (
        load_config(config, plugins) if journal is None or config is not None else journaled_config(journal, plugins)
    )
    settings = override_config(loaded, pipeline, seed, strict=strict)
    places = list(places or [])
    if journal is not None:
        places = [*(places or [journaled_site(journal)]), *write_walks(journal, report / _WALKS)]
    names = [p.name for p in settings.pipelines]
    against = _require_known("--baseline", baseline or names[0], names)
    _require_known("--metric", metric, METRICS)
    first = settings.kernel.seed
    trial_options = TrialOptions(
        config=settings,
        seeds=tuple(range(first, first + seeds)),
        start_known=start is StartMode.FIRST_WAYPOINT,
        store=OutcomeStore(report / _OUTCOMES),
    )
    report.mkdir(parents=True, exist_ok=True)
    with progress() as show:
        if crossvalidate is None:
            evaluation_sites = _sites_from_folders(places, settings, config, plugins, holdout=holdout)
        else:
            if holdout:
                raise ConfigError("compare", "--holdout with --crossvalidate", "one of the two")
            evaluation_sites = _sites_from_folds(places, settings, plugins, crossvalidate, holdout_share, show)
        result = run_comparison(
            trial_options,
            evaluation_sites,
            baseline=against,
            metric=metric,
            command=shlex.join(["tickfix", *sys.argv[1:]]),
            crossvalidation=None if crossvalidate is None else {"folds": crossvalidate, "holdout_share": holdout_share},
            processes=workers,
            progress=show,
        )
    warn_each(tuple(f"{what} ({count} ticks)" for what, count in result.failures.items()), "failures")
    from tickfix.evaluation.report.report_files import write_report  # noqa: PLC0415 - matplotlib is slow to import

    page = write_report(result, floors_by_site(evaluation_sites), report, draw=draw)
    if as_json:
        print_json(result.as_json())
        return
    console = stdout()
    console.print(render_report(build_report(result)), soft_wrap=True)
    console.print(f"\nThe report is {page}", soft_wrap=True)


def _sites_from_folders(
    places: Sequence[Path], settings: Config, config: Path | None, plugins: Registry, *, holdout: bool
) -> tuple[EvaluationSite, ...]:
    sites = [(path, load_site(path)) for path in places if is_site(path)]
    walks = [path for path in places if not is_site(path)]
    if not sites:
        raise ConfigError("compare", f"no site among {', '.join(map(str, places))}", "a folder from `tickfix survey`")
    if len(sites) > 1 and walks:
        raise ConfigError("compare", "several SITEs with WALKs", "one SITE, or --holdout")
    evaluation_sites = []
    for name, (_, site) in zip(evaluation_site_names(sites), sites, strict=True):
        warn_untrained(site, settings, config)
        evaluation_sites.append(
            surveyed_site(site, name, select_walks("compare", site, walks, plugins, holdout=holdout))
        )
    return tuple(evaluation_sites)


def _sites_from_folds(
    places: Sequence[Path], settings: Config, plugins: Registry, count: int, holdout_share: float, show: Progress
) -> tuple[EvaluationSite, ...]:
    files = find_recordings(places, plugins)
    read = read_walks(files.sources, show)
    warn_each((*files.problems, *read.problems), "problems")
    seed = settings.kernel.seed
    evaluation_sites = crossvalidation_sites(
        read, settings.pipelines, count=count, holdout_share=holdout_share, seed=seed, progress=show, warn=warn
    )
    if not evaluation_sites:
        raise ConfigError("--crossvalidate", "no walk with waypoints on a floor", "recordings with truth")
    return evaluation_sites


def _require_known(option: str, name: str, known: Sequence[str]) -> str:
    if name not in known:
        raise ConfigError(option, repr(name), f"one of {', '.join(known)}")
    return name
