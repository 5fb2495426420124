"""Plugins are found in a fixed order, checked, and left out one by one where they are broken."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import Distribution, EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tickfix.api import BasePdr, PluginError, Stateless, hookimpl
from tickfix.registry import check_algorithm_class, discover


class Walk(BasePdr[Any]):
    """Says nothing."""

    name = "walk"
    State = Stateless

    def start(self) -> Stateless:
        return Stateless()

    def step(self, state: Stateless, samples: Any) -> Any:
        return state, None


class Run(Walk):
    """Says nothing faster."""

    name = "run"


@pytest.fixture
def module() -> Iterator[Callable[..., EntryPoint]]:
    """Make modules that exist for one test; return the entry point that names one."""
    made = []

    def make(name: str, **contents: Any) -> EntryPoint:
        made.append(name)
        sys.modules[name] = ModuleType(name)
        sys.modules[name].__dict__.update(contents)
        return EntryPoint(name, name, "tickfix.plugins")

    yield make
    for name in made:
        del sys.modules[name]


def offering(*classes: Any) -> Callable[[], list[Any]]:
    @hookimpl
    def tickfix_register() -> list[Any]:
        return list(classes)

    return tickfix_register


Make = Callable[..., EntryPoint]


def test_what_is_offered_does_not_depend_on_the_order_of_installation(module: Make) -> None:
    points = [module("tf_a", tickfix_register=offering(Walk)), module("tf_b", tickfix_register=offering(Run))]
    for order in (points, points[::-1]):
        assert [(o.kind, o.name, o.plugin) for o in discover(order).offers] == [
            ("pdr", "run", "tf_b"),
            ("pdr", "walk", "tf_a"),
        ]


def test_a_taken_name_is_reported_and_the_plugins_other_classes_are_used(module: Make) -> None:
    class Again(Run):
        name = "walk"

    points = [module("tf_a", tickfix_register=offering(Walk)), module("tf_b", tickfix_register=offering(Again, Run))]
    found = discover(points)
    (problem,) = found.problems
    assert problem.plugin == "tf_b"
    assert "pdr:walk is offered already by tf_a" in problem.problem
    assert found.get("pdr", "walk").cls is Walk
    assert found.get("pdr", "run").cls is Run


@pytest.mark.parametrize(
    ("contents", "says"),
    [
        ({"tickfix_registr": offering(Walk)}, "Rename it to 'tickfix_register'"),
        ({"tickfix_register": lambda: [Walk]}, "Put @hookimpl above it"),
        ({}, "has no hook"),
        ({"TICKFIX_API": 2, "tickfix_register": offering(Walk)}, "asks for tickfix API 2, this is 1. Upgrade tickfix"),
        ({"TICKFIX_API": 0, "tickfix_register": offering(Walk)}, "Upgrade the plugin"),
        ({"tickfix_register": offering(7)}, "expected a class"),
    ],
)
def test_a_broken_plugin_is_named_with_the_fix_and_the_rest_loads(
    module: Make, contents: dict[str, Any], says: str
) -> None:
    found = discover([module("tf_broken", **contents), module("tf_good", tickfix_register=offering(Run))])
    (problem,) = found.problems
    assert says in str(problem)
    assert problem.plugin == "tf_broken"
    assert [offer.name for offer in found.offers] == ["run"]


def test_a_module_that_is_not_there_is_reported() -> None:
    (problem,) = discover([EntryPoint("gone", "no_such_module_at_all", "tickfix.plugins")]).problems
    assert "cannot be imported: ModuleNotFoundError" in problem.problem


@pytest.fixture
def packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., list[EntryPoint]]]:
    """Write distributions with their metadata, on the path for one test; return their entry points as read from it."""
    known = set(sys.modules)
    monkeypatch.syspath_prepend(tmp_path)

    def write(distribution: str, code: str, *lines: str) -> list[EntryPoint]:
        module = distribution.replace("-", "_")
        (tmp_path / f"{module}.py").write_text(code, "utf-8")
        info = tmp_path / f"{module}-0.1.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 0.1\n", "utf-8")
        text = "\n".join(["[tickfix.plugins]", *(f"{line} = {module}" for line in lines)])
        (info / "entry_points.txt").write_text(text + "\n", "utf-8")
        importlib.invalidate_caches()
        return list(Distribution.at(info).entry_points)

    yield write
    for name in set(sys.modules) - known:
        del sys.modules[name]


Write = Callable[..., list[EntryPoint]]


def offering_code(name: str, before: str = "", within: str = "") -> str:
    return f"""
