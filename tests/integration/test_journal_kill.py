"""A writer killed at any instant: what was committed is there, and nothing half is believed.

``TICKFIX_KILLS`` says how often.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from journal_child import payload_of

from tickfix.journal import JournalLocked, JournalReader, JournalWriter, ReadStart, RecordKind
from tickfix.journal.journal_folder import TEMPORARY_SUFFIX, is_being_written

CHILD = Path(__file__).with_name("journal_child.py")
KILLS = int(os.environ.get("TICKFIX_KILLS", "10"))


def spawn(folder: Path, first_number: int, limit_bytes: int = 0) -> subprocess.Popen[str]:
    command = [sys.executable, str(CHILD), str(folder), str(first_number), str(limit_bytes)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # noqa: S603


def promises_until_killed(child: subprocess.Popen[str], after: int) -> dict[str, int]:
    """Return the highest number of every word that the child said; it is killed after some lines."""
    assert child.stdout is not None
    assert child.stderr is not None
    said: dict[str, int] = {}
    for count, line in enumerate(child.stdout):
        if count == after:
            child.send_signal(signal.SIGKILL)
        if line.endswith("\n"):
            word, number = line.split()
            said[word] = max(said.get(word, 0), int(number))
    complaint = child.stderr.read()
    assert child.wait() == -signal.SIGKILL, complaint
    child.stdout.close()
    child.stderr.close()
    return said


def test_whatever_was_committed_survives_kills_at_any_instant(tmp_path: Path) -> None:
    rng = random.Random(7)  # noqa: S311 - when to kill
    last = 0
    for kill in range(KILLS):
        child = spawn(tmp_path, last + 1)
        said = promises_until_killed(child, rng.randint(1, 60))
        assert said["committed"] > last
        assert said.get("durable", 0) <= said["committed"]
        assert not is_being_written(tmp_path)
        reader = JournalReader(tmp_path)
        numbers = []
        for record in reader.records():
            assert record.payload == payload_of(record.number)
            assert record.kind is RecordKind.SNAPSHOT or (record.t_ns, record.device) == (
                record.number,
                f"phone-{record.number % 5}",
            )
            numbers.append(record.number)
        assert numbers == list(range(1, len(numbers) + 1))
        assert len(numbers) >= said["committed"]
        segments = reader.segments(thorough=True)
        assert all(segment.manifest is not None for segment in segments)
        torn = [damage for segment in segments for damage in segment.damage]
        assert len(torn) <= kill + 1
        assert all("cut off" in damage.what for damage in torn)
        start = next(reader.records(ReadStart.REPLAYABLE))
        assert start.number == 1 or start.kind is RecordKind.SNAPSHOT
        last = len(numbers)
    kept = {path: path.read_bytes() for path in JournalReader(tmp_path).paths()}
    with JournalWriter(tmp_path, segments[-1].manifest, first_number=last + 1) as writer:  # type: ignore[arg-type]
        writer.append(RecordKind.EVENT, "a", 1, b"")
    assert {path: path.read_bytes() for path in kept} == kept, "damaged tails are left as they are"
    assert not list(tmp_path.glob(f"*{TEMPORARY_SUFFIX}"))


def test_only_one_process_writes_and_its_death_gives_the_folder_back(tmp_path: Path) -> None:
    child = spawn(tmp_path, 1)
    assert child.stdout is not None
    assert child.stdout.readline().startswith("committed ")
    (segment, *_) = JournalReader(tmp_path).segments()
    assert segment.manifest is not None
    assert is_being_written(tmp_path)
    with pytest.raises(JournalLocked, match=f"process {child.pid} writes to this journal"):
        JournalWriter(tmp_path, segment.manifest)
    promises_until_killed(child, 0)
    before = len(JournalReader(tmp_path).paths())
    JournalWriter(tmp_path, segment.manifest, first_number=10**6).close()
    assert len(JournalReader(tmp_path).paths()) == before + 1
