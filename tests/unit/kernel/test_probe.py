"""The probe says the same in every process of a machine, and something else where bits differ."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from tickfix.kernel.determinism import numeric_probe


def test_the_probe_repeats_in_another_process() -> None:
    command = [sys.executable, "-c", "from tickfix.kernel.determinism import numeric_probe as p; print(p())"]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()  # noqa: S603
    assert said == numeric_probe()
    assert len(said) == 64


def test_one_last_bit_changes_the_probe(monkeypatch: pytest.MonkeyPatch) -> None:
    before = numeric_probe()
    exp = np.exp
    monkeypatch.setattr(np, "exp", lambda x: np.nextafter(exp(x), np.inf))
    assert numeric_probe() != before
