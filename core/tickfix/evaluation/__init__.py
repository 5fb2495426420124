"""Evaluation of tracks against truth.

Scoring, metrics, paired statistics, comparison of pipelines, reports and pictures. :mod:`tickfix.evaluation.pictures`
and :mod:`tickfix.evaluation.theme` draw; they import matplotlib, which this module does not.
"""

from tickfix.evaluation.walk_runs import RunSetup, WalkOptions, pool_runs, prepare, run_walks

__all__ = ["RunSetup", "WalkOptions", "pool_runs", "prepare", "run_walks"]
