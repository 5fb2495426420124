"""The small site of the laws, and how hypothesis searches: the same examples every time, more of them when asked.

``TICKFIX_HYPOTHESIS=explore pytest tests/property`` looks for new counterexamples, at random and for longer.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings

sys.path.insert(0, str(Path(__file__).parent))

from lab import Lab, filter_names, small_lab

settings.register_profile(
    "fast",
    max_examples=6,
    deadline=None,
    derandomize=True,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(
    "explore", settings.get_profile("fast"), max_examples=400, derandomize=False, phases=list(Phase)
)
settings.load_profile(os.environ.get("TICKFIX_HYPOTHESIS", "fast"))


@pytest.fixture(scope="session")
def lab() -> Lab:
    """A small surveyed office and one short walk through it."""
    return small_lab()


@pytest.fixture(params=filter_names(), scope="session")
def name(request: pytest.FixtureRequest) -> str:
    """Every registered filter in turn; its pipeline has its name."""
    return str(request.param)
