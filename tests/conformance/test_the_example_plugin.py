"""The example that docs/write-a-plugin.md copies: it keeps the contract, and its package is found."""

from __future__ import annotations

import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

from tickfix_alpha_beta.alpha_beta import AlphaBeta

from tickfix.api import Context
from tickfix.config import build_pipelines, parse_config
from tickfix.registry import Registry, discover
from tickfix.testing import FilterContract

EXAMPLE = Path(__file__).parents[2] / "examples" / "plugin"


class TestAlphaBeta(FilterContract):
    algorithm = AlphaBeta


def registry() -> Registry:
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text("utf-8"))["project"]
    found = project["entry-points"]["tickfix.plugins"]
    points = [EntryPoint(name, value, "tickfix.plugins") for name, value in found.items()]
    return discover(points)


def test_its_entry_point_offers_the_filter() -> None:
    found = registry()
    assert not found.problems
    assert [offer.label for offer in found.offers] == ["filter:alpha-beta"]
    assert found.get("filter", "alpha-beta").cls is AlphaBeta


def test_a_pipeline_can_choose_it_by_name() -> None:
    mine = registry().get("filter", "alpha-beta")
    both = Registry([*discover().offers, mine])
    text = '[pipelines.mine]\npdr = "steps"\nfilter = { use = "alpha-beta", alpha = 0.3 }\n'
    (pipeline,) = build_pipelines(parse_config(text, "mine.toml", both).pipelines, Context(), {})
    assert isinstance(pipeline.filter.algorithm, AlphaBeta)
    assert pipeline.filter.algorithm.params.alpha == 0.3
