"""No room: a clear error, the past intact, and on it goes when there is room again."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from journal_child import MANIFEST, payload_of
from test_journal_kill import spawn

from tickfix.journal import JournalFull, JournalReader, JournalWriter, ReadStart, RecordKind


@contextmanager
def files_no_larger_than(limit_bytes: int) -> Iterator[None]:
    """Let no write of this process take a file beyond a size: the system answers EFBIG."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def fill(writer: JournalWriter) -> None:
    while True:
        writer.append(RecordKind.EVENT, "a", 1, os.urandom(30_000))
        writer.commit()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 1 MB; skipped where this process may not mount one."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = shutil.which("mount")
    command = [mount or "mount", "-t", "tmpfs", "-o", "size=1m", "none", str(place)]
    if mount is None or subprocess.run(command, check=False, capture_output=True).returncode:  # noqa: S603
        pytest.skip("a disk can only be mounted by root")
    yield place
    # Lazily: a test that failed may have left files open, and a disk left behind would trouble the next run.
    subprocess.run(["umount", "--lazy", str(place)], check=True)  # noqa: S603, S607


def test_a_disk_that_fills_up_costs_nothing_that_was_committed_and_takes_more_when_there_is_room(
    small_disk: Path,
) -> None:
    filler = small_disk / "filler"
    filler.write_bytes(bytes(400_000))
    folder = small_disk / "journal"
    writer = JournalWriter(folder, MANIFEST)
    with pytest.raises(JournalFull, match=r"000001\.mcap: no room for more \(No space left on device\)"):
        fill(writer)
    committed = writer.next_number - 2
    assert committed > 10
    with pytest.raises(JournalFull):
        writer.commit()
    with pytest.raises(JournalFull, match=r"000001\.mcap"):
        writer.roll_segment(b"snapshot")
    (segment,) = JournalReader(folder).segments()
    assert (segment.last_number, segment.damage) == (committed, ())
    writer.discard()
    with pytest.raises(JournalFull, match=r"000002\.mcap"):
        writer.roll_segment(bytes(100_000))
    assert [path.name for path in JournalReader(folder).paths()] == ["000001.mcap"]
    assert writer.append(RecordKind.EVENT, "a", 1, b"small") == committed + 1
    filler.unlink()
    writer.commit()
    writer.roll_segment(b"snapshot")
    writer.append(RecordKind.EVENT, "a", 1, b"last")
    writer.close()
    assert [r.number for r in JournalReader(folder).records()] == list(range(1, committed + 4))
    assert all(s.complete and not s.damage for s in JournalReader(folder).segments(thorough=True))


def test_a_journal_cannot_begin_where_there_is_no_room_and_leaves_nothing_behind(small_disk: Path) -> None:
    folder = small_disk / "journal"
    folder.mkdir()
    with pytest.raises(OSError, match="No space left"):
        (small_disk / "filler").write_bytes(bytes(2_000_000))
    with pytest.raises(JournalFull, match=r"000001\.mcap: no room"):
        JournalWriter(folder, MANIFEST)
    assert [path.name for path in folder.iterdir()] == ["lock"]
    (small_disk / "filler").unlink()
    JournalWriter(folder, MANIFEST).close()


def test_where_files_may_not_grow_the_past_stays_and_a_smaller_commit_still_fits(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, MANIFEST) as writer:
        writer.append(RecordKind.EVENT, "a", 1, b"first")
        writer.commit()
        size = writer.path.stat().st_size
        writer.append(RecordKind.EVENT, "a", 2, bytes(50_000))
        with files_no_larger_than(size + 1000):
            with pytest.raises(JournalFull, match="File too large"):
                writer.commit()
            assert writer.path.stat().st_size == size
            assert writer.discard() == 1
            writer.append(RecordKind.EVENT, "a", 3, b"second")
            writer.commit()
        writer.append(RecordKind.EVENT, "a", 4, bytes(50_000))
    assert [(r.number, r.t_ns) for r in JournalReader(tmp_path).records()] == [(1, 1), (2, 3), (3, 4)]
    (segment,) = JournalReader(tmp_path).segments(thorough=True)
    assert (segment.complete, segment.damage) == (True, ())


def test_a_process_goes_on_in_new_segments_where_old_ones_cannot_grow(tmp_path: Path) -> None:
    child = spawn(tmp_path, 1, limit_bytes=600_000)
    out, complaint = child.communicate(timeout=300)
    assert child.returncode == 0, complaint
    lines = [line.split() for line in out.splitlines()]
    assert [word for word, _ in lines].count("full") == 3
    committed = max(int(number) for word, number in lines if word == "committed")
    reader = JournalReader(tmp_path)
    records = list(reader.records())
    assert [r.number for r in records] == list(range(1, len(records) + 1))
    assert len(records) >= committed
    assert all(r.payload == payload_of(r.number) for r in records)
    assert len(reader.paths()) == 4
    assert not [damage for segment in reader.segments(thorough=True) for damage in segment.damage]
    assert next(reader.records(ReadStart.REPLAYABLE)).kind is RecordKind.SNAPSHOT
