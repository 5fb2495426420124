"""The experiments of [wang2015]: floor map, Wi-Fi and pseudo-odometry in corridors and a hall."""

from __future__ import annotations

from typing import Final

from tickfix_papers.experiment import Experiment
from tickfix_papers.wang2015.claims import decided_claims, result_tables
from tickfix_papers.wang2015.seed_run import run_seed
from tickfix_papers.wang2015.twin import TWIN_SETTINGS

EXPERIMENT: Final = Experiment(
    paper="wang2015",
    title="floor map, Wi-Fi and pseudo-odometry in corridors and a hall",
    run_seed=run_seed,
    twin_settings=TWIN_SETTINGS,
    tables=result_tables,
    claims=decided_claims,
    pictures="tickfix_papers.wang2015.figures",
)
