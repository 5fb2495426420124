"""``tickfix reproduce`` finds experiments by their entry points: our papers and those of third-party packages."""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest

from tickfix_papers import Experiment

Reproduce = Callable[..., CompletedProcess[str]]
PAPERS = ("jiang2015", "sun2013", "wang2015")
MANUAL = Path(__file__).parents[2] / "docs" / "reproduction.md"


def documented(title: str) -> str:
    """Return the code block of the manual that begins with this comment."""
    (block,) = re.findall(rf"```\w+\n(# {re.escape(title)}\n.*?)```", MANUAL.read_text("utf-8"), re.DOTALL)
    return block


def package(folder: Path, module: str, entry: str) -> dict[str, str]:
    """Install a package as pip would, a module and its metadata in a folder; return the variables to find it by."""
    (folder / "coin.py").write_text(module, "utf-8")
    info = folder / "coin_experiment-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: coin-experiment\nVersion: 1.0\n", "utf-8")
    (info / "entry_points.txt").write_text(f"[tickfix.experiments]\ncoin1999 = {entry}\n", "utf-8")
    inherited = os.environ.get("PYTHONPATH")
    return {"PYTHONPATH": os.pathsep.join([str(folder), *([inherited] if inherited else [])])}


def test_the_experiment_of_the_manual_is_run_by_its_key(reproduce: Reproduce, tmp_path: Path) -> None:
    declared = tomllib.loads(documented("pyproject.toml of your package"))["project"]["entry-points"]
    env = package(tmp_path, documented("coin.py"), declared["tickfix.experiments"]["coin1999"])
    found = json.loads(reproduce("coin1999", "--seeds", 3, "--json", env=env).stdout)["coin1999"]
    heads = [np.random.default_rng(seed).integers(0, 2, 1000).mean() for seed in range(3)]
    assert found["tables"][0]["rows"][0]["cells"][0]["paper"] == 0.5
    assert found["tables"][0]["rows"][0]["cells"][0]["ours"] == pytest.approx(np.mean(heads))
    assert [(claim["claim"], claim["holds"]) for claim in found["claims"]] == [("it is fair", True)]
    text = reproduce("coin1999", "--seeds", 3, "--twin-settings", env=env).stdout
    assert "[coin1999] Tosses of a coin, 3 seeds" in text
    assert "1 of 1 hold" in text
    assert "chosen" in text


@pytest.mark.parametrize(
    ("module", "entry", "message"),
    [
        ("import no_such_module\n", "coin:EXPERIMENT", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("EXPERIMENT = 3\n", "coin:EXPERIMENT", "found a int without reproduce()"),
        ("", "coin:EXPERIMENT", "AttributeError"),
    ],
)
def test_a_broken_experiment_is_named_with_its_package(
    reproduce: Reproduce, tmp_path: Path, module: str, entry: str, message: str
) -> None:
    env = package(tmp_path, module, entry)
    stderr = " ".join(reproduce("coin1999", "--seeds", 2, env=env, code=2).stderr.split())
    assert "experiment 'coin1999' of coin-experiment (coin:EXPERIMENT)" in stderr
    assert message in stderr


def test_an_unknown_paper_is_answered_with_the_known_ones(reproduce: Reproduce) -> None:
    stderr = " ".join(reproduce("sun2012", code=2).stderr.split())
    assert "found 'sun2012'; expected one of all, jiang2015, sun2013, wang2015" in stderr


def test_two_seeds_are_the_least(reproduce: Reproduce) -> None:
    assert "--seeds" in reproduce("sun2013", "--seeds", 1, code=2).stderr


@pytest.mark.parametrize("paper", PAPERS)
def test_every_paper_offers_an_experiment_that_can_draw(paper: str) -> None:
    (point,) = entry_points(group="tickfix.experiments", name=paper)
    found = point.load()
    assert isinstance(found, Experiment)
    assert found.paper == paper
    assert callable(import_module(found.pictures).draw)
