"""What a reproduction gives to programs and to people."""

from __future__ import annotations

import json

import pytest
from rich.console import Console

from tickfix_papers.reproduction_report import PaperTable, Reproduction, TableCell, TwinSetting, render_reproduction
from tickfix_papers.seed_statistics import decide_claim, exact_value, mean

HELPS = decide_claim("B helps", mean([0.2, 0.4]), paper="0.1 m", ours="0.3 m", above=0.0)
COUNTED = decide_claim("They are 91", exact_value(91.0), paper="91", ours="91", above=90.0, below=92.0)
RESULT = Reproduction(
    paper="nobody1999",
    title="A method",
    seeds=2,
    twin_settings=(TwinSetting(what="access points", value="9", source="[nobody1999] section 4"),),
    tables=(
        PaperTable(
            name="Table 1",
            caption="errors",
            columns=("mean, m", "count"),
            rows={
                "A": (TableCell(paper=2.77, ours=mean([2.5, 2.6])), TableCell(paper=None, ours=exact_value(91.0))),
                "B": (TableCell(paper=2.60, ours=None), TableCell(paper=None, ours=exact_value(5.0))),
            },
            decimals=(2, 0),
            note="Compare the order.",
        ),
    ),
    claims=(HELPS, COUNTED),
)


def test_the_json_has_the_promised_shape() -> None:
    found = json.loads(json.dumps(RESULT.as_json(), allow_nan=False))
    assert set(found) == {"tables", "claims"}
    assert [set(claim) for claim in found["claims"]] == [{"claim", "paper", "ours", "interval", "holds", "reason"}] * 2
    low, high = found["claims"][0]["interval"]
    assert low < 0.3 < high
    (table,) = found["tables"]
    assert [row["label"] for row in table["rows"]] == ["A", "B"]
    assert table["rows"][0]["cells"][0]["paper"] == 2.77
    assert table["rows"][0]["cells"][0]["ours"] == pytest.approx(2.55)
    assert table["rows"][1]["cells"][0] == {"paper": 2.6, "ours": None, "interval": None}


def test_people_read_both_figures_side_by_side_and_a_line_for_each_claim() -> None:
    console = Console(width=120, markup=False)
    with console.capture() as capture:
        console.print(render_reproduction(RESULT, twin_settings=True))
    text = capture.get()
    row = next(line for line in text.splitlines() if line.strip().startswith("A "))
    assert "2.77" in row
    assert "2.55 ± 0.64" in row
    assert text.count("paper") == 1 + 2  # the second column has no figures of the paper; each claim has
    assert "1 of 2 hold" in text
    assert "DOES NOT HOLD  B helps" in text
    assert "holds  They are 91" in text
    assert "[nobody1999] section 4" in text
