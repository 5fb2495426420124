"""Every hook says what it is, is documented with its exact arguments, and has a test."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pluggy
import pytest

from tickfix.api import hooks

ROOT = Path(__file__).parents[3]
HOOKS = {
    name: inspect.signature(getattr(hooks, name))
    for name in dir(hooks)
    if pluggy.PluginManager("tickfix").parse_hookspec_opts(hooks, name) is not None
}


@pytest.mark.parametrize("name", HOOKS)
def test_every_hook_is_documented_with_its_exact_arguments(name: str) -> None:
    page = (ROOT / "docs" / "write-a-plugin.md").read_text("utf-8")
    described = re.findall(rf"`{name}\(([^)]*)\)`", page)
    assert described == [", ".join(HOOKS[name].parameters)]


@pytest.mark.parametrize("name", HOOKS)
def test_every_hook_says_when_it_is_called_what_it_gets_and_since_when(name: str) -> None:
    doc = inspect.getdoc(getattr(hooks, name)) or ""
    assert re.search(r"\bcalled\b", doc, re.IGNORECASE)
    assert re.search(r"^Since API version \d+\.$", doc, re.MULTILINE)
    for argument, parameter in HOOKS[name].parameters.items():
        assert f"    {argument}: " in doc
        assert parameter.annotation is not inspect.Parameter.empty


@pytest.mark.parametrize("name", HOOKS)
def test_every_hook_has_a_test(name: str) -> None:
    folders = (ROOT / "tests" / "third_party", ROOT / "tests" / "unit" / "registry")
    tests = [path.read_text("utf-8") for folder in folders for path in folder.glob("test_*.py")]
    assert any(f'"{name}"' in text or f"def {name}" in text for text in tests)
