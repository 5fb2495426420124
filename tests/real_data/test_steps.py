"""Steps of real walks, against switches in both shoes."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "steps.py"


@pytest.mark.parametrize("detector", ["multi_threshold", "steps"])
def test_hand_held_steps_of_persons_it_was_not_fitted_to(data_dir: Path, detector: str) -> None:
    spec = importlib.util.spec_from_file_location("benchmark_steps", BENCHMARK)
    assert spec is not None
    assert spec.loader is not None
    benchmark = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = benchmark  # its dataclasses look their module up
    spec.loader.exec_module(benchmark)
    walks = benchmark.read(data_dir / "oxford-step-counter")
    assert len(walks) == 16
    assert {walk.person for walk in walks} == {"Jamie", "Carmelo", "Dario"}
    count = getattr(benchmark, detector)
    errors = np.abs([found / walk.steps - 1.0 for walk, _, found in benchmark.leaving_the_person_out(walks, count)])
    assert errors.mean() <= 0.05
    assert errors.max() <= 0.15
