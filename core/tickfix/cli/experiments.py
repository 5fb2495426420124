"""Commands that run on simulated sites: ``tickfix demo``, and ``tickfix reproduce`` for the papers' experiments."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Annotated, Any, Final, Protocol

import typer
from rich.console import RenderableType

from tickfix.api import ConfigError
from tickfix.cli.console import print_json, progress, registry, stdout, warn_each
from tickfix.cli.replay import PipelineNames, override_config
from tickfix.cli.survey import ConfigFile
from tickfix.config import load_config
from tickfix.evaluation.report.terminal import pooled_table
from tickfix.evaluation.walk_runs import WalkOptions, draw_errors, pool_runs, prepare, run_walks
from tickfix.registry import Registry
from tickfix.replay.recording_files import Progress
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
"""The entry-point group of experiments; the name of an entry point is the key of the paper."""


class PaperExperiment(Protocol):
    """What an entry point of the group must refer to; ``tickfix_papers.Experiment`` is one implementation."""

    def reproduce(
        self,
        seeds: Sequence[int],
        progress: Progress,
        pictures: Path | None,
        *,
        registry: Registry,
        processes: int | None,
    ) -> PaperResult:
        """Run the experiment once per seed; draw the paper's figures into ``pictures`` if it is given."""


class PaperResult(Protocol):
    """What the command prints of an experiment."""

    @property
    def paper(self) -> str:
        """Key of the paper."""

    @property
    def pictures(self) -> Sequence[Path]:
        """Files drawn."""

    @property
    def failures(self) -> Mapping[str, int]:
        """Number of failed calls by kind; empty in a sound run."""

    def as_json(self) -> Mapping[str, Any]:
        """Return the object that ``--json`` prints under the key of the paper."""

    def render(self, *, twin_settings: bool) -> RenderableType:
        """Return tables and claims for the terminal."""


def _load_experiment(point: EntryPoint) -> PaperExperiment:
    """Return the experiment of an entry point.

    Raises:
        ConfigError: naming package and entry point, when the import fails or the object has no ``reproduce``.
    """
    where = f"experiment {point.name!r} of {point.dist.name if point.dist else 'an unknown package'} ({point.value})"
    try:
        found = point.load()
    except Exception as error:  # a third party's import may raise anything
        raise ConfigError(where, f"{type(error).__name__}: {error}", "a module that can be imported") from error
    if not callable(getattr(found, "reproduce", None)):
        raise ConfigError(where, f"a {type(found).__name__} without reproduce()", "an Experiment")
    experiment: PaperExperiment = found
    return experiment


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
    results: list[PaperResult] = []
    seconds: list[float] = []
    with progress() as show:
        for name in experiments if paper == "all" else (paper,):
            began = time.perf_counter()
            experiment = _load_experiment(experiments[name])
            result = experiment.reproduce(range(seeds), show, pictures, registry=plugins, processes=workers)
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
