"""The experiment of a paper: runs it once per seed, on several processes, and collects tables and claims."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from tickfix.config import Registry
from tickfix.replay import parallel_map
from tickfix_papers.reproduction_report import Claim, PaperTable, ProgressCallback, Reproduction, TwinSetting

SeedResult = TypeVar("SeedResult")


def run_over_seeds(
    run: Callable[[int], SeedResult],
    seeds: Sequence[int],
    progress: ProgressCallback,
    label: str,
    *,
    processes: int | None = None,
) -> tuple[SeedResult, ...]:
    """Return ``run(seed)`` for each seed, in their order.

    Args:
        run: one repetition; everything random in it must come from generators that the seed makes.
        seeds: each once.
        progress: called after each repetition.
        label: of the work, for ``progress``.
        processes: number of processes, by default the number of cores.
    """
    progress(label, 0, len(seeds))
    results: list[SeedResult] = []
    for result in parallel_map(run, seeds, processes=processes):
        results.append(result)
        progress(label, len(results), len(seeds))
    return tuple(results)


class SeedRunProtocol(Protocol):
    """The result of one seed; each paper adds what its tables and claims need."""

    @property
    def failures(self) -> Mapping[str, int]:
        """Number of failures by kind."""


Run = TypeVar("Run", bound=SeedRunProtocol)


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment(Generic[Run]):
    """A paper's experiment, offered through an entry point of the group ``tickfix.experiments``.

    Attributes:
        paper, title: the key of the paper, and what is reproduced.
        run_seed: runs the experiment once; called with the registry of plugins and a seed, from which everything random
            must come. It must be picklable (a function of a module), since seeds run in several processes.
        twin_settings: the settings of the simulated twin, each with its source.
        tables, claims: the results over seeds beside the paper's.
        pictures: the module whose ``draw(runs, folder)`` draws the paper's figures and returns the files; imported only
            when pictures are requested, since matplotlib is slow to import. Empty if there is nothing to draw.
    """

    paper: str
    title: str
    run_seed: Callable[[Registry, int], Run]
    twin_settings: tuple[TwinSetting, ...]
    tables: Callable[[Sequence[Run]], tuple[PaperTable, ...]]
    claims: Callable[[Sequence[Run]], tuple[Claim, ...]]
    pictures: str = ""

    def reproduce(
        self,
        seeds: Sequence[int],
        progress: ProgressCallback,
        pictures: Path | None,
        *,
        registry: Registry,
        processes: int | None = None,
    ) -> Reproduction:
        """Run the experiment once per seed and collect the results.

        Args:
            seeds: at least two; the same seeds give the same figures.
            progress: called after each seed.
            pictures: an existing folder to draw into; None draws nothing.
            registry: the algorithms that plugins offer.
            processes: number of processes, by default the number of cores.

        Raises:
            SiteError: when something cannot be trained.
            TickfixError: when a pipeline cannot be built.
        """
        runs = run_over_seeds(partial(self.run_seed, registry), seeds, progress, self.paper, processes=processes)
        drawn = pictures is not None and self.pictures != ""
        failures: Counter[str] = Counter()
        for run in runs:
            failures.update(run.failures)
        return Reproduction(
            paper=self.paper,
            title=self.title,
            seeds=len(runs),
            twin_settings=self.twin_settings,
            tables=self.tables(runs),
            claims=self.claims(runs),
            pictures=tuple(import_module(self.pictures).draw(runs, pictures)) if drawn else (),
            failures=dict(sorted(failures.items())),
        )
