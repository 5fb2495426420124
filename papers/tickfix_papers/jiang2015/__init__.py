"""The experiments of [jiang2015] section 8: Wi-Fi fingerprints and a motion particle filter in one room."""

from __future__ import annotations

from typing import Final

from tickfix_papers.experiment import Experiment
from tickfix_papers.jiang2015.claims import decided_claims, result_tables
from tickfix_papers.jiang2015.seed_run import run_seed
from tickfix_papers.jiang2015.twin import TWIN_SETTINGS

EXPERIMENT: Final = Experiment(
    paper="jiang2015",
    title="Wi-Fi fingerprints and a motion particle filter in one room",
    run_seed=run_seed,
    twin_settings=TWIN_SETTINGS,
    tables=result_tables,
    claims=decided_claims,
    pictures="tickfix_papers.jiang2015.figures",
)
