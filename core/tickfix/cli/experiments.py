"""Commands that run on simulated sites: ``tickfix demo``, and ``tickfix reproduce`` for the papers' experiments."""

from __future__ import annotations

import time
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Final

import typer

from tickfix.api import ConfigError
from tickfix.cli.console import print_json, progress, registry, stdout, warn_each
from tickfix.cli.replay import PipelineNames, override_config
from tickfix.cli.survey import ConfigFile
from tickfix.config import load_config
from tickfix.evaluation.report.terminal import pooled_table
from tickfix.evaluation.walk_runs import WalkOptions, draw_errors, pool_runs, prepare, run_walks
from tickfix.replay.site_survey import survey_and_train
from tickfix.site import save_site


def demo(
    *,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the pictures.")] = Path("tickfix-demo"),
    seed: Annotated[int, typer.Option("--seed", min=0, metavar="N", help="Another building, other people.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    config: ConfigFile = None,
    pipeline: PipelineNames = None,
) -> None:
    """See it work: survey a simulated office, track five people through it with several pipelines, and compare."""
    from tickfix.simulation import simulate_demo  # noqa: PLC0415 - slow to import, and no other command needs it

    began = time.perf_counter()
    plugins = registry()
    settings = override_config(load_config(config, plugins), pipeline, seed)
    out.mkdir(parents=True, exist_ok=True)
    with progress() as show:
        show("simulating", 0, 1)
        scenario = simulate_demo(seed)
        show("simulating", 1, 1)
        surveyed = survey_and_train(
            [walk.recording for walk in scenario.survey],
            scenario.building.floors,
            settings.pipelines,
            name="demo",
            seed=seed,
            progress=show,
        )
        setup = prepare(surveyed.site, settings)
        runs = []
        show("tracking", 0, len(scenario.walks))
        options = WalkOptions(pictures=out, animated=scenario.walks[0].recording.name)
        for run in run_walks(setup, [walk.recording for walk in scenario.walks], options):
            runs.append(run)
            show("tracking", len(runs), len(scenario.walks))
    save_site(surveyed.site, out / "site")
    draw_errors(runs, out / "cdf.png")
    summary, failures = pool_runs(runs)
    warn_each((*surveyed.problems, *(f"{what} ({count} ×)" for what, count in failures.items())), "problems")
    if as_json:
        print_json(summary.as_json())
        return
    console = stdout()
    console.print(pooled_table(summary))
    seconds = time.perf_counter() - began
    console.print(f"{len(scenario.survey)} walks surveyed, {len(runs)} tracked in {seconds:.0f} s. Pictures:")
    for path in sorted([*out.glob("*.gif"), *out.glob("*.png")]):
        console.print(f"  {path}", soft_wrap=True)
    last = settings.pipelines[-1].filter.offer.label
    console.print(
        "\nNext:\n"
        "  tickfix plugins                          which algorithms there are\n"
        f"  {f'tickfix plugins show {last}':<40} what one does, its parameters, its paper\n"
        "  tickfix survey --help                    your own recordings",
        soft_wrap=True,
    )


EXPERIMENTS: Final = "tickfix.experiments"
"""The entry-point group of experiments: each entry is an object with ``reproduce``, as a paper's ``EXPERIMENT``."""


def reproduce(
    paper: Annotated[str, typer.Argument(metavar="PAPER", help="The paper's key, or all.")],
    *,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    pictures: Annotated[
        Path | None, typer.Option("--pictures", metavar="DIR", help="Draw the paper's figures again.")
    ] = None,
    seeds: Annotated[
        int, typer.Option("--seeds", min=2, metavar="N", help="How often to repeat each experiment.")
    ] = 10,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, metavar="N", help="Processes; as many as there are cores.")
    ] = None,
    twin_settings: Annotated[
        bool, typer.Option("--twin-settings", help="Print the settings of the twin, too.")
    ] = False,
) -> None:
    """Run a paper's experiment again on a simulated twin of its site: its tables beside ours, and which claims hold."""
    experiments = {point.name: point for point in sorted(entry_points(group=EXPERIMENTS), key=lambda p: p.name)}
    if paper != "all" and paper not in experiments:
        raise ConfigError("tickfix reproduce", repr(paper), ", ".join(["one of all", *experiments]))
    plugins = registry()
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
    results, seconds = [], []
    with progress() as show:
        for name in experiments if paper == "all" else (paper,):
            began = time.perf_counter()
            result = (
                experiments[name].load().reproduce(range(seeds), show, pictures, registry=plugins, processes=workers)
            )
            results.append(result)
            seconds.append(time.perf_counter() - began)
    for result in results:
        failures = tuple(f"{result.paper}: {what} ({count} ×)" for what, count in result.failures.items())
        warn_each(failures, "failures")
    if as_json:
        print_json({result.paper: result.as_json() for result in results})
        return
    console = stdout()
    for result, took in zip(results, seconds, strict=True):
        console.print(result.render(twin_settings=twin_settings))
        for path in result.pictures:
            console.print(f"  {path}", soft_wrap=True)
        console.print(f"[{result.paper}] took {took:.0f} s", soft_wrap=True)
