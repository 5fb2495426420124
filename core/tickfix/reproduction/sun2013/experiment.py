"""``tickfix reproduce sun2013``."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from tickfix.plugins import Registry
from tickfix.reproduction.report import Reproduction, Show
from tickfix.reproduction.seeds import over_seeds
from tickfix.reproduction.sun2013.choices import CHOICES
from tickfix.reproduction.sun2013.claims import claims
from tickfix.reproduction.sun2013.repetition import repeat
from tickfix.reproduction.sun2013.tables import tables


def reproduce(
    seeds: Sequence[int], show: Show, pictures: Path | None, *, registry: Registry, processes: int | None = None
) -> Reproduction:
    """Run the experiment of [sun2013] section 4, see :class:`~tickfix.reproduction.report.Experiment`."""
    runs = over_seeds(partial(repeat, registry), seeds, show, "sun2013", processes=processes)
    drawn: tuple[Path, ...] = ()
    if pictures is not None:
        from tickfix.reproduction.sun2013.pictures import draw  # noqa: PLC0415 - matplotlib is slow to import

        drawn = draw(runs, pictures)
    unanswered = sum(run.unanswered for run in runs)
    return Reproduction(
        paper="sun2013",
        title="Normalised cross correlation and the Kalman/map filter",
        seeds=len(runs),
        choices=CHOICES,
        tables=tables(runs),
        claims=claims(runs),
        pictures=drawn,
        failures={"queries without a result": unanswered} if unanswered else {},
    )
