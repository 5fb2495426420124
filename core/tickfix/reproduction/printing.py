"""A reproduction for the terminal: the paper's figures beside ours, then claim by claim."""

from __future__ import annotations

from collections.abc import Iterator
from textwrap import fill
from typing import Final

from rich import box
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table as Grid
from rich.text import Text

from tickfix.reproduction.report import Cell, Choice, Claim, Reproduction, Table

_TITLE_WIDTH: Final = 13


def printed(result: Reproduction, *, choices: bool) -> Group:
    """Return all there is to say; ``choices`` adds the settings of the twin."""
    parts: list[RenderableType] = [Text(f"[{result.paper}] {result.title}, {result.seeds} seeds", style="bold"), Text()]
    for table in result.tables:
        parts += [_heading(table), _grid(table)]
        if table.note:
            parts += [Padding(Text(table.note), (0, 0, 1, 2))]
    parts += _claims(result.claims)
    parts += _choices(result.choices) if choices else []
    return Group(*parts)


def _heading(table: Table) -> Text:
    return Text.assemble((table.name, "bold"), f": {table.caption}")


def _grid(table: Table) -> Grid:
    """Return the table; a column has the paper's figures, ours, or both side by side."""
    grid = Grid(box=box.SIMPLE_HEAD, padding=(0, 1))
    grid.add_column("", overflow="fold", vertical="bottom")
    columns: list[list[str]] = []
    for i, name in enumerate(table.columns):
        cells = [row[i] for row in table.rows.values()]
        sides = dict(_sides(cells, table.decimals_of(i)))
        for whose, values in sides.items():
            # Above ours, which is wider, where there are two.
            title = f"{fill(name, _TITLE_WIDTH, break_long_words=False)}\n" if whose == list(sides)[-1] else ""
            grid.add_column(Text(f"{title}{whose}"), justify="right", no_wrap=True, vertical="bottom")
            columns.append(values)
    for n, label in enumerate(table.rows):
        grid.add_row(Text(label), *(Text(column[n]) for column in columns))
    return grid


def _sides(cells: list[Cell], decimals: int) -> Iterator[tuple[str, list[str]]]:
    papers = ["–" if cell.paper is None else f"{cell.paper:.{decimals}f}" for cell in cells]
    ours = ["–" if cell.ours is None else cell.ours.text(decimals) for cell in cells]
    for whose, values in (("paper", papers), ("ours", ours)):
        if set(values) != {"–"}:
            yield whose, values


def _claims(claims: tuple[Claim, ...]) -> list[RenderableType]:
    held = sum(claim.holds for claim in claims)
    parts: list[RenderableType] = [Text.assemble(("Claims", "bold"), f": {held} of {len(claims)} hold"), Text()]
    for claim in claims:
        verdict = ("holds  ", "green") if claim.holds else ("DOES NOT HOLD  ", "red")
        parts.append(Text.assemble("  ", verdict, claim.claim))
        between = "" if claim.interval is None or claim.interval.seeds == 0 else _between(claim)
        parts.append(Padding(Text(f"paper: {claim.paper}; ours: {claim.ours}{between}"), (0, 0, 0, 9)))
        if claim.reason:
            parts.append(Padding(Text(claim.reason), (0, 0, 0, 9)))
    return [*parts, Text()]


def _between(claim: Claim) -> str:
    assert claim.interval is not None  # noqa: S101 - the caller asked
    return f" (decided by [{claim.interval.low:.3g}, {claim.interval.high:.3g}])"


def _choices(choices: tuple[Choice, ...]) -> list[RenderableType]:
    grid = Grid(box=box.SIMPLE_HEAD, padding=(0, 1))
    for title in ("setting", "value", "source"):
        grid.add_column(title, overflow="fold")
    for choice in choices:
        grid.add_row(Text(choice.what), Text(choice.value), Text(choice.source))
    return [Text("The twin", style="bold"), grid]
