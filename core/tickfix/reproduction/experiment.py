"""How the experiment of a paper is run again: the same for every paper."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from tickfix.plugins import Registry
from tickfix.reproduction.report import Choice, Claim, Reproduction, Show, Table
from tickfix.reproduction.seeds import over_seeds


class Repeated(Protocol):
    """What one seed gives; each paper adds what its tables and claims are about."""

    @property
    def failures(self) -> Mapping[str, int]:
        """What failed, and how often."""


Run = TypeVar("Run", bound=Repeated)


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment(Generic[Run]):
    """A paper's experiment: what its module offers as ``EXPERIMENT``.

    Attributes:
        paper, title: its key, and what is reproduced.
        repeat: runs it once, given what the plugins offer and a seed, from which everything random in it comes.
        choices: the twin.
        tables, claims: what the repetitions say, beside the paper's figures.
        pictures: the module whose ``draw(runs, folder)`` draws and returns the files; imported when pictures are asked
            for, since matplotlib is slow to import.
    """

    paper: str
    title: str
    repeat: Callable[[Registry, int], Run]
    choices: tuple[Choice, ...]
    tables: Callable[[Sequence[Run]], tuple[Table, ...]]
    claims: Callable[[Sequence[Run]], tuple[Claim, ...]]
    pictures: str

    def reproduce(
        self,
        seeds: Sequence[int],
        show: Show,
        pictures: Path | None,
        *,
        registry: Registry,
        processes: int | None = None,
    ) -> Reproduction:
        """Run the experiment once per seed and bring the figures together.

        Args:
            seeds: at least two; the same ones give the same figures.
            show: told how far it is.
            pictures: folder to draw into, which exists; None draws nothing.
            registry: what the plugins offer.
            processes: how many seeds run at once, by default as many as there are cores.

        Raises:
            SiteError: when something cannot be trained.
            TickfixError: when a pipeline cannot be built.
        """
        runs = over_seeds(partial(self.repeat, registry), seeds, show, self.paper, processes=processes)
        failures: Counter[str] = Counter()
        for run in runs:
            failures.update(run.failures)
        return Reproduction(
            paper=self.paper,
            title=self.title,
            seeds=len(runs),
            choices=self.choices,
            tables=self.tables(runs),
            claims=self.claims(runs),
            pictures=() if pictures is None else import_module(self.pictures).draw(runs, pictures),
            failures=dict(sorted(failures.items())),
        )
