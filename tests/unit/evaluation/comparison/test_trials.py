"""Results must not outlive the code that computed them."""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tickfix.config import PipelineConfig, load_config
from tickfix.evaluation.comparison import trials as module
from tickfix.evaluation.comparison.trials import code_digest, versions
from tickfix.registry import discover


@pytest.fixture
def pipeline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PipelineConfig:
    """A pipeline whose filter lives in a module of its own, ``mine.py``."""
    (tmp_path / "mine.py").write_text("class Mine: ...\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    mine = importlib.import_module("mine")
    chosen = load_config(None, discover()).pipelines[0]
    offer = replace(chosen.filter.offer, cls=mine.Mine, distribution="mine", version="2.5")
    return replace(chosen, filter=replace(chosen.filter, offer=offer))


def test_the_digest_changes_with_the_source_and_not_with_the_name(pipeline: PipelineConfig, tmp_path: Path) -> None:
    before = code_digest(pipeline)
    assert code_digest(replace(pipeline, name="other")) == before
    (tmp_path / "mine.py").write_text("class Mine: ...  # changed\n", encoding="utf-8")
    module._source_digest.cache_clear()
    try:
        assert code_digest(pipeline) != before
    finally:
        module._source_digest.cache_clear()
        del sys.modules["mine"]


def test_versions_name_what_computed(pipeline: PipelineConfig) -> None:
    found = versions([pipeline])
    assert found["mine"] == "2.5"
    assert {"python", "numpy", "scipy", "tickfix", "machine"} <= set(found)
    del sys.modules["mine"]
