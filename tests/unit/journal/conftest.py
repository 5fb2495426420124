"""Journals to look at."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tickfix.journal import RunManifest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def manifest() -> RunManifest:
    return RunManifest(
        run="r-1",
        tickfix_version="0.1.0",
        config='seed = 3\n[pipelines.a]\nfilter = "fixes"\n',
        seed=3,
        probe="ab" * 32,
        wall_start_ns=1_700_000_000_000_000_000,
        plugins={"tickfix": "0.1.0", "zebra": "2"},
        notes={"site": "office"},
    )
