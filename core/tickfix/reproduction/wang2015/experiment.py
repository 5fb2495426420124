"""The experiments of [wang2015]."""

from __future__ import annotations

from typing import Final

from tickfix.reproduction.experiment import Experiment
from tickfix.reproduction.wang2015.choices import CHOICES
from tickfix.reproduction.wang2015.claims import claims
from tickfix.reproduction.wang2015.run import run_seed
from tickfix.reproduction.wang2015.tables import tables

EXPERIMENT: Final = Experiment(
    paper="wang2015",
    title="floor map, Wi-Fi and pseudo-odometry in corridors and a hall",
    repeat=run_seed,
    choices=CHOICES,
    tables=tables,
    claims=claims,
    pictures="tickfix.reproduction.wang2015.pictures",
)
