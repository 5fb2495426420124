"""What a reproduction gives back: tables with the paper's figures beside ours, and a line for each claim."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol

_ROUNDING: Final = 1e-9
"""Figures that differ by less than this share are the same."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
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
        half = "" if width <= _ROUNDING * abs(self.mean) else f" ± {width / 2:.{decimals}f}"
        return f"{self.mean:.{decimals}f}{half}{f' {unit}' if unit else ''}"

    def as_json(self) -> list[float]:
        """Return the interval as ``[low, high]``."""
        return [self.low, self.high]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One figure of a table: the paper's and ours; either may be missing."""

    paper: float | None
    ours: Interval | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table of the paper.

    Attributes:
        name: as the paper calls it, such as ``"Table 4"``.
        caption: what it shows, with the unit.
        columns: names of the figures, with their units.
        rows: by label, a cell per column.
        decimals: to print, one number for all columns or one for each.
        note: what a reader must know before comparing; empty where nothing.
    """

    name: str
    caption: str
    columns: tuple[str, ...]
    rows: Mapping[str, tuple[Cell, ...]]
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
        holds: whether it does on the twin.
        reason: why not, or why only just; empty where there is nothing to say.
    """

    claim: str
    paper: str
    ours: str
    interval: Interval | None
    holds: bool
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
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
        choices: the twin.
        tables, claims: what came out.
        pictures: drawn, where they were asked for.
        failures: stage calls that failed, by stage and kind of error; empty in a sound run.
    """

    paper: str
    title: str
    seeds: int
    choices: tuple[Choice, ...]
    tables: tuple[Table, ...]
    claims: tuple[Claim, ...]
    pictures: tuple[Path, ...] = ()
    failures: Mapping[str, int] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Return what ``--json`` prints for this paper."""
        return {
            "tables": [_table_json(table) for table in self.tables],
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


class Show(Protocol):
    """Progress: called with a label, how much is done, and of how much."""

    def __call__(self, label: str, done: int, total: int, /) -> None:
        """Show it."""


def _table_json(table: Table) -> dict[str, Any]:
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
