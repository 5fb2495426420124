"""``tickfix compare``: the tracks of ``replay``, whatever the number of workers; an interrupted run goes on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from live_lab import LIGHT
from stored_floor import Command

from tickfix.site.waypoints import is_held_out

AB = (
    LIGHT
    + """
[pipelines.again]
pdr         = "steps"
fingerprint = "wknn"
filter      = "kalman"

[pipelines.fusion]
pdr         = "steps"
fingerprint = "wknn"
filter      = { use = "fusion-pf", particles = [20, 40] }
map         = "walls"
"""
)


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("config") / "AB.toml"
    path.write_text(AB, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def folder(tickfix: Command, site: Path, config: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished comparison with two seeds, run by one process."""
    out = tmp_path_factory.mktemp("compared") / "report"
    arguments = ("--config", config, "--baseline", "kalman", "--seeds", 2, "--workers", 1, "--report", out)
    done = tickfix("compare", site, "--holdout", *arguments)
    assert "again and kalman do not differ at all" in done.stdout
    assert "comparing" in done.stderr
    assert str(out / "report.html") in done.stdout
    return out


def outcomes(folder: Path) -> list[Path]:
    return sorted((folder / "outcomes").rglob("*.outcome"))


def without_cost(document: dict[str, Any]) -> dict[str, Any]:
    for pipeline in document["pipelines"].values():
        del pipeline["metrics"]["cost"]
    del document["provenance"]["command"]
    return document


def read(folder: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((folder / "report.json").read_text("utf-8"))
    return document


def test_tracks_are_those_of_replay(tickfix: Command, site: Path, config: Path, folder: Path) -> None:
    replayed = json.loads(tickfix("replay", site, "--holdout", "--config", config, "--json").stdout)
    compared = read(folder)
    assert list(compared["pipelines"]) == ["wifi", "kalman", "again", "fusion[particles=20]", "fusion[particles=40]"]
    first = [walk for walk in compared["walks"] if walk["seed"] == 0]
    assert len(compared["walks"]) == 2 * len(first)
    for ours, theirs in zip(first, replayed["walks"], strict=True):
        assert {key: ours[key] for key in theirs} == theirs
    moved = {
        name
        for walk, other in zip(first, (w for w in compared["walks"] if w["seed"] == 1), strict=True)
        for name in walk["pipelines"]
        if walk["pipelines"][name]["published"] != other["pipelines"][name]["published"]
    }
    assert moved == {"fusion[particles=20]", "fusion[particles=40]"}  # the others draw no random numbers


def test_an_interrupted_run_goes_on_and_workers_change_nothing(
    tickfix: Command, site: Path, config: Path, folder: Path
) -> None:
    before, kept = read(folder), outcomes(folder)
    assert len(kept) == len(before["walks"]) * 4  # 'again' is 'kalman' by another name
    gone, damaged, untouched = kept[0], kept[-1], kept[1:-1]
    contents = {path: path.read_bytes() for path in untouched}
    times = {path: path.stat().st_mtime_ns for path in untouched}
    gone.unlink()
    damaged.write_bytes(damaged.read_bytes()[:100])
    arguments = ("--config", config, "--baseline", "kalman", "--seeds", 2, "--workers", 2, "--report", folder)
    done = tickfix("compare", site, "--holdout", "--json", *arguments)
    again = json.loads(done.stdout)
    assert again == read(folder)
    assert without_cost(again) == without_cost(before)
    assert outcomes(folder) == kept
    assert {path: path.stat().st_mtime_ns for path in untouched} == times
    assert {path: path.read_bytes() for path in untouched} == contents


def test_cross_validation_never_reads_a_held_out_walk_again_and_pools_by_floor(
    tickfix: Command, floor_folder: Path, config: Path, tmp_path: Path
) -> None:
    arguments = ("--config", config, "--pipeline", "wifi", "--pipeline", "kalman", "--report", tmp_path / "cv")
    done = tickfix("compare", floor_folder, "--crossvalidate", 2, "--json", *arguments)
    document = json.loads(done.stdout)
    walks = document["walks"]
    every = {path.stem for path in (floor_folder / "path_data_files").iterdir()}
    # The simulated surveyor rested between walks, so that each walk is a chain of its own.
    assert {walk["name"] for walk in walks} == {name for name in every if not is_held_out(name, 0.3)}
    assert len({walk["name"] for walk in walks}) == len(walks)
    assert [(g["name"], g["walks"]) for g in document["sites"]] == [("F1", len(walks))]
    assert document["provenance"]["crossvalidation"] == {"folds": 2, "holdout_share": 0.3}
    assert len({g["digest"] for g in document["provenance"]["sites"]}) == 2


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--holdout", "--baseline", "none"), "--baseline: found 'none'; expected one of wifi, pdr, kalman, fusion"),
        (("--crossvalidate", "2", "--holdout"), "compare: found --holdout with --crossvalidate"),
    ],
)
def test_mistakes_are_told_in_a_line(
    tickfix: Command, site: Path, tmp_path: Path, arguments: tuple[str, ...], says: str
) -> None:
    done = tickfix("compare", site, "--report", tmp_path / "r", *arguments, code=2)
    assert says in done.stderr
