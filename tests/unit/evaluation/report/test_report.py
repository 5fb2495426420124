"""The report: self-contained, the verdict first, everything in it that was promised."""

from __future__ import annotations

import csv
import json
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tickfix.api import Floor
from tickfix.evaluation.comparison.comparison_result import ComparisonResult, compare_trials
from tickfix.evaluation.report.charts import MAX_LINES, drawn_pipelines, pareto, pipeline_styles
from tickfix.evaluation.report.html_report import html_page, inline_svg
from tickfix.evaluation.report.report_data import Chart, build_report, worst_walks
from tickfix.evaluation.report.report_files import write_report

HOUR_NS = 3_600_000_000_000
PLAN = Floor(
    name="F1",
    outline=(np.array([[0.0, -9], [30, -9], [30, 9], [0, 9]]),),
    obstacles=(np.array([[4.0, 4], [6, 4], [6, 6]]),),
    walls=np.array([[[8.0, 0.0], [8.0, 3.0]]]),
)
FLOORS = {("site", "F1"): PLAN}


def result_for(trial_of: Any, offs: dict[str, float], walks: int = 3, **provenance: Any) -> ComparisonResult:
    """Walks along x that each pipeline misses by its own distance, every walk by more than the one before."""
    trials = [
        trial_of(
            f"walk <{i}>",
            began_ns=i * HOUR_NS,
            every=3,
            **{name: [(float(k), off * (1 + i + 0.1 * (k % 3))) for k in range(1, 26)] for name, off in offs.items()},
        )
        for i in range(walks)
    ]
    return compare_trials(trials, baseline=next(iter(offs)), provenance={"command": "tickfix compare …", **provenance})


@pytest.fixture(scope="module")
def result(trial_of: Any) -> ComparisonResult:
    return result_for(trial_of, {"A & co": 2.0, "B": 1.0})


