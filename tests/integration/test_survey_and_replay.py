"""A floor is surveyed, its held-out walks are replayed, and two processes agree bit for bit."""

from __future__ import annotations

import json
from pathlib import Path

from stored_floor import Command

FIGURES = {"n", "mean_m", "median_m", "p75_m", "p90_m", "p95_m", "max_m", "rmse_m"}


def test_a_survey_says_what_it_found(tickfix: Command, floor_folder: Path, tmp_path: Path) -> None:
    walk = min((floor_folder / "path_data_files").iterdir())
    copy = tmp_path / "F1" / "path_data_files"
    copy.mkdir(parents=True)
    (copy / walk.name).write_text(walk.read_text() + "something else\n", encoding="utf-8")
    done = tickfix("survey", copy.parent, "--out", tmp_path / "site")
    words = " ".join(done.stdout.split())
    for found in ("floors F1", "walks surveyed 1", "walks held out 0", "lines rejected 1", "broken line 1", "seconds"):
        assert found in words
    assert "broken line: found 'something else'" in done.stderr
    assert "reading" in done.stderr


def test_an_unreadable_recording_is_left_out_and_named(tickfix: Command, floor_folder: Path, tmp_path: Path) -> None:
    broken = tmp_path / "path_data_files" / "broken.txt"
    broken.parent.mkdir()
    broken.write_text("nothing\n", encoding="utf-8")
    done = tickfix("survey", floor_folder, broken, "--out", tmp_path / "site")
    assert "broken.txt: nothing could be read" in done.stderr
    assert "Surveyed site" in done.stdout


def test_json_is_one_object_of_the_promised_shape(tickfix: Command, site: Path) -> None:
    done = tickfix("replay", site, "--holdout", "--json")
    result = json.loads(done.stdout)
    assert set(result) == {"pipelines", "walks", "intake"}
    assert list(result["pipelines"]) == ["wifi", "pdr", "kalman", "fusion"]
    held_out = json.loads((site / "site.json").read_text())["held_out"]
    assert [walk["name"] for walk in result["walks"]] == [walk["walk"] for walk in held_out]
    for pipeline in result["pipelines"].values():
        assert set(pipeline) >= FIGURES | {"availability", "published", "settled", "covered"}
        assert set(pipeline["covered"]) == FIGURES | {"share"}
        assert len(pipeline["published"]) == len(pipeline["settled"]) == 64
        assert pipeline["n"] > 0
        assert pipeline["mean_m"] < 10
    assert result["intake"]["accepted"] > 1000
    assert "replaying" in done.stderr


def test_digests_are_the_same_in_another_process_alone_or_beside_others(tickfix: Command, site: Path) -> None:
    runs = [
        json.loads(tickfix("replay", site, "--holdout", "--json", *more, env={"PYTHONHASHSEED": seed}).stdout)
        for seed, more in (("1", ()), ("2", ("--pipeline", "fusion")))
    ]
    first, alone = (run["pipelines"]["fusion"] for run in runs)
    assert list(runs[1]["pipelines"]) == ["fusion"]
    assert (first["published"], first["settled"]) == (alone["published"], alone["settled"])
    other = json.loads(tickfix("replay", site, "--holdout", "--json", "--pipeline", "fusion", "--seed", "5").stdout)[
        "pipelines"
    ]["fusion"]
    assert other["published"] != first["published"]


def test_walks_by_name_pictures_and_estimates(tickfix: Command, site: Path, floor_folder: Path, tmp_path: Path) -> None:
    walks = sorted((floor_folder / "path_data_files").iterdir())[:2]
    out, pictures = tmp_path / "said.jsonl", tmp_path / "pictures"
    arguments = ("--start", "first-waypoint", "--walks", "--pictures", pictures, "--out", out)
    done = tickfix("replay", site, *walks, *arguments)
    assert "which flatters the errors" in done.stderr
    names = [walk.name.removesuffix(".txt") for walk in walks]
    assert all(name in done.stdout for name in (*names, "wifi", "fusion", "2 walks scored"))
    assert {path.name for path in pictures.iterdir()} == {"cdf.png", *(f"{name}.png" for name in names)}
    lines = [json.loads(line) for line in out.read_text("utf-8").splitlines()]
    order = [(names.index(line["device"]), line["tick"]) for line in lines]
    assert order == sorted(order)
    assert {line["pipeline"] for line in lines} == {"wifi", "pdr", "kalman", "fusion"}
    assert {line["revision"] for line in lines} == {0}
    again = tmp_path / "said.geojson"
    tickfix("replay", site, walks[0], "--out", again, "--pipeline", "wifi")
    assert json.loads(again.read_text("utf-8"))["type"] == "FeatureCollection"


def test_an_algorithm_without_its_model_is_announced(tickfix: Command, site: Path, tmp_path: Path) -> None:
    config = tmp_path / "mine.toml"
    config.write_text('[pipelines.a]\nfingerprint = { use = "wknn", k = 3 }\nfilter = "fixes"\n', encoding="utf-8")
    done = tickfix("replay", site, "--holdout", "--config", config)
    assert "fingerprint:wknn: the site has no model" in done.stderr
    assert f"tickfix survey --config {config}" in done.stderr
