"""The experiment of a paper.

Runs it once per seed, on several processes, and collects tables and claims; and the registry of papers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Generic, Protocol, TypeVar

from tickfix.registry import Registry
from tickfix.replay.process_pool import parallel_map
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
        progress: told after each repetition.
        label: of the work, for ``progress``.
        processes: how many work at once, by default as many as there are cores.
    """
    progress(label, 0, len(seeds))
    results: list[SeedResult] = []
    for result in parallel_map(run, seeds, processes=processes):
        results.append(result)
        progress(label, len(results), len(seeds))
    return tuple(results)


class SeedRunProtocol(Protocol):
    """What one seed gives; each paper adds what its tables and claims are about."""

    @property
    def failures(self) -> Mapping[str, int]:
        """What failed, and how often."""


Run = TypeVar("Run", bound=SeedRunProtocol)


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment(Generic[Run]):
    """A paper's experiment: what its module offers as ``EXPERIMENT``.

    Attributes:
        paper, title: its key, and what is reproduced.
        run_seed: runs it once, given what the plugins offer and a seed, from which everything random in it comes.
        twin_settings: the twin.
        tables, claims: what the repetitions say, beside the paper's figures.
        pictures: the module whose ``draw(runs, folder)`` draws and returns the files; imported when pictures are asked
            for, since matplotlib is slow to import.
    """

    paper: str
    title: str
    run_seed: Callable[[Registry, int], Run]
    twin_settings: tuple[TwinSetting, ...]
    tables: Callable[[Sequence[Run]], tuple[PaperTable, ...]]
    claims: Callable[[Sequence[Run]], tuple[Claim, ...]]
    pictures: str

    def reproduce(
        self,
        seeds: Sequence[int],
        progress: ProgressCallback,
        pictures: Path | None,
        *,
        registry: Registry,
        processes: int | None = None,
    ) -> Reproduction:
        """Run the experiment once per seed and bring the figures together.

        Args:
            seeds: at least two; the same ones give the same figures.
            progress: told how far it is.
            pictures: folder to draw into, which exists; None draws nothing.
            registry: what the plugins offer.
            processes: how many seeds run at once, by default as many as there are cores.

        Raises:
            SiteError: when something cannot be trained.
            TickfixError: when a pipeline cannot be built.
        """
        runs = run_over_seeds(partial(self.run_seed, registry), seeds, progress, self.paper, processes=processes)
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
            pictures=() if pictures is None else import_module(self.pictures).draw(runs, pictures),
            failures=dict(sorted(failures.items())),
        )


PAPERS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "jiang2015": "tickfix_papers.jiang2015",
        "sun2013": "tickfix_papers.sun2013",
        "wang2015": "tickfix_papers.wang2015",
    }
)
"""The module of each paper that offers its ``EXPERIMENT``, in the order in which ``all`` runs them."""


def load_experiment(paper: str) -> Experiment[Any]:
    """Return the experiment of a paper.

    Raises:
        ValueError: naming the papers there are.
    """
    if paper not in PAPERS:
        raise ValueError(f"paper: found {paper!r}, expected one of {', '.join(PAPERS)}")
    found: Experiment[Any] = import_module(PAPERS[paper]).EXPERIMENT
    return found
