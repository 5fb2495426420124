"""``tickfix replay``: recordings through pipelines, scored against their waypoints.

With ``--journal`` a live run once more, compared byte by byte.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from tickfix.api import ConfigError, SiteError
from tickfix.cli.console import print_json, progress, registry, stdout, warn, warn_each
from tickfix.cli.survey import ConfigFile, Seed
from tickfix.config import Config, load_config
from tickfix.evaluation.report.terminal import pooled_table, walk_table
from tickfix.evaluation.walk_runs import (
    RunSetup,
    WalkOptions,
    WalkRun,
    draw_errors,
    pool_runs,
    prepare,
    run_walks,
    untrained,
)
from tickfix.live.journal_replay import JournalReplay, replay_journal
from tickfix.registry import Registry
from tickfix.replay.recording_files import RecordingFile, find_recordings
from tickfix.sinks.file_sinks import SinkTarget, open_sink, sink_for
from tickfix.site import Site, load_site
from tickfix.workflow.walks import check_walks


def select_walks(
    command: str, site: Site, walks: Sequence[Path], plugins: Registry, *, holdout: bool
) -> tuple[RecordingFile, ...]:
    """Return the walks given, or those that the survey held out.

    Raises:
        ConfigError: for both or neither, and for walks that share a name.
        SiteError: when no walk was held out, or one is gone.
    """
    if holdout and walks:
        raise ConfigError(command, "both WALKs and --holdout", "one of the two")
    if not holdout and not walks:
        raise ConfigError(command, "no walks", "recordings after SITE, or --holdout")
    if holdout and not site.held_out:
        raise SiteError(f"site {site.name!r}: no walk was held out; survey again with --holdout 0.3")
    files = find_recordings([held.file() for held in site.held_out] if holdout else walks, plugins)
    warn_each(files.problems, "problems of readers")
    warn_each(check_walks(command, files.sources, site), "walks")
    return files.sources


def warn_untrained(site: Site, settings: Config, config: Path | None) -> None:
    """Warn of algorithms that learn, but for whose parameters the site has no model."""
    for label in untrained(site, settings):
        again = "tickfix survey" if config is None else f"tickfix survey --config {config}"
        warn(f"{label}: the site has no model for these parameters; it runs untrained. Survey again: {again} …")


def replay_and_verify_journal(journal: Path, site: Path | None, *, as_json: bool) -> None:
    """Repeat a journal and say what came of it; the exit code is 1 where anything differs."""
    plugins = registry()
    with progress() as show:
        repetition = replay_journal(journal, plugins, site=site, progress=show)
    warn_each(tuple(map(str, repetition.damage)), "damaged places")
    warn_each((*repetition.skipped, *repetition.warnings), "warnings")
    if as_json:
        print_json(_journal_replay_json(repetition))
    else:
        _print_journal_replay(repetition)
    if repetition.differences:
        raise typer.Exit(1)


def _print_journal_replay(repetition: JournalReplay) -> None:
    console = stdout()
    console.print(
        f"run {repetition.run}: {repetition.segments} segments repeated, {repetition.estimates} estimates and "
        f"{repetition.revisions} revisions compared"
    )
    if repetition.first is None:
        console.print(f"every byte is the same; published {repetition.published}", soft_wrap=True)
    else:
        warn(f"{repetition.differences} differ, the first: {repetition.first}")


def _journal_replay_json(repetition: JournalReplay) -> dict[str, object]:
    plain = {name: value for name, value in asdict(repetition).items() if name not in ("first", "damage")}
    plain["first_difference"] = None if repetition.first is None else str(repetition.first)
    plain["damage"] = [str(damage) for damage in repetition.damage]
    plain["identical"] = repetition.differences == 0
    return plain


class StartMode(StrEnum):
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
    start: Annotated[StartMode, typer.Option("--start", help="What pipelines know of the start.")] = StartMode.UNKNOWN,
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
        replay_and_verify_journal(journal, site, as_json=as_json)
        return
    if site is None:
        raise ConfigError("replay", "no SITE", "the folder that `tickfix survey` made, or --journal PATH")
    plugins = registry()
    settings = override_config(load_config(config, plugins), pipeline, seed, strict=strict)
    sink = None if out is None else SinkTarget(sink_for(out, plugins), out)
    surveyed = load_site(site)
    sources = select_walks("replay", surveyed, walks or [], plugins, holdout=holdout)
    warn_untrained(surveyed, settings, config)
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
    options = WalkOptions(start_known=start is StartMode.FIRST_WAYPOINT, pictures=pictures, estimates=sink is not None)
    runs = _run_walks(prepare(surveyed, settings, plugins.observers), sources, options, sink)
    summary, failures = pool_runs(runs)
    warn_each(tuple(f"{what} ({count} ×)" for what, count in failures.items()), "failures")
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


def _run_walks(
    setup: RunSetup, sources: Sequence[RecordingFile], options: WalkOptions, target: SinkTarget | None
) -> list[WalkRun]:
    runs: list[WalkRun] = []
    with progress() as show, nullcontext() if target is None else open_sink(target) as write:
        show("replaying", 0, len(sources))
        for run in run_walks(setup, sources, options):
            if write is not None:
                for estimate in run.estimates:
                    write(estimate)
            runs.append(replace(run, estimates=()))
            show("replaying", len(runs), len(sources))
    if options.pictures is not None:
        draw_errors(runs, options.pictures / "cdf.png")
    if options.start_known:
        blind = tuple(run.result.score.name for run in runs if not run.start_known)
        warn_each(tuple(f"{name}: has no waypoint, so its start is unknown" for name in blind), "such walks")
    return runs


def override_config(settings: Config, pipelines: list[str] | None, seed: int | None, *, strict: bool = False) -> Config:
    """Return the settings as the command line changes them."""
    kernel = replace(settings.kernel, strict=strict, seed=settings.kernel.seed if seed is None else seed)
    return replace(settings.only(pipelines) if pipelines else settings, kernel=kernel)
