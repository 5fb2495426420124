"""The result of a reproduction.

Tables with the paper's figures beside ours, and a line for each claim; as JSON and for the terminal.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import fill
from typing import Any, Final, Protocol

from rich import box
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table as Grid
from rich.text import Text

_ROUNDING_SHARE: Final = 1e-9
"""Figures that differ by less than this share are the same."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SeedInterval:
    """A mean over seeds with its 95 % interval (Student's t).

    Attributes:
        mean, low, high: in the unit of what is estimated.
        seeds: how many values it rests on.
    """

    mean: float
    low: float
    high: float
    seeds: int

    def text(self, decimals: int = 2, unit: str = "") -> str:
        """Return ``mean ± half the interval unit``; a figure without chance has no interval."""
        width = self.high - self.low
        half = "" if width <= _ROUNDING_SHARE * abs(self.mean) else f" ± {width / 2:.{decimals}f}"
        return f"{self.mean:.{decimals}f}{half}{f' {unit}' if unit else ''}"

    def as_json(self) -> list[float]:
        """Return the interval as ``[low, high]``."""
        return [self.low, self.high]


@dataclass(frozen=True, slots=True, kw_only=True)
class TableCell:
    """One figure of a table: the paper's and ours; either may be missing."""

    paper: float | None
    ours: SeedInterval | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperTable:
    """A table of the paper.

    Attributes:
        name: as the paper calls it, such as ``"Table 4"``.
        caption: what it shows, with the unit.
        columns: names of the figures, with their units.
        rows: by label, a cell per column.
        decimals: to print, one number for all columns or one for each.
        note: what a reader must know before comparing; empty if there is nothing.
    """

    name: str
    caption: str
    columns: tuple[str, ...]
    rows: Mapping[str, tuple[TableCell, ...]]
    decimals: int | tuple[int, ...] = 2
    note: str = ""

    def decimals_of(self, column: int) -> int:
        """Return how many decimals a column is printed with."""
        return self.decimals if isinstance(self.decimals, int) else self.decimals[column]


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """A claim of the paper, checked.

    Attributes:
        claim: in one sentence.
        paper: the paper's figure, with unit, as text.
        ours: what we found, as text.
        interval: of the quantity that decides (a paired difference over seeds, say), None where no seed enters.
        holds: whether it holds on the twin.
        reason: why it does not hold; empty if it does.
    """

    claim: str
    paper: str
    ours: str
    interval: SeedInterval | None
    holds: bool
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinSetting:
    """A setting of the twin: ``source`` names where the paper prints it, or says ``chosen`` and why."""

    what: str
    value: str
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Reproduction:
    """A paper's experiment, run again.

    Attributes:
        paper, title: its key, and what was reproduced.
        seeds: how often the experiment ran.
        twin_settings: the twin.
        tables, claims: what came out.
        pictures: drawn, where they were asked for.
        failures: stage calls that failed, by stage and kind of error; empty in a sound run.
    """

    paper: str
    title: str
    seeds: int
    twin_settings: tuple[TwinSetting, ...]
    tables: tuple[PaperTable, ...]
    claims: tuple[Claim, ...]
    pictures: tuple[Path, ...] = ()
    failures: Mapping[str, int] = field(default_factory=dict)

    def render(self, *, twin_settings: bool) -> Group:
        """Return tables and claims for the terminal; ``twin_settings`` adds the settings of the twin."""
        return render_reproduction(self, twin_settings=twin_settings)

    def as_json(self) -> dict[str, Any]:
        """Return what ``--json`` prints for this paper."""
        return {
            "tables": [_table_as_json(table) for table in self.tables],
            "claims": [
                {
                    "claim": claim.claim,
                    "paper": claim.paper,
                    "ours": claim.ours,
                    "interval": None if claim.interval is None else claim.interval.as_json(),
                    "holds": claim.holds,
                    "reason": claim.reason,
                }
                for claim in self.claims
            ],
        }


class ProgressCallback(Protocol):
    """Progress: called with a label, how much is done, and of how much."""

    def __call__(self, label: str, done: int, total: int, /) -> None:
        """Show it."""


