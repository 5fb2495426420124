"""What a run's manifest is told is what whoever repeats it reads there."""

from __future__ import annotations

from pathlib import Path

from tickfix import config
from tickfix.live.recovery import boot_number, disabled_stages, manifest_config, manifest_site, new_manifest
from tickfix.live.serve_options import ServeOptions
from tickfix.registry import discover

CONFIG = """
[pipelines.left]
filter = "fixes"
fingerprint = "wknn"
[pipelines.right]
filter = "kalman"
pdr = "steps"
[pipelines.unused]
filter = "fixes"
fingerprint = "wknn"
"""


def test_a_manifest_gives_back_site_pipelines_and_disabled_stages(tmp_path: Path) -> None:
    registry = discover()
    chosen = config.parse_config(CONFIG, "test", registry).only(["left", "right"])
    keys = [choice.key for choice in chosen.pipelines[1].choices]
    options = ServeOptions(site=tmp_path / "site", config=chosen, disabled=dict.fromkeys(keys, "hung\tfor 2 s"))
    manifest = new_manifest(options, registry, "r", None)
    assert [pipeline.name for pipeline in manifest_config(manifest, registry).pipelines] == ["left", "right"]
    assert manifest_site(manifest) == (tmp_path / "site").resolve()
    assert disabled_stages(manifest) == set(keys)


def test_each_engine_of_a_run_has_the_next_number_and_the_first_ones_beginning(tmp_path: Path) -> None:
    registry = discover()
    options = ServeOptions(site=tmp_path, config=config.parse_config(CONFIG, "test", registry))
    first = new_manifest(options, registry, "r", None)
    second = new_manifest(options, registry, "r", first)
    assert (boot_number(first), boot_number(second)) == (1, 2)
    assert second.wall_start_ns == first.wall_start_ns
    assert not disabled_stages(first)
