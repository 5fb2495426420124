"""The theme of all figures: colours, line styles, canvas and legend; the same data give the same bytes."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
from matplotlib import font_manager
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

FOREGROUND: Final = "#1a1a1a"
MUTED: Final = "#6b6b6b"
_FONT: Final = "DejaVu Sans"
_SUFFIXES: Final = {".png": {"Software": None}, ".svg": {"Date": None}}
RC_PARAMS: Final[dict[Any, Any]] = {
    "font.family": _FONT,
    "font.size": 8.5,
    "text.parse_math": False,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": FOREGROUND,
    "axes.linewidth": 0.6,
    "axes.titlelocation": "left",
    "axes.titlesize": 10,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": FOREGROUND,
    "ytick.labelcolor": FOREGROUND,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "svg.hashsalt": "tickfix",
}


@dataclass(frozen=True, slots=True)
class LineStyle:
    """Colour, dashes and width of one pipeline."""

    color: str
    dashes: Any
    width: float = 1.2


# The colours of Okabe and Ito, *Color universal design* (2008), without yellow, which is too pale for a line; black is
# the truth's. Dashes tell lines apart in grey as well.
_LINE_STYLES: Final = (
    LineStyle("#0072b2", (0, (1.2, 1.2))),
    LineStyle("#e69f00", (0, (4.5, 1.6))),
    LineStyle("#009e73", (0, (5, 1.4, 1.2, 1.4))),
    LineStyle("#d55e00", "solid", 1.6),
    LineStyle("#cc79a7", (0, (7, 1.8))),
    LineStyle("#56b4e9", (0, (3, 1.2, 1.2, 1.2, 1.2, 1.2))),
)


def line_styles(count: int) -> tuple[LineStyle, ...]:
    """Return the styles of ``count`` pipelines; the last one is solid, since it is usually the one of interest."""
    solid = _LINE_STYLES[3]
    others = [line for line in _LINE_STYLES if line is not solid]
    return (*(others[i % len(others)] for i in range(count - 1)), solid)[:count]


class NotebookFigure(Figure):
    """A figure that a notebook shows when a cell ends with it, without pyplot and its global state."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        with mpl.rc_context(RC_PARAMS):
            self.savefig(buffer, format="png", dpi=110, bbox_inches="tight", pad_inches=0.08)
        return buffer.getvalue()


@contextmanager
def themed_figure(size_in: tuple[float, float]) -> Iterator[NotebookFigure]:
    """Give a figure of ``size_in`` inches to draw on; what is drawn within the context has the theme."""
    with mpl.rc_context(RC_PARAMS):
        figure = NotebookFigure(figsize=size_in, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure


def save_figure(figure: Figure, path: Path) -> None:
    """Write a themed figure to ``path``, as PNG or SVG by its suffix; equal figures give equal bytes.

    Raises:
        ValueError: for another suffix.
    """
    suffix = path.suffix.lower()
    _check_suffix(path)
    with mpl.rc_context(RC_PARAMS):
        figure.savefig(path, dpi=200, metadata=_SUFFIXES[suffix], bbox_inches="tight", pad_inches=0.08)


@contextmanager
def canvas(path: Path, size_in: tuple[float, float]) -> Iterator[Figure]:
    """Yield a figure of ``size_in`` inches and write it to ``path`` afterwards, as PNG or SVG by its suffix.

    Raises:
        ValueError: for another suffix, before anything is drawn.
    """
    _check_suffix(path)
    with themed_figure(size_in) as figure:
        yield figure
        save_figure(figure, path)


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() not in _SUFFIXES:
        raise ValueError(f"{path}: found the suffix {path.suffix.lower()!r}, expected {' or '.join(_SUFFIXES)}")


def legend(figure: Figure, entries: Sequence[tuple[Artist, str]], *, beside: bool) -> None:
    """Add a legend beside the axes or below; labels may begin with an underscore."""
    handles, labels = zip(*entries, strict=True)
    columns = 1 if beside else _legend_columns(labels, figure.get_figwidth())
    if beside:
        figure.set_figwidth(figure.get_figwidth() + _legend_width_in(labels))
    else:
        figure.set_figheight(figure.get_figheight() + 0.2 + 0.2 * math.ceil(len(labels) / columns))
    drawn = figure.legend(
        handles,
        [" "] * len(entries),
        loc="outside right upper" if beside else "outside lower center",
        ncols=columns,
        labelspacing=0.6,
    )
    for text, label in zip(drawn.get_texts(), labels, strict=True):
        text.set_text(printable(label))


def _legend_columns(labels: Sequence[str], width_in: float) -> int:
    """Return how many columns of ``labels``, with their symbols, fit into ``width_in`` inches."""
    for count in (4, 3, 2):
        rows = math.ceil(len(labels) / count)
        if sum(_legend_width_in(labels[i : i + rows]) for i in range(0, len(labels), rows)) <= width_in:
            return count
    return 1


def _legend_width_in(labels: Sequence[str]) -> float:
    return 0.65 + 0.065 * max(len(line) for label in labels for line in label.split("\n"))


def printable(text: str) -> str:
    """Return ``text`` with a box for every character the font does not have, since matplotlib warns of each."""
    return "".join(character if _has_glyph(character) else "▯" for character in text)


@cache
def _has_glyph(character: str) -> bool:
    font = font_manager.get_font(font_manager.findfont(_FONT))
    return character == "\n" or font.get_char_index(ord(character)) != 0
