"""Fixtures that all tests share, and how hypothesis searches: the same examples every time, however long each takes.

``TICKFIX_HYPOTHESIS=explore pytest`` looks for new counterexamples, at random and for longer.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("steady", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("explore", settings.get_profile("steady"), max_examples=3000, derandomize=False)
settings.load_profile(os.environ.get("TICKFIX_HYPOTHESIS", "steady"))


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Return the folder of real recordings; a test that asks for it is skipped where there is none."""
    told = os.environ.get("TICKFIX_DATA")
    folder = Path(told) if told else Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real recordings: TICKFIX_DATA is {told or 'unset'} and {folder} is no folder")
    return folder
