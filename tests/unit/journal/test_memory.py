"""Readers hold a chunk at a time, however long the journal."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

from tickfix.journal import JournalReader, JournalWriter, RecordKind, RunManifest

COMMIT_BYTES = 200_000
COMMITS = 100


def test_reading_a_long_journal_takes_the_memory_of_few_commits(tmp_path: Path, manifest: RunManifest) -> None:
    with JournalWriter(tmp_path, manifest) as writer:
        for _ in range(COMMITS):
            writer.append(RecordKind.EVENT, "a", 1, bytes(COMMIT_BYTES))
            writer.commit()
    tracemalloc.start()
    try:
        assert sum(len(record.payload) for record in JournalReader(tmp_path).records()) == COMMITS * COMMIT_BYTES
        (segment,) = JournalReader(tmp_path).segments(thorough=True)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert segment.complete
    assert peak < 12 * COMMIT_BYTES
