"""``tickfix reproduce wang2015`` with two seeds: every table, every claim, every picture."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

Reproduce = Callable[..., CompletedProcess[str]]


def test_tables_claims_and_pictures_are_there(reproduce: Reproduce, tmp_path: Path) -> None:
    done = reproduce("wang2015", "--seeds", "2", "--json", "--pictures", tmp_path)
    result = json.loads(done.stdout)["wang2015"]
    tables = {table["name"]: table for table in result["tables"]}
    assert list(tables) == ["Table 1", "Table 2", "Table 4", "Table 6", "Table 8", "Tables 6 and 8, undisturbed"]
    rows = {row["label"]: row["cells"] for row in tables["Table 4"]["rows"]}
    assert [cell["paper"] for cell in rows["MWPO"]] == [2.491, 1.922, 4.664]
    assert 0.0 < rows["MWPO"][0]["ours"] < rows["PDR"][0]["ours"] < 20.0
    low, high = rows["WPO"][0]["interval"]
    assert low < rows["WPO"][0]["ours"] < high
    residuals = {row["label"]: row["cells"] for row in tables["Table 8"]["rows"]}
    assert [cell["paper"] for cell in residuals["WPO"]] == [9.6667, 8.5872, 6.3026, None]
    assert len(result["claims"]) == 16
    for claim in result["claims"]:
        assert {"claim", "paper", "ours", "interval", "holds"} <= set(claim)
        assert claim["holds"] or claim["reason"]
    assert len(list(tmp_path.glob("wang2015-*.png"))) == 6
