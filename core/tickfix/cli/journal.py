"""``tickfix journal``: what is in a journal, whether it is intact, and its contents for other programs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from tickfix.api import ConfigError
from tickfix.cli.console import print_json, progress, stdout, warn
from tickfix.journal import JournalReader, JournalRecord, SegmentInfo, is_being_written
from tickfix.journal.journal_export import FoxglovePoseFile, record_to_json_line
from tickfix.journal.journal_reader import describe_segment
from tickfix.kernel.determinism import numeric_probe

app = typer.Typer(help="Look into a journal, verify it, or export it.", pretty_exceptions_enable=False)

JournalPath = Annotated[Path, typer.Argument(metavar="PATH", help="A journal's folder, or one of its segments.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]


@app.command()
def info(journal: JournalPath, *, as_json: AsJson = False) -> None:
    """Say what made the run, and which segments there are; closed ones are taken by their summaries' word."""
    segments = JournalReader(journal).segments()
    if as_json:
        print_json(_segments_json(journal, segments))
        return
    console = stdout()
    _print_manifest(console, segments)
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1))
    for column in ("segment", "run", "records", "MB", "from", "to", "state"):
        folds = column in ("run", "from", "to", "state")
        table.add_column(
            column, overflow="fold", no_wrap=not folds, justify="right" if column in ("records", "MB") else "left"
        )
    for segment in segments:
        records = f"{segment.first_number}–{segment.last_number}" if segment.count else "none"
        run = "?" if segment.manifest is None else segment.manifest.run
        times = [_format_time(ns) if segment.count else "" for ns in (segment.start_ns, segment.end_ns)]
        table.add_row(
            segment.path.name, run, records, f"{segment.size / 1e6:.3f}", *times, _state(journal, segments, segment)
        )
    console.print(table)
    _print_damage(console, segments)


@app.command()
def verify(journal: JournalPath, *, as_json: AsJson = False) -> None:
    """Read every byte and name what is damaged or missing; the exit code is 1 where anything is."""
    paths = JournalReader(journal).paths()
    segments: list[SegmentInfo] = []
    with progress() as show:
        for path in paths:
            show("reading", len(segments), len(paths))
            segments.append(describe_segment(path, thorough=True))
        show("reading", len(segments), len(paths))
    missing = _missing_records(segments)
    if as_json:
        print_json(_segments_json(journal, segments) | {"missing": missing})
    else:
        console = stdout()
        count = sum(segment.count for segment in segments)
        damaged = sum(bool(segment.damage) for segment in segments)
        console.print(f"{count} intact records in {len(segments)} segments, {damaged} of them damaged", soft_wrap=True)
        _print_damage(console, segments)
        for line in missing:
            console.print(line, soft_wrap=True)
    if missing or any(segment.damage for segment in segments):
        raise typer.Exit(1)


@app.command()
def export(
    journal: JournalPath,
    *,
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="FILE.jsonl (all but snapshots) or FILE.mcap (poses).")
    ],
) -> None:
    """Write the newest run for other programs: as JSON lines, or as an MCAP file of poses that Foxglove draws.

    Damage is told of, and reading goes on behind it.
    """
    if out.suffix not in (".jsonl", ".mcap"):
        raise ConfigError("--out", repr(out.name), "a name that ends in .jsonl or .mcap")
    if journal.is_dir() and out.resolve().parent == journal.resolve():
        raise ConfigError("--out", str(out), "a place outside the journal, whose files are its segments")
    records = JournalReader(journal).records(on_damage=lambda damage: warn(str(damage)))
    partial = out.with_name(f".{out.name}.partial")
    try:
        count = _export_lines(records, partial) if out.suffix == ".jsonl" else _export_poses(records, partial)
        partial.replace(out)
    finally:
        partial.unlink(missing_ok=True)
    what = "records" if out.suffix == ".jsonl" else "poses"
    stdout().print(f"{count} {what} are in {out}", soft_wrap=True)


def _export_lines(records: Iterator[JournalRecord], path: Path) -> int:
    count = 0
    with path.open("wb") as file:
        for record in records:
            line = record_to_json_line(record)
            if line is not None:
                file.write(line)
                count += 1
    return count


def _export_poses(records: Iterator[JournalRecord], path: Path) -> int:
    with closing(FoxglovePoseFile(path)) as file:
        return sum(file.write(record) for record in records)


def _missing_records(segments: Sequence[SegmentInfo]) -> list[str]:
    """Say which numbers are missing, within segments and between those of a run."""
    lines = []
    before: SegmentInfo | None = None
    for segment in segments:
        if lost := segment.last_number - segment.first_number + 1 - segment.count:
            span = f"{segment.first_number}–{segment.last_number}"
            lines.append(f"{segment.path}: {lost} of the records {span} are missing")
        if before is not None and _same_run(before, segment) and segment.first_number != before.last_number + 1:
            found = f"begins with record {segment.first_number}, expected {before.last_number + 1}"
            lines.append(f"{segment.path}: {found} after {before.path.name}")
        before = segment
    return lines


def _same_run(a: SegmentInfo, b: SegmentInfo) -> bool:
    return a.manifest is not None and b.manifest is not None and a.manifest.run == b.manifest.run


def _print_manifest(console: Console, segments: Sequence[SegmentInfo]) -> None:
    manifest = next((s.manifest for s in reversed(segments) if s.manifest is not None), None)
    if manifest is None:
        return
    same = "as on this machine" if manifest.probe == numeric_probe() else "not as on this machine: bits may differ"
    plugins = ", ".join(f"{name} {version}" for name, version in manifest.plugins.items())
    lines = {
        "run": f"{manifest.run}, begun {_format_time(manifest.wall_start_ns)}",
        "tickfix": manifest.tickfix_version,
        "plugins": plugins or "none",
        "seed": str(manifest.seed),
        "probe": f"{manifest.probe[:16]}…, {same}",
        **manifest.notes,
    }
    for name, text in lines.items():
        console.print(f"{name:8} {text}", soft_wrap=True)


def _print_damage(console: Console, segments: Sequence[SegmentInfo]) -> None:
    for segment in segments:
        for damage in segment.damage:
            console.print(str(damage), soft_wrap=True)


def _state(journal: Path, segments: Sequence[SegmentInfo], segment: SegmentInfo) -> str:
    words = ["closed" if segment.complete else "not closed"]
    if not segment.complete and segment is segments[-1] and is_being_written(journal):
        words = ["being written"]
    if segment.damage:
        words.append("damaged")
    if segment.replayable:
        words.append("replays")
    return ", ".join(words)


def _segments_json(journal: Path, segments: Sequence[SegmentInfo]) -> dict[str, Any]:
    return {
        "journal": str(journal),
        "being_written": is_being_written(journal),
        "segments": [_segment_json(segment) for segment in segments],
    }


def _segment_json(segment: SegmentInfo) -> dict[str, Any]:
    manifest = segment.manifest
    return {
        "path": str(segment.path),
        "bytes": segment.size,
        "manifest": None if manifest is None else manifest.entries(),
        "first_number": segment.first_number,
        "last_number": segment.last_number,
        "records": segment.count,
        "start_ns": segment.start_ns,
        "end_ns": segment.end_ns,
        "complete": segment.complete,
        "replayable": segment.replayable,
        "damage": [{"offset": damage.offset, "what": damage.what} for damage in segment.damage],
    }


def _format_time(wall_ns: int) -> str:
    return datetime.fromtimestamp(wall_ns // 10**9, UTC).strftime("%Y-%m-%d %H:%M:%S")