import os, sys
from tickfix.api import BasePdr, Stateless, hookimpl
{before}
class X(BasePdr):
    name = "{name}"
    State = Stateless
    def start(self): return Stateless()
    def step(self, state, samples): return state, None
@hookimpl
def tickfix_register():
    {within}
    return [X]
"""


def test_two_distributions_may_use_one_entry_point_name(packages: Write) -> None:
    points = packages("acme-beta", offering_code("beta"), "mine") + packages(
        "acme-alpha", offering_code("alpha"), "mine"
    )
    found = discover(points)
    assert found.problems == ()
    assert [(o.name, o.plugin, o.distribution, o.value) for o in found.offers] == [
        ("alpha", "mine", "acme-alpha", "acme_alpha"),
        ("beta", "mine", "acme-beta", "acme_beta"),
    ]


def test_of_two_distributions_with_one_name_the_broken_one_is_named(packages: Write) -> None:
    points = packages("acme-beta", "raise ValueError('no')", "mine")
    found = discover(points + packages("acme-alpha", offering_code("alpha"), "mine"))
    (problem,) = found.problems
    assert (problem.distribution, problem.plugin, problem.value) == ("acme-beta", "mine", "acme_beta")
    assert str(problem).startswith("mine = acme_beta (acme-beta 0.1): cannot be imported: ValueError: no. ")
    assert [offer.name for offer in found.offers] == ["alpha"]


def test_a_line_that_stands_twice_counts_once(packages: Write) -> None:
    found = discover(packages("acme-alpha", offering_code("alpha"), "mine", "mine"))
    assert found.problems == ()
    assert [offer.name for offer in found.offers] == ["alpha"]


def test_one_module_under_two_names_is_registered_once_and_the_second_name_is_reported(packages: Write) -> None:
    found = discover(packages("acme-gamma", offering_code("gamma"), "one", "two"))
    (problem,) = found.problems
    assert problem.plugin == "two"
    assert "registered already as one = acme_gamma (acme-gamma 0.1)" in problem.problem
    assert [(offer.name, offer.plugin) for offer in found.offers] == [("gamma", "one")]


@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("import sys; sys.exit(3)", "cannot be imported: it ended the process (SystemExit: 3)"),
        (offering_code("x", within="sys.exit('gone')"), "tickfix_register failed: it ended the process"),
    ],
)
def test_a_plugin_that_exits_is_left_out_and_the_rest_loads(packages: Write, code: str, says: str) -> None:
    points = packages("acme-exit", code, "exits") + packages("acme-good", offering_code("good"), "good")
    found = discover(points)
    (problem,) = found.problems
    assert says in problem.problem
    assert [offer.name for offer in found.offers] == ["good"]


def test_what_a_plugin_prints_goes_to_stderr(packages: Write, capfd: pytest.CaptureFixture[str]) -> None:
    code = offering_code("loud", before="print('hello'); os.write(1, b'raw\\n')", within="print('registering')")
    assert [offer.name for offer in discover(packages("acme-loud", code, "loud")).offers] == ["loud"]
    print("after")
    captured = capfd.readouterr()
    assert captured.out == "after\n"
    for line in ("hello", "raw", "registering"):
        assert line in captured.err


def test_a_hook_wrapper_is_refused(module: Make) -> None:
    @hookimpl(wrapper=True)
    def tickfix_register() -> Any:
        return (yield)

    (problem,) = discover([module("tf_wrap", tickfix_register=tickfix_register)]).problems
    assert "tickfix_register is a hook wrapper" in problem.problem


def test_an_unknown_name_is_answered_with_the_nearest(module: Make) -> None:
    found = discover([module("tf_a", tickfix_register=offering(Walk, Run))])
    with pytest.raises(PluginError, match=r"Did you mean 'walk'\? There are: run, walk"):
        found.get("pdr", "wolk")


@dataclass(frozen=True)
class Bare:
    """Parameters without defaults."""

    k: int


def no_step(self: Any, state: Any) -> Any:
    return state


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"kind": "pdrr"}, "kind 'pdrr'"),
        ({"name": "Walk"}, "lower-case words joined by hyphens"),
        ({"step": no_step}, r"step takes \(state\), expected \(state, samples\)"),
        ({"Params": Bare}, "gives k no default"),
        ({"Params": dict}, "expected a frozen dataclass"),
        ({"State": None}, "names no State"),
    ],
)
def test_a_class_that_breaks_its_contract_is_told_what_is_expected(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        check_algorithm_class(type("Odd", (Walk,), changes))
