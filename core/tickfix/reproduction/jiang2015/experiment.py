"""The experiments of [jiang2015] section 8, over many seeds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from tickfix.plugins import Registry
from tickfix.reproduction.jiang2015.choices import CHOICES
from tickfix.reproduction.jiang2015.claims import claims
from tickfix.reproduction.jiang2015.measure import measure
from tickfix.reproduction.jiang2015.tables import tables
from tickfix.reproduction.report import Reproduction, Show
from tickfix.reproduction.seeds import over_seeds


def reproduce(
    seeds: Sequence[int],
    show: Show,
    pictures: Path | None,
    *,
    registry: Registry,
    processes: int | None = None,
) -> Reproduction:
    """Train and track on the twin once per seed; see :class:`~tickfix.reproduction.report.Experiment`.

    Raises:
        SiteError: when something cannot be trained.
    """
    runs = over_seeds(partial(measure, registry=registry), seeds, show, "jiang2015", processes=processes)
    drawn: tuple[Path, ...] = ()
    if pictures is not None:
        from tickfix.reproduction.jiang2015.pictures import draw  # noqa: PLC0415 - matplotlib is slow to import

        drawn = draw(runs, pictures)
    failures: Counter[str] = Counter()
    for run in runs:
        failures.update(run.failures)
    return Reproduction(
        paper="jiang2015",
        title="Wi-Fi fingerprints and a motion particle filter in one room",
        seeds=len(seeds),
        choices=CHOICES,
        tables=tables(runs),
        claims=claims(runs),
        pictures=drawn,
        failures=dict(failures),
    )
