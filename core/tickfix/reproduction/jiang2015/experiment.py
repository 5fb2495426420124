"""The experiments of [jiang2015] section 8."""

from __future__ import annotations

from typing import Final

from tickfix.reproduction.experiment import Experiment
from tickfix.reproduction.jiang2015.choices import CHOICES
from tickfix.reproduction.jiang2015.claims import claims
from tickfix.reproduction.jiang2015.measure import measure
from tickfix.reproduction.jiang2015.tables import tables

EXPERIMENT: Final = Experiment(
    paper="jiang2015",
    title="Wi-Fi fingerprints and a motion particle filter in one room",
    repeat=measure,
    choices=CHOICES,
    tables=tables,
    claims=claims,
    pictures="tickfix.reproduction.jiang2015.pictures",
)
