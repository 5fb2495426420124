"""The experiments of published papers, run again on simulated twins of their sites.

Each paper has a subpackage with twin, experiment and claims. An experiment of your own uses the same parts: see
``docs/reproduction.md``.
"""

from tickfix_papers.experiment import Experiment, run_over_seeds
from tickfix_papers.reproduction_report import (
    Claim,
    PaperTable,
    Reproduction,
    SeedInterval,
    TableCell,
    TwinSetting,
)
from tickfix_papers.seed_statistics import (
    decide_claim,
    exact_value,
    mean,
    paired_difference,
    percent_reduction,
    table_row,
)

__all__ = [
    "Claim",
    "Experiment",
    "PaperTable",
    "Reproduction",
    "SeedInterval",
    "TableCell",
    "TwinSetting",
    "decide_claim",
    "exact_value",
    "mean",
    "paired_difference",
    "percent_reduction",
    "run_over_seeds",
    "table_row",
]
