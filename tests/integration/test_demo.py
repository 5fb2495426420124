"""``tickfix demo`` shows what tickfix does, on any machine."""

from __future__ import annotations

import json
from pathlib import Path

from stored_floor import Command


def test_the_demo_compares_draws_and_says_what_next(tickfix: Command, tmp_path: Path) -> None:
    done = tickfix("demo", cwd=tmp_path)
    assert all(part in done.stdout for part in ("wifi", "pdr", "kalman", "fusion", "waypoints of 5 walks scored"))
    pictures = {path.name for path in (tmp_path / "tickfix-demo").iterdir()}
    assert {"cdf.png", "walk-F1-01.png"} <= pictures
    assert "tracking" in done.stderr
    (command,) = [line for line in done.stdout.splitlines() if "plugins show" in line]
    assert "parameter" in tickfix(*command.split()[1:4]).stdout


def test_the_demo_in_json_with_one_pipeline(tickfix: Command, tmp_path: Path) -> None:
    done = tickfix("demo", "--out", tmp_path / "d", "--json", "--seed", "1", "--pipeline", "wifi")
    result = json.loads(done.stdout)
    assert list(result["pipelines"]) == ["wifi"]
    assert len(result["walks"]) == 5
