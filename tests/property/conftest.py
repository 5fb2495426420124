"""The small site of the laws."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from lab import Lab, filter_names, small_lab


@pytest.fixture(scope="session")
def lab() -> Lab:
    """A small surveyed office and one short walk through it."""
    return small_lab()


@pytest.fixture(params=filter_names(), scope="session")
def name(request: pytest.FixtureRequest) -> str:
    """Every registered filter in turn; its pipeline has its name."""
    return str(request.param)
