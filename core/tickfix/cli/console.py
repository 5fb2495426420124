"""What every command prints: results on stdout, progress bars and warnings on stderr."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import msgspec
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

from tickfix.registry import Registry, discover
from tickfix.replay.recording_files import Progress

_MAX_WARNINGS: Final = 5
_PIPED_COLUMNS: Final = 120


def stdout() -> Console:
    """Return the console for results; where no terminal tells its width, tables take theirs."""
    width = None if sys.stdout.isatty() or "COLUMNS" in os.environ else _PIPED_COLUMNS
    return Console(width=width, markup=False, highlight=False, emoji=False)


def print_json(value: Any) -> None:
    """Print one JSON object and nothing else."""
    sys.stdout.write(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def print_json_line(value: Any) -> None:
    """Print one JSON object on one line, at once; what is not a finite number becomes null."""
    sys.stdout.buffer.write(msgspec.json.encode(value) + b"\n")
    sys.stdout.buffer.flush()


def warn(text: str) -> None:
    """Print a warning."""
    sys.stderr.write(f"tickfix: warning: {text}\n")


def warn_each(problems: tuple[str, ...], what: str) -> None:
    """Print the first few problems and how many more there are."""
    for problem in problems[:_MAX_WARNINGS]:
        warn(problem)
    if len(problems) > _MAX_WARNINGS:
        warn(f"… and {len(problems) - _MAX_WARNINGS} more {what}")


def registry() -> Registry:
    """Discover the plugins; broken ones are told of and left out."""
    plugins = discover()
    for problem in plugins.problems:
        warn(f"plugin {problem}")
    return plugins


@contextmanager
def progress() -> Iterator[Progress]:
    """Show bars on stderr, one for each kind of work."""
    columns = (
        TextColumn("{task.description:>10}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    # Without a thread that refreshes: work is forked from here.
    with Bars(*columns, console=Console(stderr=True), auto_refresh=False) as bars:
        tasks: dict[str, TaskID] = {}

        def show(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=total)
            bars.update(tasks[what], completed=done, total=total, refresh=True)

        yield show
