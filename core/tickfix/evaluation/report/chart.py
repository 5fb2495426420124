"""What all figures of a report share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from matplotlib.axes import Axes

_GRID: Final = "#e4e4e2"


@dataclass(frozen=True, slots=True)
class Chart:
    """A figure of the report."""

    path: Path
    title: str
    caption: str


def quiet(axes: Axes) -> None:
    """Put a faint grid behind the data and leave out the frame."""
    axes.grid(color=_GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
