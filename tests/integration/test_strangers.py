"""Packages that tickfix has never heard of: a good one runs, a broken one is named and disturbs nobody."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

from stored_floor import Command

GOOD = '''
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from tickfix.api import Belief, Fix, Motion, PredictUpdateFilter, Report, Rng, hookimpl, parameter


@dataclass(frozen=True)
class Params:
    share: Annotated[float, parameter("of the way to a fix", gt=0, le=1)] = 0.5


@dataclass(frozen=True, slots=True)
class Place:
    floor: str
    xy: np.ndarray


class Halfway(PredictUpdateFilter[Params, Place]):
    """Goes part of the way to every fix."""

    name = "halfway"
    Params = Params
    State = Place

    def begin(self, fix: Fix, rng: Rng) -> Place:
        return Place(fix.floor, fix.xy)

    def predict(self, state: Place, motion: Motion, rng: Rng) -> Place:
        return state

    def update(self, state: Place, fix: Fix, rng: Rng) -> tuple[Place, Report]:
        return Place(fix.floor, state.xy + self.params.share * (fix.xy - state.xy)), Report(used=1)

    def estimate(self, state: Place) -> Belief:
        return Belief(floor=state.floor, xy=state.xy, covariance=np.eye(2))


TICKFIX_API = 1


@hookimpl
def tickfix_register():
    return [Halfway]
'''


BROKEN = {
    "broken_import": ("import nothing_of_that_name\n" + GOOD, "cannot be imported: ModuleNotFoundError", "uninstall"),
    "broken_misspelt": (
        GOOD.replace("tickfix_register", "tickfix_registr"),
        "no hook 'tickfix_registr'",
        "Rename it to",
    ),
    "broken_version": (
        GOOD.replace("TICKFIX_API = 1", "TICKFIX_API = 99"),
        "asks for tickfix API 99",
        "Upgrade tickfix",
    ),
    "broken_taken": (
        GOOD.replace('"halfway"', '"kalman"'),
        "filter:kalman is offered already by",
        "Give Halfway another name",
    ),
    "broken_raising": (
        GOOD.replace("return [Halfway]", "return 1 / 0"),
        "tickfix_register failed: ZeroDivisionError",
        "list",
    ),
}

CONFIG = '[pipelines.mine]\nfingerprint = "wknn"\nfilter = { use = "halfway", share = 0.7 }\n'

OURS = '[pipelines.ours]\nfingerprint = "wknn"\nfilter = "fixes"\n'

Install = Callable[..., Mapping[str, str]]


def test_a_good_one_appears_and_runs_beside_ours(
    tickfix: Command, site: Path, tmp_path: Path, package: Install
) -> None:
    env = package("halfway_filter", GOOD)
    listed = json.loads(tickfix("plugins", "--json", env=env).stdout)
    (mine,) = [entry for entry in listed["plugins"] if entry["name"] == "halfway"]
    assert (mine["distribution"], mine["version"]) == ("halfway_filter", "2.5")
    assert "Goes part of the way" in tickfix("plugins", "show", "filter:halfway", env=env).stdout
    config = tmp_path / "mine.toml"
    config.write_text(CONFIG, encoding="utf-8")
    done = tickfix("replay", site, "--holdout", "--json", "--config", config, env=env)
    assert json.loads(done.stdout)["pipelines"]["mine"]["n"] > 0


def test_broken_ones_are_named_with_the_fix_and_the_rest_goes_on(tickfix: Command, package: Install) -> None:
    for name, (source, _, _) in BROKEN.items():
        env = package(name, source)
    listed = json.loads(tickfix("plugins", "--json", env=env).stdout)
    problems = {found["plugin"]: found for found in listed["problems"]}
    assert set(problems) == set(BROKEN)
    for name, (_, problem, fix) in BROKEN.items():
        assert problem in problems[name]["problem"]
        assert fix in problems[name]["fix"]
    assert len([entry for entry in listed["plugins"] if entry["distribution"] == "tickfix"]) > 8
    done = tickfix("plugins", "show", "filter:kalman", env=env)
    assert "filter:kalman, from tickfix" in done.stdout
    warnings = done.stderr.splitlines()
    assert len(warnings) == len(BROKEN)
    assert all(line.startswith("tickfix: warning: plugin broken_") for line in warnings)


def test_one_that_fails_at_work_is_counted_and_harms_no_other(
    tickfix: Command, site: Path, tmp_path: Path, package: Install
) -> None:
    env = package("halfway_filter", GOOD.replace("return Place(fix.floor, state.xy", "return Place(1 / 0, state.xy"))
    config = tmp_path / "mine.toml"
    config.write_text(CONFIG + OURS, encoding="utf-8")
    arguments = ("replay", site, "--holdout", "--json", "--config", config)
    done = tickfix(*arguments, env=env)
    assert "filter 'halfway': ZeroDivisionError" in done.stderr
    alone = tickfix("replay", site, "--holdout", "--json", "--pipeline", "wifi")
    ours = json.loads(done.stdout)["pipelines"]["ours"]["published"]
    assert ours == json.loads(alone.stdout)["pipelines"]["wifi"]["published"]
    strict = tickfix(*arguments, "--strict", env=env, code=2)
    assert "halfway" in strict.stderr.splitlines()[-1]
