"""``tickfix demo``: survey a simulated floor, walk it, track the walks, compare."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from tickfix.cli.output import print_json, progress, registry, stdout, warn_of
from tickfix.cli.replay import PipelineNames, configured
from tickfix.cli.survey import ConfigFile
from tickfix.config import load
from tickfix.drivers.surveying import survey_walks
from tickfix.evaluation.run import Wishes, draw_errors, pool, prepare, run_walks
from tickfix.evaluation.tables import pooled_table
from tickfix.site.folder import save as save_site


def demo(
    *,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the pictures.")] = Path("tickfix-demo"),
    seed: Annotated[int, typer.Option("--seed", min=0, metavar="N", help="Another building, other people.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    config: ConfigFile = None,
    pipeline: PipelineNames = None,
) -> None:
    """See it work: survey a simulated office, track five people through it with several pipelines, and compare."""
    from tickfix.simulation import demo as simulate  # noqa: PLC0415 - slow to import, and no other command needs it

    began = time.perf_counter()
    found = registry()
    settings = configured(load(config, found), pipeline, seed)
    out.mkdir(parents=True, exist_ok=True)
    with progress() as show:
        show("simulating", 0, 1)
        scene = simulate(seed)
        show("simulating", 1, 1)
        surveyed = survey_walks(
            [walk.recording for walk in scene.survey],
            scene.building.floors,
            settings.pipelines,
            name="demo",
            seed=seed,
            progress=show,
        )
        bench = prepare(surveyed.site, settings)
        runs = []
        show("tracking", 0, len(scene.walks))
        wishes = Wishes(pictures=out, moving=scene.walks[0].recording.name)
        for run in run_walks(bench, [walk.recording for walk in scene.walks], wishes):
            runs.append(run)
            show("tracking", len(runs), len(scene.walks))
    save_site(surveyed.site, out / "site")
    draw_errors(runs, out / "cdf.png")
    summary, failures = pool(runs)
    warn_of((*surveyed.problems, *(f"{what} ({count} ×)" for what, count in failures.items())), "problems")
    if as_json:
        print_json(summary.as_json())
        return
    console = stdout()
    console.print(pooled_table(summary))
    seconds = time.perf_counter() - began
    console.print(f"{len(scene.survey)} walks surveyed, {len(runs)} tracked in {seconds:.0f} s. Pictures:")
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
