"""What the user can mend is one clear line on stderr and exit code 2, and nothing on stdout."""

from __future__ import annotations

from pathlib import Path

from stored_floor import Command


def complaint(tickfix: Command, *arguments: object) -> str:
    done = tickfix(*arguments, code=2)
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("tickfix: ")
    return line


def test_an_unknown_pipeline(tickfix: Command, site: Path) -> None:
    line = complaint(tickfix, "replay", site, "--holdout", "--pipeline", "fusoin")
    assert "found 'fusoin'; expected one of wifi, pdr, kalman, fusion (did you mean 'fusion'?)" in line


def test_a_broken_configuration_names_file_key_value_and_what_is_allowed(
    tickfix: Command, site: Path, tmp_path: Path
) -> None:
    config = tmp_path / "mine.toml"
    text = '[pipelines.a]\nfingerprint = { use = "wknn", k = 0 }\nfilter = "fixes"\n'
    config.write_text(text, encoding="utf-8")
    line = complaint(tickfix, "replay", site, "--holdout", "--config", config)
    assert f"{config}: pipelines.a.fingerprint.k: found 0; expected integer ≥ 1" in line
    config.write_text("[pipelines.a\n", encoding="utf-8")
    line = complaint(tickfix, "survey", tmp_path, "--out", tmp_path / "site", "--config", config)
    assert "expected valid TOML" in line


def test_a_suffix_that_no_sink_writes(tickfix: Command, site: Path, tmp_path: Path) -> None:
    line = complaint(tickfix, "replay", site, "--holdout", "--out", tmp_path / "x.csv")
    assert "found suffix '.csv'; expected one of .geojson (geojson)" in line


def test_no_walks_two_kinds_of_walks_and_none_held_out(tickfix: Command, site: Path, floor_folder: Path) -> None:
    assert "found no walks; expected recordings after SITE, or --holdout" in complaint(tickfix, "replay", site)
    assert "found both" in complaint(tickfix, "replay", site, floor_folder, "--holdout")


def test_no_site_no_recordings_and_a_place_that_is_taken(tickfix: Command, floor_folder: Path, tmp_path: Path) -> None:
    assert "make one with `tickfix survey`" in complaint(tickfix, "replay", tmp_path, "--holdout")
    assert "no such file or folder" in complaint(tickfix, "survey", tmp_path / "none", "--out", tmp_path / "site")
    assert "readers: events, indoor-location" in complaint(tickfix, "survey", tmp_path, "--out", tmp_path / "site")
    taken = tmp_path / "taken.txt"
    taken.write_text("mine", encoding="utf-8")
    assert "it is left alone" in complaint(tickfix, "survey", floor_folder, "--out", taken)
    assert taken.read_text("utf-8") == "mine"
