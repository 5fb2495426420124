"""Packages that tickfix has never heard of: a good one runs, a broken one is named and disturbs nobody."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

from stored_floor import Command

README = Path(__file__).parents[2] / "README.md"
BLOCKS = [block.split("```")[0] for block in README.read_text("utf-8").split("```python\n")[1:]]
(GOOD,) = (block for block in BLOCKS if "@hookimpl" in block)
VERSIONED = f"TICKFIX_API = 99\n{GOOD}"

BROKEN = {
    "broken_import": ("import nothing_of_that_name\n" + GOOD, "cannot be imported: ModuleNotFoundError", "uninstall"),
    "broken_misspelt": (
        GOOD.replace("tickfix_register", "tickfix_registr"),
        "no hook 'tickfix_registr'",
        "Rename it to",
    ),
    "broken_version": (
        VERSIONED,
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

CONFIG = '[pipelines.mine]\nfingerprint = "wknn"\nfilter = "halfway"\n'

OURS = '[pipelines.ours]\nfingerprint = "wknn"\nfilter = "fixes"\n'

Install = Callable[..., Mapping[str, str]]


def test_the_filter_of_the_readme_appears_and_runs(
    tickfix: Command, site: Path, tmp_path: Path, package: Install
) -> None:
    env = package("halfway_filter", GOOD)
    listed = json.loads(tickfix("plugins", "--json", env=env).stdout)
    (mine,) = [entry for entry in listed["plugins"] if entry["name"] == "halfway"]
    assert (mine["distribution"], mine["version"]) == ("halfway_filter", "2.5")
    assert "Goes half of the way" in tickfix("plugins", "show", "filter:halfway", env=env).stdout
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
    env = package("halfway_filter", GOOD.replace("(state.xy + fix.xy) / 2", "1 / 0"))
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
