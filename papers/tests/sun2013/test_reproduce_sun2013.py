"""``tickfix reproduce``: the whole command, on fewer samples where the full experiment takes its minutes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from tickfix.cli.main import app
from tickfix_papers.sun2013 import twin

Run = Callable[..., str]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run the command in this process, with an experiment of [sun2013] cut down to seconds."""
    fewer = {
        "SURVEY_S": 10.0,
        "TEST_S": 4.0,
        "PASSES": 4,
        "SURFACE_N": (1, 2),
        "SURFACE_K": (1, 7),
        "SURFACE_STARTS": (0,),
        "COMPARED_PASSES": 1,
        "PLAIN_POINTS": 2,
    }
    for name, value in fewer.items():
        monkeypatch.setattr(twin, name, value)

    def invoke(*arguments: object) -> str:
        result = CliRunner().invoke(app, ["reproduce", *map(str, arguments)], catch_exceptions=False)
        assert result.exit_code == 0, result.output
        return result.stdout

    return invoke


def test_the_json_has_every_table_and_claim(run: Run) -> None:
    found: dict[str, Any] = json.loads(run("sun2013", "--seeds", "2", "--json", "--workers", "1"))
    assert set(found) == {"sun2013"}
    assert set(found["sun2013"]) == {"tables", "claims"}
    tables = {table["name"]: table for table in found["sun2013"]["tables"]}
    assert {"Table 2", "Table 3", "Table 4", "Table 5", "Figure 4"} <= set(tables)
    assert [row["label"] for row in tables["Table 2"]["rows"]] == ["KNN", "WKNN", "FNCC"]
    assert [row["cells"][0]["paper"] for row in tables["Table 2"]["rows"]] == [2.77, 2.74, 2.60]
    for table in tables.values():
        for row in table["rows"]:
            assert len(row["cells"]) == len(table["columns"])
    for row in tables["Table 2"]["rows"]:
        for cell in row["cells"]:
            low, high = cell["interval"]
            assert low <= cell["ours"] <= high
        assert 0.3 < row["cells"][0]["ours"] < 10.0
    claims = found["sun2013"]["claims"]
    assert len(claims) >= 10
    for claim in claims:
        assert set(claim) == {"claim", "paper", "ours", "interval", "holds", "reason"}
        assert isinstance(claim["holds"], bool)
        assert claim["holds"] or claim["reason"]
    (same,) = [claim for claim in claims if "with its sign kept" in claim["claim"]]
    assert same["holds"]
    assert (
        run("sun2013", "--seeds", "2", "--json", "--workers", "2")
        == json.dumps(found, indent=2, ensure_ascii=False) + "\n"
    )


def test_people_get_tables_claims_choices_and_pictures(run: Run, tmp_path: Path) -> None:
    text = run("sun2013", "--seeds", "2", "--pictures", tmp_path / "p", "--twin-settings")
    assert all(part in text for part in ("Table 5", "FNCC + KMF", "±", "hold", "reference points", "sun2013-walk.png"))
    assert {path.name for path in (tmp_path / "p").iterdir()} >= {"sun2013-surfaces.png", "sun2013-cdf.png"}
