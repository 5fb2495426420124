"""The experiments of [sun2013] section 4.

Wi-Fi fingerprinting by normalised cross correlation, and the Kalman/map filter.
"""

from __future__ import annotations

from typing import Final

from tickfix_papers.experiment import Experiment
from tickfix_papers.sun2013.claims import decided_claims, result_tables
from tickfix_papers.sun2013.seed_run import run_seed
from tickfix_papers.sun2013.twin import TWIN_SETTINGS

EXPERIMENT: Final = Experiment(
    paper="sun2013",
    title="Normalised cross correlation and the Kalman/map filter",
    run_seed=run_seed,
    twin_settings=TWIN_SETTINGS,
    tables=result_tables,
    claims=decided_claims,
    pictures="tickfix_papers.sun2013.figures",
)
