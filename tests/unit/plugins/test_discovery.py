"""Plugins are found in a fixed order, checked, and left out one by one where they are broken."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import EntryPoint
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
