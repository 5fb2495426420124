"""A handful of real walks of one floor, from the recordings to the comparison."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from stored_floor import Command


def test_real_walks_are_surveyed_and_tracked(tickfix: Command, data_dir: Path, tmp_path: Path) -> None:
    floor = data_dir / "indoor-location-20" / "site1" / "F1"
    copy = tmp_path / "site1" / "F1"
    (copy / "path_data_files").mkdir(parents=True)
    for name in ("floor_info.json", "geojson_map.json"):
        shutil.copy(floor / name, copy)
    smallest = sorted((floor / "path_data_files").iterdir(), key=lambda path: (path.stat().st_size, path.name))[:12]
    for path in smallest:
        shutil.copy(path, copy / "path_data_files")
    site = tmp_path / "site"
    words = " ".join(tickfix("survey", copy, "--out", site, "--holdout", "0.3").stdout.split())
    assert "F1 (240 × 176 m)" in words
    held_out = json.loads((site / "site.json").read_text())["held_out"]
    assert 0 < len(held_out) < 12
    result = json.loads(tickfix("replay", site, "--holdout", "--json").stdout)
    assert len(result["walks"]) == len(held_out)
    assert result["pipelines"]["wifi"]["n"] > 0
