"""``tickfix replay``: recordings through pipelines, scored against their waypoints."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from tickfix.api import ConfigError
from tickfix.cli.output import print_json, progress, registry, stdout, warn_of
from tickfix.cli.repeating import repeat
from tickfix.cli.sinks import Target, opened, sink_for
from tickfix.cli.survey import ConfigFile, Seed
from tickfix.cli.walks import chosen_walks, warn_untrained
from tickfix.config import Config, load
from tickfix.drivers.recordings import Source
from tickfix.evaluation.run import Bench, WalkRun, Wishes, draw_errors, pool, prepare, run_walks
from tickfix.evaluation.tables import pooled_table, walk_table
from tickfix.site.folder import load as load_site


class Start(StrEnum):
    """What pipelines are told of where a walk begins."""

    UNKNOWN = "unknown"
    FIRST_WAYPOINT = "first-waypoint"


PipelineNames = Annotated[
    list[str] | None, typer.Option("--pipeline", metavar="NAME", help="Run only this one; may be given several times.")
]


def replay(
    site: Annotated[Path | None, typer.Argument(metavar="SITE", help="Folder that `tickfix survey` made.")] = None,
    walks: Annotated[
        list[Path] | None, typer.Argument(metavar="[WALK…]", help="Recordings, or folders of them.")
    ] = None,
    *,
    journal: Annotated[
        Path | None,
        typer.Option("--journal", metavar="PATH", help="Repeat what a live run did, and compare byte by byte."),
    ] = None,
    holdout: Annotated[bool, typer.Option("--holdout", help="Replay the walks that the survey held out.")] = False,
    config: ConfigFile = None,
    pipeline: PipelineNames = None,
    start: Annotated[Start, typer.Option("--start", help="What pipelines know of the start.")] = Start.UNKNOWN,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    by_walk: Annotated[bool, typer.Option("--walks", help="Print a table of the walks, too.")] = False,
    pictures: Annotated[
        Path | None, typer.Option("--pictures", metavar="DIR", help="Draw every walk, and the errors.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write the published estimates, by the file's ending.")
    ] = None,
    seed: Seed = None,
    strict: Annotated[bool, typer.Option("--strict", help="Stop where a stage fails.")] = False,
) -> None:
    """Replay walks as they were logged, a position every 200 ms, and compare pipelines at the waypoints."""
    if journal is not None:
        repeat(journal, site, as_json=as_json)
        return
    if site is None:
        raise ConfigError("replay", "no SITE", "the folder that `tickfix survey` made, or --journal PATH")
    found = registry()
    settings = configured(load(config, found), pipeline, seed, strict=strict)
    sink = None if out is None else Target(sink_for(out, found), out)
    surveyed = load_site(site)
    sources = chosen_walks("replay", surveyed, walks or [], found, holdout=holdout)
    warn_untrained(surveyed, settings, config)
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
    wishes = Wishes(start_known=start is Start.FIRST_WAYPOINT, pictures=pictures, estimates=sink is not None)
    runs = _run(prepare(surveyed, settings), sources, wishes, sink)
    summary, failures = pool(runs)
    warn_of(tuple(f"{what} ({count} ×)" for what, count in failures.items()), "failures")
    if as_json:
        print_json(summary.as_json())
        return
    console = stdout()
    if by_walk:
        console.print(walk_table(summary))
    console.print(pooled_table(summary))
    for what, where in {"Pictures": pictures, "Estimates": out}.items():
        if where is not None:
            console.print(f"{what} are in {where}", soft_wrap=True)


def _run(bench: Bench, sources: Sequence[Source], wishes: Wishes, target: Target | None) -> list[WalkRun]:
    runs: list[WalkRun] = []
    with progress() as show, nullcontext() if target is None else opened(target) as write:
        show("replaying", 0, len(sources))
        for run in run_walks(bench, sources, wishes):
            if write is not None:
                for estimate in run.estimates:
                    write(estimate)
            runs.append(replace(run, estimates=()))
            show("replaying", len(runs), len(sources))
    if wishes.pictures is not None:
        draw_errors(runs, wishes.pictures / "cdf.png")
    if wishes.start_known:
        blind = tuple(run.result.score.name for run in runs if not run.start_known)
        warn_of(tuple(f"{name}: has no waypoint, so its start is unknown" for name in blind), "such walks")
    return runs


def configured(settings: Config, pipelines: list[str] | None, seed: int | None, *, strict: bool = False) -> Config:
    """Return the settings as the command line changes them."""
    kernel = replace(settings.kernel, strict=strict, seed=settings.kernel.seed if seed is None else seed)
    return replace(settings.only(pipelines) if pipelines else settings, kernel=kernel)
