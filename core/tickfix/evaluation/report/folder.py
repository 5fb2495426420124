"""The folder of a report."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from tickfix.api import Floor
from tickfix.evaluation.comparison.result import Result
from tickfix.evaluation.report.charts import draw_charts
from tickfix.evaluation.report.data import write_csv
from tickfix.evaluation.report.markdown import markdown
from tickfix.evaluation.report.page import html_page


def write_report(result: Result, floors: Mapping[tuple[str, str], Floor], folder: Path, *, draw: int) -> Path:
    """Write a report and return its page.

    ::

        report.html            the page, which needs no other file
        report.md, figures/    the same as Markdown, with its figures as SVG
        report.json            what ``tickfix compare --json`` prints
        points.csv, figures.csv, comparisons.csv

    Args:
        result: what it is about.
        floors: plans by ground and floor.
        folder: which must exist; a report in it is replaced.
        draw: greatest number of walks to draw.
    """
    figures = folder / "figures"
    figures.mkdir(exist_ok=True)
    for old in figures.glob("*.svg"):
        old.unlink()
    charts = draw_charts(result, figures)
    page = folder / "report.html"
    page.write_text(html_page(result, charts, floors, draw=draw), "utf-8")
    (folder / "report.md").write_text(markdown(result, charts), "utf-8")
    document = json.dumps(result.as_json(), indent=2, ensure_ascii=False, allow_nan=False)
    (folder / "report.json").write_text(document + "\n", "utf-8")
    write_csv(result, folder)
    return page
