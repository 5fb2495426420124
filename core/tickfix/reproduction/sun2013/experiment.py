"""The experiment of [sun2013] section 4."""

from __future__ import annotations

from typing import Final

from tickfix.reproduction.experiment import Experiment
from tickfix.reproduction.sun2013.choices import CHOICES
from tickfix.reproduction.sun2013.claims import claims
from tickfix.reproduction.sun2013.repetition import repeat
from tickfix.reproduction.sun2013.tables import tables

EXPERIMENT: Final = Experiment(
    paper="sun2013",
    title="Normalised cross correlation and the Kalman/map filter",
    repeat=repeat,
    choices=CHOICES,
    tables=tables,
    claims=claims,
    pictures="tickfix.reproduction.sun2013.pictures",
)
