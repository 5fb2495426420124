"""Reads a journal: its segments, and the records of a run in order."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from tickfix.journal.journal_folder import JournalDamaged, JournalError, segment_paths
from tickfix.journal.segment_layout import JournalRecord, RunManifest
from tickfix.journal.segment_reader import SegmentDamage, SegmentReader, begins_with_snapshot


class ReadStart(Enum):
    """Where reading begins."""

    FIRST = "first"
    """With the oldest segment of the run that is still there."""
    REPLAYABLE = "replayable"
    """With the newest segment from which the run can be repeated: it begins with a snapshot, or with the run."""


@dataclass(frozen=True, slots=True)
class SegmentInfo:
    """What is known of a segment.

    Attributes:
        path, size: of the file, in bytes.
        manifest: None where it is damaged.
        first_number, last_number: of its intact records; the last is one less than the first where it has none.
        count: how many intact records; fewer than the numbers imply if chunks between them are damaged.
        complete: it is closed; one whose writer died is not, and can be read all the same.
        damage: what is not as it was written; of a complete one only known where it was read through.
        replayable: the run can be repeated from here.
        start_ns, end_ns: wall clock of its oldest and newest record; 0 where it has none.
    """

    path: Path
    size: int
    manifest: RunManifest | None
    first_number: int
    last_number: int
    count: int
    complete: bool
    damage: tuple[SegmentDamage, ...]
    replayable: bool
    start_ns: int
    end_ns: int


class JournalReader:
    """Reads a journal's folder, or one segment of it; nothing is ever written.

    Args:
        place: the folder, or a segment.
    """

    def __init__(self, place: Path) -> None:
        """Keep the place."""
        self.place = place

    def paths(self) -> tuple[Path, ...]:
        """Return the segments' files in their order.

        Raises:
            JournalError: when there is no such place, or no segment in it.
        """
        paths = (self.place,) if self.place.is_file() else segment_paths(self.place)
        if not paths:
            raise JournalError(f"{self.place}: no segment in it; expected 000001.mcap or later ones")
        return paths

    def segments(self, *, thorough: bool = False) -> tuple[SegmentInfo, ...]:
        """Describe the segments.

        Args:
            thorough: read complete ones, too, from end to end, instead of taking their summaries' word.
        """
        return tuple(describe_segment(path, thorough=thorough) for path in self.paths())

    def records(
        self, since: ReadStart | int = ReadStart.FIRST, *, on_damage: Callable[[SegmentDamage], None] | None = None
    ) -> Iterator[JournalRecord]:
        """Yield the records of the newest run, in the order of their numbers, without gaps.

        What ends too early (a writer died) is read as far as it goes; the segment after it goes on from there.

        Args:
            since: where to begin; a number begins with that record.
            on_damage: called with all damage in the segments read, when it is come across, and of records that are
                missing in the middle; then reading goes on behind them.

        Raises:
            JournalDamaged: where records are missing and there is no ``on_damage``; all before them were yielded.
            JournalError: when nothing can be read from ``since`` on.
        """
        wanted = since if isinstance(since, int) else 0
        expected = 0
        last: SegmentDamage | None = None
        for path in self._paths_since(since):
            reader = SegmentReader(path)
            expected = expected or (reader.manifest.first_number if reader.manifest is not None else 0)
            reported = 0
            for at, records in reader.batches():
                last = reader.damage[-1] if reader.damage else last
                reported = _report_damage(reader, reported, on_damage)
                found = records[0].number
                if found < expected:
                    raise JournalDamaged(path, at, f"record {found} again; expected record {expected}")
                if found > expected > 0:
                    missing = f"records {expected}–{found - 1} are missing"
                    if on_damage is None:
                        where = last or SegmentDamage(path, at, "nothing here is damaged")
                        raise JournalDamaged(where.path, where.offset, f"{where.what}; {missing}")
                    on_damage(SegmentDamage(path, at, missing))
                expected = records[-1].number + 1
                yield from (record for record in records if record.number >= wanted)
            last = reader.damage[-1] if reader.damage else last
            _report_damage(reader, reported, on_damage)

    def _paths_since(self, since: ReadStart | int) -> tuple[Path, ...]:
        paths = self.paths()
        manifests = [SegmentReader(path).manifest for path in paths]
        run = next(
            (manifest_of_segment.run for manifest_of_segment in reversed(manifests) if manifest_of_segment is not None),
            None,
        )
        others = [
            i
            for i, manifest_of_segment in enumerate(manifests)
            if manifest_of_segment is not None and manifest_of_segment.run != run
        ]
        oldest = others[-1] + 1 if others else 0
        if since is ReadStart.FIRST:
            return paths[oldest:]
        for i in range(len(paths) - 1, oldest - 1, -1):
            manifest_of_segment = manifests[i]
            if manifest_of_segment is None:
                continue
            if isinstance(since, int):
                if manifest_of_segment.first_number <= since:
                    return paths[i:]
            elif manifest_of_segment.first_number == 1 or begins_with_snapshot(paths[i]):
                return paths[i:]
        if isinstance(since, int):
            raise JournalError(f"{self.place}: record {since} is not there; older segments were dropped or damaged")
        raise JournalError(f"{self.place}: no segment begins with an intact snapshot, so the run cannot be repeated")


def describe_segment(path: Path, *, thorough: bool = False) -> SegmentInfo:
    """Describe one segment; see :meth:`JournalReader.segments`."""
    reader = SegmentReader(path)
    summary = reader.summary()
    manifest_of_segment = reader.manifest
    replayable = manifest_of_segment is not None and (
        manifest_of_segment.first_number == 1 or begins_with_snapshot(path)
    )
    if summary is not None and manifest_of_segment is not None and not thorough:
        first = manifest_of_segment.first_number
        count, start_ns, end_ns = summary.count, summary.start_ns, summary.end_ns
        last = first + count - 1
    else:
        first = 1 if manifest_of_segment is None else manifest_of_segment.first_number
        last, count, start_ns, end_ns = first - 1, 0, 0, 0
        for _, records in reader.batches():
            walls = [record.wall_ns for record in records]
            if count == 0:
                first, start_ns = records[0].number, walls[0]
            start_ns, end_ns = min(start_ns, *walls), max(end_ns, *walls)
            last = records[-1].number
            count += len(records)
    return SegmentInfo(
        path=path,
        size=reader.size,
        manifest=manifest_of_segment,
        first_number=first,
        last_number=last,
        count=count,
        complete=summary is not None,
        damage=tuple(reader.damage),
        replayable=replayable,
        start_ns=start_ns,
        end_ns=end_ns,
    )


def _report_damage(reader: SegmentReader, known: int, on_damage: Callable[[SegmentDamage], None] | None) -> int:
    if on_damage is not None:
        for damage in reader.damage[known:]:
            on_damage(damage)
    return len(reader.damage)
