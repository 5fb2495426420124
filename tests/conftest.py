"""Fixtures that all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Return the folder of real recordings; a test that asks for it is skipped where there is none."""
    told = os.environ.get("TICKFIX_DATA")
    folder = Path(told) if told else Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real recordings: TICKFIX_DATA is {told or 'unset'} and {folder} is no folder")
    return folder
