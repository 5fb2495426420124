"""Repetitions over processes."""

from __future__ import annotations

import os

import numpy as np

from tickfix.replay.process_pool import available_cores, parallel_map
from tickfix_papers.experiment import run_over_seeds


def test_the_number_of_processes_changes_nothing() -> None:
    def run(seed: int) -> list[float]:
        return np.random.default_rng(seed).normal(size=3).tolist()

    shown: list[tuple[str, int, int]] = []
    alone = run_over_seeds(run, range(5), lambda *progress: shown.append(progress), "walking", processes=1)
    assert run_over_seeds(run, range(5), lambda *_: None, "walking", processes=3) == alone
    assert shown == [("walking", done, 5) for done in range(6)]


def test_a_worker_starts_no_workers_of_its_own() -> None:
    def run(seed: int) -> tuple[int, set[int], int]:
        return available_cores(), set(parallel_map(lambda _: os.getpid(), range(3))), os.getpid()

    for count, inner, worker in run_over_seeds(run, range(2), lambda *_: None, "", processes=2):
        assert count == 1
        assert inner == {worker}
