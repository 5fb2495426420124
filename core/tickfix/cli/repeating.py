"""``tickfix replay --journal``: a live run again, and whether it says the same."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import typer

from tickfix.cli.output import print_json, progress, registry, stdout, warn, warn_of
from tickfix.drivers.live.runs.repeating import Repetition, repeat_journal


def repeat(journal: Path, site: Path | None, *, as_json: bool) -> None:
    """Repeat a journal and say what came of it; the exit code is 1 where anything differs."""
    found = registry()
    with progress() as show:
        repetition = repeat_journal(journal, found, site=site, progress=show)
    warn_of(tuple(map(str, repetition.damage)), "damaged places")
    warn_of((*repetition.skipped, *repetition.warnings), "warnings")
    if as_json:
        print_json(_plain(repetition))
    else:
        _tell(repetition)
    if repetition.differences:
        raise typer.Exit(1)


def _tell(repetition: Repetition) -> None:
    console = stdout()
    console.print(
        f"run {repetition.run}: {repetition.segments} segments repeated, {repetition.estimates} estimates and "
        f"{repetition.revisions} revisions compared"
    )
    if repetition.first is None:
        console.print(f"every byte is the same; published {repetition.published}", soft_wrap=True)
    else:
        warn(f"{repetition.differences} differ, the first: {repetition.first}")


def _plain(repetition: Repetition) -> dict[str, object]:
    plain = {name: value for name, value in asdict(repetition).items() if name not in ("first", "damage")}
    plain["first_difference"] = None if repetition.first is None else str(repetition.first)
    plain["damage"] = [str(damage) for damage in repetition.damage]
    plain["identical"] = repetition.differences == 0
    return plain
