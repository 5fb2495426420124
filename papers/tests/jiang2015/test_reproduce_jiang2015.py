"""``tickfix reproduce jiang2015``: the whole command, on fewer walks and with fewer hidden nodes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tickfix.cli.main import app
from tickfix_papers.jiang2015 import seed_run, twin


@pytest.fixture
def smaller(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let one person walk at two paces, train networks of few nodes, and draw few particles."""
    monkeypatch.setattr(twin, "PEOPLE", 1)
    monkeypatch.setattr(twin, "PACES", (0.9, 1.1))
    monkeypatch.setattr(seed_run, "GIVEN_SIGMA_M", (0.5, 2.0))
    monkeypatch.setattr("tickfix_papers.jiang2015.claims.GIVEN_SIGMA_M", (0.5, 2.0))
    whole = seed_run.pipelines_in

    def fewer_nodes(file: str) -> str:
        nodes = '"elm", velocity_nodes = [40], heading_nodes = [40]'
        text = re.sub(r", (velocity|heading)_nodes = \[.*?\]", "", whole(file))
        text = text.replace('"fusion-pf", preset', '"fusion-pf", particles = 100, preset')
        return text.replace('"elm"', nodes).replace('"elm-knn",', '"elm-knn", hidden = 50,')

    monkeypatch.setattr(seed_run, "pipelines_in", fewer_nodes)


@pytest.mark.usefixtures("smaller")
def test_it_prints_every_table_and_claim_and_draws_the_figures(tmp_path: Path) -> None:
    command = ["reproduce", "jiang2015", "--seeds", "2", "--json", "--workers", "1", "--pictures", str(tmp_path / "p")]
    result = CliRunner().invoke(app, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)["jiang2015"]
    tables = {table["name"]: table for table in found["tables"]}
    assert set(tables) == {"Table 3", "Table 4", "Fig. 14", "Fig. 17", "How good Wi-Fi must be"}
    assert [row["cells"][0]["paper"] for row in tables["Table 3"]["rows"]] == [0.3001, 0.4020, 0.4158, 0.4642, 0.4435]
    papers = {row["label"]: row["cells"][0]["paper"] for row in tables["Table 4"]["rows"]}
    assert papers["gait + PF"] == 1.542
    assert papers["ELM + Wi-Fi + PF"] == 0.150
    for table in tables.values():
        for row in table["rows"]:
            assert len(row["cells"]) == len(table["columns"])
            for cell in row["cells"]:
                assert cell["ours"] is None or 0.0 < cell["ours"] < 100.0
    given = [row["cells"][1]["ours"] for row in tables["How good Wi-Fi must be"]["rows"]]
    assert given[0] < given[1], "better fixes, better places"
    claims = {claim["claim"]: claim for claim in found["claims"]}
    assert len(claims) == 17
    assert claims["fused, there is a position every 200 ms"]["holds"]
    assert all(claim["holds"] or claim["reason"] for claim in claims.values())
    assert {path.suffix for path in (tmp_path / "p").iterdir()} == {".png"}
    assert len(list((tmp_path / "p").iterdir())) == 4
