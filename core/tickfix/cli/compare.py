"""``tickfix compare``: several pipelines on the same walks, and whether the difference can be believed."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from tickfix.api import ConfigError, Floor
from tickfix.cli.output import print_json, progress, registry, stdout, warn, warn_of
from tickfix.cli.replay import PipelineNames, Start, configured
from tickfix.cli.survey import ConfigFile, Seed
from tickfix.cli.walks import chosen_walks, warn_untrained
from tickfix.config import Config, load
from tickfix.drivers.live.runs.recorded import journaled_config, journaled_site, write_walks
from tickfix.drivers.recordings import Progress, find
from tickfix.drivers.surveying import read_walks
from tickfix.evaluation.comparison.folds import SPARE, fold_grounds
from tickfix.evaluation.comparison.grounds import Ground, ground_names, ground_of
from tickfix.evaluation.comparison.points import Scope
from tickfix.evaluation.comparison.result import METRICS, Result, result_of
from tickfix.evaluation.comparison.store import Store
from tickfix.evaluation.comparison.trial import Terms, Trial, run_ground, settings_of
from tickfix.evaluation.comparison.versions import code_digest, versions
from tickfix.evaluation.tables import pooled_table
from tickfix.plugins import Registry
from tickfix.site.folder import load as load_site
from tickfix.site.manifest import is_site

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
    spare: Annotated[
        float, typer.Option("--spare", min=0.0, max=1.0, help="Share of walks that cross-validation leaves alone.")
    ] = SPARE,
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
    start: Annotated[Start, typer.Option("--start", help="What pipelines know of the start.")] = Start.UNKNOWN,
    draw: Annotated[
        int, typer.Option("--draw", min=0, metavar="N", help="Draw at most N walks, the worst first.")
    ] = 100,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Stop where a stage fails.")] = False,
) -> None:
    """Compare pipelines on the same walks: how much better, how surely, where, and at what cost."""
    found = registry()
    loaded = load(config, found) if journal is None or config is not None else journaled_config(journal, found)
    settings = configured(loaded, pipeline, seed, strict=strict)
    places = list(places or [])
    if journal is not None:
        places = [*(places or [journaled_site(journal)]), *write_walks(journal, report / _WALKS)]
    names = [p.name for p in settings.pipelines]
    against = _among("--baseline", baseline or names[0], names)
    _among("--metric", metric, METRICS)
    first = settings.kernel.seed
    terms = Terms(
        config=settings,
        seeds=tuple(range(first, first + seeds)),
        start_known=start is Start.FIRST_WAYPOINT,
        store=Store(report / _OUTCOMES),
    )
    report.mkdir(parents=True, exist_ok=True)
    with progress() as show:
        if crossvalidate is None:
            grounds = _surveyed(places, settings, config, found, holdout=holdout)
        else:
            if holdout:
                raise ConfigError("compare", "--holdout with --crossvalidate", "one of the two")
            grounds = _folded(places, settings, found, crossvalidate, spare, show)
        trials = _run(terms, grounds, workers, show)
    provenance = _provenance(terms, grounds, crossvalidate, spare)
    result = result_of(trials, baseline=against, metric=metric, provenance=provenance)
    warn_of(tuple(f"{what} ({count} ticks)" for what, count in result.failures.items()), "failures")
    from tickfix.evaluation.report.folder import write_report  # noqa: PLC0415 - matplotlib is slow to import

    page = write_report(result, _floors(grounds), report, draw=draw)
    if as_json:
        print_json(result.as_json())
        return
    _print(result, page)


def _print(result: Result, page: Path) -> None:
    console = stdout()
    console.print(pooled_table(result.summary))
    for verdict in result.verdicts():
        console.print(verdict.verdict, soft_wrap=True)
    if result.partly_covered:
        console.print("\nAt the waypoints covered by the survey:")
        for verdict in result.verdicts(Scope.COVERED):
            console.print(verdict.verdict, soft_wrap=True)
    console.print(f"\nThe report is {page}", soft_wrap=True)


def _surveyed(
    places: Sequence[Path], settings: Config, config: Path | None, found: Registry, *, holdout: bool
) -> tuple[Ground, ...]:
    sites = [(path, load_site(path)) for path in places if is_site(path)]
    walks = [path for path in places if not is_site(path)]
    if not sites:
        raise ConfigError("compare", f"no site among {', '.join(map(str, places))}", "a folder from `tickfix survey`")
    if len(sites) > 1 and walks:
        raise ConfigError("compare", "several SITEs with WALKs", "one SITE, or --holdout")
    grounds = []
    for name, (_, site) in zip(ground_names(sites), sites, strict=True):
        warn_untrained(site, settings, config)
        grounds.append(ground_of(site, name, chosen_walks("compare", site, walks, found, holdout=holdout)))
    return tuple(grounds)


def _folded(
    places: Sequence[Path], settings: Config, found: Registry, count: int, spare: float, show: Progress
) -> tuple[Ground, ...]:
    files = find(places, found)
    read = read_walks(files.sources, show)
    warn_of((*files.problems, *read.problems), "problems")
    seed = settings.kernel.seed
    grounds = fold_grounds(read, settings.pipelines, count=count, spare=spare, seed=seed, progress=show, tell=warn)
    if not grounds:
        raise ConfigError("--crossvalidate", "no walk with waypoints on a floor", "recordings with truth")
    return grounds


def _run(terms: Terms, grounds: Sequence[Ground], workers: int | None, show: Progress) -> list[Trial]:
    total = sum(len(ground.walks) for ground in grounds) * len(terms.seeds)
    trials: list[Trial] = []
    show("comparing", 0, total)
    for ground in grounds:
        for trial in run_ground(terms, ground, processes=workers):
            trials.append(trial)
            show("comparing", len(trials), total)
    return trials


def _floors(grounds: Sequence[Ground]) -> dict[tuple[str, str], Floor]:
    return {(ground.name, floor.name): floor for ground in grounds for floor in ground.floors}


def _provenance(terms: Terms, grounds: Sequence[Ground], folds: int | None, spare: float) -> dict[str, Any]:
    pipelines = terms.config.pipelines
    return {
        "command": shlex.join(["tickfix", *sys.argv[1:]]),
        "folder": str(Path.cwd()),
        "versions": dict(versions(pipelines)),
        "code": {pipeline.name: code_digest(pipeline) for pipeline in pipelines},
        "pipelines": {pipeline.name: dict(settings_of(pipeline)) for pipeline in pipelines},
        "sweeps": {p.name: {"table": p.table, "values": dict(p.swept)} for p in pipelines if p.swept},
        "seeds": list(terms.seeds),
        "start_known": terms.start_known,
        "horizon_s": terms.config.kernel.horizon_s,
        "crossvalidation": None if folds is None else {"folds": folds, "spare": spare},
        "grounds": [{"name": g.name, "site": g.digest, "walks": len(g.walks)} for g in grounds],
    }


def _among(option: str, name: str, known: Sequence[str]) -> str:
    if name not in known:
        raise ConfigError(option, repr(name), f"one of {', '.join(known)}")
    return name
