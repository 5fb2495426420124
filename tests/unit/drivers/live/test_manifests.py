"""What a run's manifest is told is what whoever repeats it reads there."""

from __future__ import annotations

from pathlib import Path

from tickfix import config
from tickfix.drivers.live.order import Order
from tickfix.drivers.live.runs.manifests import boot_of, config_of, disabled_in, manifest_for, site_of
from tickfix.plugins import discover

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
    chosen = config.parse(CONFIG, "test", registry).only(["left", "right"])
    keys = [choice.key for choice in chosen.pipelines[1].choices]
    order = Order(site=tmp_path / "site", config=chosen, disabled=dict.fromkeys(keys, "hung\tfor 2 s"))
    manifest = manifest_for(order, registry, "r", None)
    assert [pipeline.name for pipeline in config_of(manifest, registry).pipelines] == ["left", "right"]
    assert site_of(manifest) == (tmp_path / "site").resolve()
    assert disabled_in(manifest) == set(keys)


def test_each_engine_of_a_run_has_the_next_number_and_the_first_ones_beginning(tmp_path: Path) -> None:
    registry = discover()
    order = Order(site=tmp_path, config=config.parse(CONFIG, "test", registry))
    first = manifest_for(order, registry, "r", None)
    second = manifest_for(order, registry, "r", first)
    assert (boot_of(first), boot_of(second)) == (1, 2)
    assert second.wall_start_ns == first.wall_start_ns
    assert not disabled_in(first)
