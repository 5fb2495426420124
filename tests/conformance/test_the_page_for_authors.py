"""docs/write-a-plugin.md, followed to the letter: its code is a package that keeps the contract and runs."""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from tickfix.api import Context, Fix
from tickfix.config import build_pipelines, parse_config
from tickfix.kernel import Kernel, KernelSettings
from tickfix.registry import Registry, discover

PAGE = (Path(__file__).parents[2] / "docs" / "write-a-plugin.md").read_text("utf-8")


def block(name: str) -> str:
    """Return the code that stands below the name of its file."""
    found = re.search(rf"`{re.escape(name)}`:\n\n```\w+\n(.*?)```", PAGE, re.DOTALL)
    assert found, f"the page has no {name}"
    return found.group(1)


@pytest.fixture
def registry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Registry]:
    """The package as a reader would have typed it in, and what tickfix finds in it."""
    package = tmp_path / "my_filter"
    package.mkdir()
    (package / "__init__.py").touch()
    for name in ("smoother.py", "plugin.py"):
        (package / name).write_text(block(f"my_filter/{name}"), encoding="utf-8")
    (tmp_path / "test_smoother.py").write_text(block("tests/test_smoother.py"), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    project = tomllib.loads(block("pyproject.toml"))["project"]
    points = project["entry-points"]["tickfix.plugins"].items()
    yield discover([EntryPoint(name, value, "tickfix.plugins") for name, value in points])
    for name in [name for name in sys.modules if name.split(".")[0] in ("my_filter", "test_smoother")]:
        del sys.modules[name]


def test_its_package_is_found_and_keeps_the_contract(registry: Registry) -> None:
    assert not registry.problems
    assert [offer.label for offer in registry.offers] == ["filter:smoother"]
    kit = __import__("test_smoother").TestSmoother()
    checks = [name for name in dir(kit) if name.startswith("test_")]
    assert len(checks) > 35
    for check in checks:
        getattr(kit, check)()


def test_its_configuration_runs(registry: Registry) -> None:
    everything = Registry([*discover().offers, *registry.offers])
    config = parse_config(block("mine.toml"), "mine.toml", everything)
    assert [p.name for p in config.pipelines] == ["wifi", "mine"]
    text = '[pipelines.mine]\npdr = "steps"\nfilter = { use = "smoother", gain = 0.5 }\n'
    pipelines = build_pipelines(parse_config(text, "mine.toml", everything).pipelines, Context(), {})
    kernel = Kernel(pipelines, KernelSettings(strict=True, repack=True))
    for second in range(1, 20):
        fix = Fix(t_ns=second * 10**9, floor="F", xy=np.array([float(second), 0.0]), device="d")
        kernel.feed(fix)
    belief = kernel.finish("d").settled[-1].belief
    assert belief is not None
    assert belief.xy[0] > 15.0


def test_the_messages_it_explains_are_those_that_tickfix_gives(registry: Registry) -> None:
    with pytest.raises(Exception, match=r"gain: found 2\.0; expected number > 0 and ≤ 1"):
        parse_config(
            block("mine.toml").replace("0.5", "2.0"), "mine.toml", Registry([*discover().offers, *registry.offers])
        )
