"""``tickfix reproduce wang2015``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from tickfix.plugins import Registry
from tickfix.reproduction.report import Reproduction, Show
from tickfix.reproduction.seeds import over_seeds
from tickfix.reproduction.wang2015.choices import CHOICES
from tickfix.reproduction.wang2015.claims import claims
from tickfix.reproduction.wang2015.run import run_seed
from tickfix.reproduction.wang2015.tables import tables


def reproduce(
    seeds: Sequence[int],
    show: Show,
    pictures: Path | None,
    *,
    registry: Registry,
    processes: int | None = None,
) -> Reproduction:
    """Run the experiments of [wang2015]; see :class:`tickfix.reproduction.report.Experiment`."""
    walks = over_seeds(partial(run_seed, registry), seeds, show, "wang2015", processes=processes)
    drawn: tuple[Path, ...] = ()
    if pictures is not None:
        from tickfix.reproduction.wang2015.pictures import draw  # noqa: PLC0415 - matplotlib is slow to import

        drawn = draw(walks, pictures)
    failures: Counter[str] = Counter()
    for walk in walks:
        failures.update(walk.failures)
    return Reproduction(
        paper="wang2015",
        title="floor map, Wi-Fi and pseudo-odometry in corridors and a hall",
        seeds=len(seeds),
        choices=CHOICES,
        tables=tables(walks),
        claims=claims(walks),
        pictures=drawn,
        failures=dict(sorted(failures.items())),
    )