@pytest.fixture(scope="module")
def folder(result: ComparisonResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("report")
    assert write_report(result, FLOORS, place, draw=2) == place / "report.html"
    return place


class Reader(HTMLParser):
    """Collects ids, references, and the text outside of styles; complains of tags that are not closed."""

    VOID = frozenset({"meta", "br", "hr", "img", "link"})

    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.outside: list[str] = []
        self.inside: list[str] = []
        self.open: list[str] = []
        self.diagnosis: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href", "action", "data"):
                (self.inside if str(value).startswith("#") else self.outside).append(str(value))
            self.inside += re.findall(r"url\((#[^)]+)\)", str(value))

    def handle_startendtag(self, tag: str, attrs: Any) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.diagnosis.append(data)


def read(page: str) -> Reader:
    reader = Reader()
    reader.feed(page)
    reader.close()
    assert reader.open == []
    return reader


def test_the_page_asks_no_network_and_its_parts_find_each_other(folder: Path) -> None:
    page = (folder / "report.html").read_text("utf-8")
    found = read(page)
    assert found.outside == []
    assert "<script" not in page
    assert "@import" not in page
    assert len(found.ids) == len(set(found.ids))
    assert {reference.removeprefix("#") for reference in found.inside} <= set(found.ids)


def test_the_verdict_comes_first_and_names_are_escaped(folder: Path, result: ComparisonResult) -> None:
    diagnosis = [word.strip() for word in read((folder / "report.html").read_text("utf-8")).diagnosis if word.strip()]
    text = " ".join(diagnosis)
    assert result.verdicts()[0].verdict in text
    assert text.index("Verdict") < text.index("Errors in metres") < text.index("Figures")
    assert "site: walk <2>" in text
    assert "INTERPOLATED" in text
    assert "tickfix compare …" in text
    assert result.summary.pipelines["B"].published in text


def test_walks_are_drawn_the_worst_first_and_no_more_than_asked(folder: Path, result: ComparisonResult) -> None:
    page = (folder / "report.html").read_text("utf-8")
    assert page.count('<svg class="walk"') == 2
    assert page.index("site: walk &lt;2&gt;") < page.index("site: walk &lt;1&gt;")
    assert "2 of 3 walks are drawn; --draw 3 draws all." in page
    assert page.count('<g id="plan-0">') == 1
    assert page.count('href="#plan-0"') == 2
    worst = worst_walks(result.trials)
    assert [walk.trial.walk for walk in worst] == ["walk <2>", "walk <1>", "walk <0>"]
    (a, b) = worst[0].worst_cases
    assert (a.pipeline, a.worst_m, b.worst_m) == ("A & co", pytest.approx(6.2), pytest.approx(3.1))
    assert a.diagnosis == "tracking, no observation used yet"


def test_the_figures_are_vector_graphics_that_stand_alone(folder: Path) -> None:
    names = {path.stem for path in (folder / "figures").iterdir()}
    expected = {"differences", "cdf-all", "cdf-covered", "paired", "walks", "time", "distance", "uncertainty"}
    assert names == expected
    for path in (folder / "figures").iterdir():
        root = ET.parse(path).getroot()  # noqa: S314 - written a moment ago
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert "<image" not in path.read_text("utf-8")


def test_markdown_json_and_csv_say_the_same(folder: Path, result: ComparisonResult) -> None:
    text = (folder / "report.md").read_text("utf-8")
    assert text.index("## Verdict") < text.index("## Figures")
    for link in re.findall(r"!\[[^]]*\]\(([^)]+)\)", text):
        assert (folder / link).is_file()
    assert json.loads((folder / "report.json").read_text("utf-8")) == json.loads(json.dumps(result.as_json()))
    with (folder / "samples.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    errors = [float(row["error_m"]) for row in rows if row["pipeline"] == "B"]
    assert np.mean(errors) == pytest.approx(result.metrics["B"]["all"]["mean_m"])
    assert len(rows) == 2 * 3 * 9
    with (folder / "metrics.csv").open(encoding="utf-8") as file:
        (mean,) = [
            row["value"]
            for row in csv.DictReader(file)
            if (row["pipeline"], row["group"], row["metric"]) == ("B", "all", "mean_m")
        ]
    assert float(mean) == result.metrics["B"]["all"]["mean_m"]
    with (folder / "comparisons.csv").open(encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) == len(result.comparisons)


def test_the_same_result_gives_the_same_bytes(folder: Path, result: ComparisonResult, tmp_path: Path) -> None:
    write_report(result, FLOORS, tmp_path, draw=2)
    for path in sorted(folder.rglob("*.*")):
        assert (tmp_path / path.relative_to(folder)).read_bytes() == path.read_bytes(), path.name


def test_a_sweep_gets_its_curve_its_heat_map_and_the_front(trial_of: Any, tmp_path: Path) -> None:
    offs = {f"f[k={k}, q={q}]": 1.0 + 0.2 * k + q for k in (1, 2, 3) for q in (0.5, 0.1)}
    sweeps = {
        **{
            name: {"table": "f", "values": dict(zip("kq", (i // 2, i % 2), strict=True))} for i, name in enumerate(offs)
        },
        "g[n=100]": {"table": "g", "values": {"n": 100}},
        "g[n=1000]": {"table": "g", "values": {"n": 1000}},
    }
    result = result_for(trial_of, {**offs, "g[n=100]": 3.0, "g[n=1000]": 2.5}, walks=1, sweeps=sweeps)
    write_report(result, FLOORS, tmp_path, draw=0)
    text = (tmp_path / "report.md").read_text("utf-8")
    assert "Mean error in metres at all scored waypoints; the least is bold." in text
    assert "Mean error by n." in text
    assert "The line joins the pipelines that no other beats in both;" in text
    drawn = drawn_pipelines(result)
    assert len(drawn) == MAX_LINES
    assert drawn[0] == "f[k=1, q=0.5]"  # the baseline, though it is not among the best
    assert "f[k=1, q=0.1]" in drawn


def test_the_front_holds_what_no_other_beats_in_both() -> None:
    assert pareto([1.0, 2.0, 3.0, 2.0, 9.0], [5.0, 4.0, 4.5, 6.0, 1.0]) == (0, 1, 4)
    assert pareto([1.0, 1.0], [2.0, 1.0]) == (1,)


def test_inlined_figures_keep_their_references_apart() -> None:
    svg = '<?xml?><svg><metadata>x</metadata><path id="p"/><use xlink:href="#p"/><g clip-path="url(#c)"/></svg>'
    assert inline_svg(svg, "f1-") == (
        '<svg><path id="f1-p"/><use xlink:href="#f1-p"/><g clip-path="url(#f1-c)"/></svg>'
    )


def test_a_run_without_a_scored_waypoint_still_has_a_report(trial_of: Any, tmp_path: Path) -> None:
    result = compare_trials([trial_of("w", A=[None, None], B=[None, (1, 1)])], baseline="A")
    page = html_page(build_report(result), (), pipeline_styles(result), FLOORS, draw=5)
    read(page)
    assert "No waypoint was scored." in page
    write_report(result, {}, tmp_path, draw=5)


def test_one_pipeline_alone_is_reported_without_comparison(trial_of: Any, tmp_path: Path) -> None:
    write_report(result_for(trial_of, {"A": 2.0}), FLOORS, tmp_path, draw=1)
    assert "There is nothing to compare one pipeline with." in (tmp_path / "report.html").read_text("utf-8")


def test_the_page_says_how_the_comparison_was_made(trial_of: Any) -> None:
    provenance = {
        "sites": [{"name": "F1 <1>", "digest": "ab12", "walks": 7}],
        "crossvalidation": {"folds": 3, "holdout_share": 0.3},
        "code": {"A": "c0de"},
        "versions": {"numpy": "1.26"},
        "seeds": [0, 1],
        "start_known": True,
    }
    report = build_report(result_for(trial_of, {"A": 2.0, "B": 1.0}, **provenance))
    rows = dict(report.provenance)
    assert rows["cross-validation"] == "3 folds per floor, 0.3 of the walks held out"
    assert rows["seeds"] == "0, 1"
    assert rows["start"] == "first waypoint given"
    tables = {table.caption: table.rows for table in report.provenance_tables}
    assert tables["SHA-256 of the sites"] == (("F1 <1>", "7", "ab12"),)
    assert tables["SHA-256 of the code that ran"] == (("A", "c0de"),)
    page = html_page(report, (), {}, FLOORS, draw=0)
    read(page)
    assert "F1 &lt;1&gt;" in page
    assert "<1>" not in page


def test_charts_follow_the_screen_and_heat_maps_keep_their_colours(folder: Path, result: ComparisonResult) -> None:
    charts = [
        Chart(folder / "figures" / "walks.svg", "Walks", ""),
        Chart(folder / "figures" / "walks.svg", "Heat", "", keeps_colors=True),
    ]
    page = html_page(build_report(result), charts, {}, {}, draw=0)
    follows, keeps = re.findall(r"<figure.*?</figure>", page, re.DOTALL)
    assert "var(--ink, #1a1a1a)" in follows
    assert "var(--paper, #ffffff)" in follows
    assert "var(--" not in keeps
    assert 'class=" fixed"' in keeps
