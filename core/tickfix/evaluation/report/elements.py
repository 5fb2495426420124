"""Tables and figures as elements of an HTML page."""

from __future__ import annotations

import re
from html import escape

from tickfix.evaluation.report.chart import Chart
from tickfix.evaluation.report.tables import Table


def table_html(table: Table) -> str:
    """Return a table, what is best of a column in bold."""
    best = table.best or (frozenset[int](),) * len(table.rows)
    head = "".join(f"<th>{escape(title)}</th>" for title in table.columns)
    body = "".join(
        "<tr>" + "".join(_cell(i, cell, is_best=i - 1 in good) for i, cell in enumerate(row)) + "</tr>\n"
        for row, good in zip(table.rows, best, strict=True)
    )
    caption = f"<caption>{escape(table.caption)}</caption>"
    return f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>\n'


def figure_html(chart: Chart, number: int) -> str:
    """Return a figure with its caption; ``number`` is its own in the page."""
    svg = inline(chart.path.read_text("utf-8"), f"f{number}-")
    return (
        f"<figure>{svg}<figcaption><b>{escape(chart.title)}.</b> {escape(chart.caption)} "
        f"<small>{escape(chart.path.parent.name)}/{escape(chart.path.name)}</small></figcaption></figure>\n"
    )


def inline(svg: str, prefix: str) -> str:
    """Return an SVG file as part of a page: without prolog, and with ids that no other figure has."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}\1"', body)
    body = re.sub(r"url\(#([^)]+)\)", rf"url(#{prefix}\1)", body)
    return re.sub(r'xlink:href="#([^"]+)"', rf'xlink:href="#{prefix}\1"', body)


def _cell(column: int, text: str, *, is_best: bool) -> str:
    if column == 0:
        return f"<th>{escape(text)}</th>"
    shown = f"<b>{escape(text)}</b>" if is_best else escape(text)
    return f"<td>{shown}</td>"
