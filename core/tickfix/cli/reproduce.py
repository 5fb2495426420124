"""``tickfix reproduce``: the papers' experiments on simulated twins of their sites."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from tickfix.api import ConfigError
from tickfix.cli.output import print_json, progress, registry, stdout, warn_of
from tickfix.reproduction.papers import PAPERS, experiment
from tickfix.reproduction.printing import printed


def reproduce(
    paper: Annotated[str, typer.Argument(metavar="PAPER", help=f"One of {', '.join(PAPERS)}, or all.")],
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
    choices: Annotated[bool, typer.Option("--choices", help="Print the settings of the twin, too.")] = False,
) -> None:
    """Run a paper's experiment again on a simulated twin of its site: its tables beside ours, and which claims hold."""
    if paper != "all" and paper not in PAPERS:
        raise ConfigError("tickfix reproduce", repr(paper), f"one of {', '.join(PAPERS)}, all")
    found = registry()
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
    results, seconds = [], []
    with progress() as show:
        for name in PAPERS if paper == "all" else (paper,):
            began = time.perf_counter()
            again = experiment(name).reproduce(range(seeds), show, pictures, registry=found, processes=workers)
            results.append(again)
            seconds.append(time.perf_counter() - began)
    for result in results:
        failures = tuple(f"{result.paper}: {what} ({count} ×)" for what, count in result.failures.items())
        warn_of(failures, "failures")
    if as_json:
        print_json({result.paper: result.as_json() for result in results})
        return
    console = stdout()
    for result, took in zip(results, seconds, strict=True):
        console.print(printed(result, choices=choices))
        for path in result.pictures:
            console.print(f"  {path}", soft_wrap=True)
        console.print(f"[{result.paper}] took {took:.0f} s", soft_wrap=True)