def _table_as_json(table: PaperTable) -> dict[str, Any]:
    return {
        "name": table.name,
        "caption": table.caption,
        "columns": list(table.columns),
        "rows": [
            {
                "label": label,
                "cells": [
                    {
                        "paper": cell.paper,
                        "ours": None if cell.ours is None else cell.ours.mean,
                        "interval": None if cell.ours is None else cell.ours.as_json(),
                    }
                    for cell in cells
                ],
            }
            for label, cells in table.rows.items()
        ],
        "note": table.note,
    }


_TITLE_WIDTH: Final = 13


def render_reproduction(result: Reproduction, *, twin_settings: bool) -> Group:
    """Return tables and claims for the terminal; ``twin_settings`` adds the settings of the twin."""
    parts: list[RenderableType] = [Text(f"[{result.paper}] {result.title}, {result.seeds} seeds", style="bold"), Text()]
    for table in result.tables:
        parts += [_table_heading(table), _table_grid(table)]
        if table.note:
            parts += [Padding(Text(table.note), (0, 0, 1, 2))]
    parts += _claim_lines(result.claims)
    parts += _twin_grid(result.twin_settings) if twin_settings else []
    return Group(*parts)


def _table_heading(table: PaperTable) -> Text:
    return Text.assemble((table.name, "bold"), f": {table.caption}")


def _table_grid(table: PaperTable) -> Grid:
    """Return the table; a column has the paper's figures, ours, or both side by side."""
    grid = Grid(box=box.SIMPLE_HEAD, padding=(0, 1))
    grid.add_column("", overflow="fold", vertical="bottom")
    columns: list[list[str]] = []
    for i, name in enumerate(table.columns):
        cells = [row[i] for row in table.rows.values()]
        sides = dict(_column_sides(cells, table.decimals_of(i)))
        for whose, values in sides.items():
            # Above ours, which is wider, where there are two.
            title = f"{fill(name, _TITLE_WIDTH, break_long_words=False)}\n" if whose == list(sides)[-1] else ""
            grid.add_column(Text(f"{title}{whose}"), justify="right", no_wrap=True, vertical="bottom")
            columns.append(values)
    for n, label in enumerate(table.rows):
        grid.add_row(Text(label), *(Text(column[n]) for column in columns))
    return grid


def _column_sides(cells: list[TableCell], decimals: int) -> Iterator[tuple[str, list[str]]]:
    papers = ["–" if cell.paper is None else f"{cell.paper:.{decimals}f}" for cell in cells]
    ours = ["–" if cell.ours is None else cell.ours.text(decimals) for cell in cells]
    for whose, values in (("paper", papers), ("ours", ours)):
        if set(values) != {"–"}:
            yield whose, values


def _claim_lines(claims: tuple[Claim, ...]) -> list[RenderableType]:
    held = sum(claim.holds for claim in claims)
    parts: list[RenderableType] = [Text.assemble(("Claims", "bold"), f": {held} of {len(claims)} hold"), Text()]
    for claim in claims:
        verdict = ("holds  ", "green") if claim.holds else ("DOES NOT HOLD  ", "red")
        parts.append(Text.assemble("  ", verdict, claim.claim))
        between = "" if claim.interval is None or claim.interval.seeds == 0 else _interval_note(claim)
        parts.append(Padding(Text(f"paper: {claim.paper}; ours: {claim.ours}{between}"), (0, 0, 0, 9)))
        if claim.reason:
            parts.append(Padding(Text(claim.reason), (0, 0, 0, 9)))
    return [*parts, Text()]


def _interval_note(claim: Claim) -> str:
    assert claim.interval is not None  # noqa: S101 - the caller asked
    return f" (decided by [{claim.interval.low:.3g}, {claim.interval.high:.3g}])"


def _twin_grid(twin_settings: tuple[TwinSetting, ...]) -> list[RenderableType]:
    grid = Grid(box=box.SIMPLE_HEAD, padding=(0, 1))
    for title in ("setting", "value", "source"):
        grid.add_column(title, overflow="fold")
    for twin_setting in twin_settings:
        grid.add_row(Text(twin_setting.what), Text(twin_setting.value), Text(twin_setting.source))
    return [Text("The twin", style="bold"), grid]
