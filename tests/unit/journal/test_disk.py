"""When it is said that records are on the disk; and what is dropped from it."""

from __future__ import annotations

import os
import queue
import threading
from pathlib import Path

import pytest

from tickfix.api import ConfigError
from tickfix.journal import (
    JournalError,
    JournalLocked,
    JournalReader,
    JournalSettings,
    JournalWriter,
    RecordKind,
    RunManifest,
)
from tickfix.journal.journal_writer import delete_expired_segments

WAIT_S = 30


def begun(
    folder: Path, manifest: RunManifest, settings: JournalSettings, monkeypatch: pytest.MonkeyPatch
) -> tuple[JournalWriter, list[int]]:
    """Return a writer whose thread has brought the beginning to the disk, and the handles that are, as they come."""
    calls: list[int] = []
    on_disk, caller, fsync = threading.Event(), threading.get_ident(), os.fsync

    def watched(handle: int) -> None:
        calls.append(handle)
        fsync(handle)
        if threading.get_ident() != caller and Path(f"/proc/self/fd/{handle}").is_dir():  # the folder comes last
            on_disk.set()

    monkeypatch.setattr(os, "fsync", watched)
    writer = JournalWriter(folder, manifest, settings)
    assert on_disk.wait(WAIT_S)
    return writer, calls


def test_callbacks_come_in_order_from_another_thread_and_only_when_it_is_durable(
    tmp_path: Path, manifest: RunManifest
) -> None:
    called: list[tuple[int, int]] = []
    threads = set()
    done = threading.Event()
    with JournalWriter(tmp_path, manifest, JournalSettings(sync_ms=1)) as writer:

        def note(number: int) -> None:
            called.append((number, writer.durable))
            threads.add(threading.get_ident())
            if number == 200:
                done.set()

        for number in range(1, 201):
            assert writer.append(RecordKind.EVENT, "a", number, b"") == number
            writer.when_durable(number, lambda number=number: note(number))  # type: ignore[misc]
            if number % 10 == 0:
                writer.commit()
            if number == 100:
                writer.discard()
        assert done.wait(WAIT_S)
        late = threading.Event()
        writer.when_durable(5, late.set)
        assert late.wait(WAIT_S)
    assert [number for number, _ in called] == list(range(1, 201))
    assert all(durable >= number for number, durable in called)
    assert threading.get_ident() not in threads


def test_syncs_are_shared_by_the_commits_of_an_interval(
    tmp_path: Path, manifest: RunManifest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a long interval nothing but the first and the last sync happens; closing does not wait for it."""
    writer, calls = begun(tmp_path, manifest, JournalSettings(sync_ms=1e7), monkeypatch)
    for number in range(50):
        writer.append(RecordKind.EVENT, "a", number, b"")
        writer.commit()
    before = writer.durable
    called = threading.Event()
    writer.when_durable(50, called.set)
    writer.close()
    assert called.is_set()
    assert (before < 50, writer.durable) == (True, 50)
    assert len(calls) <= 8


def test_a_disk_that_fails_is_told_at_the_next_commit_and_nothing_more_is_called_durable(
    tmp_path: Path, manifest: RunManifest, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer, _ = begun(tmp_path, manifest, JournalSettings(sync_ms=1), monkeypatch)

    def failing(_: int) -> None:
        failed.set()
        raise OSError(5, "Input/output error")

    failed = threading.Event()
    monkeypatch.setattr(os, "fsync", failing)
    writer.append(RecordKind.EVENT, "a", 1, b"")
    writer.commit()
    assert failed.wait(WAIT_S)
    with pytest.raises(JournalError, match="Input/output error"):
        writer.close()
    monkeypatch.undo()
    assert writer.durable == 0
    JournalWriter(tmp_path, manifest, first_number=2).close()


def test_a_callback_that_raises_keeps_nobody_from_their_turn_and_is_told(tmp_path: Path, manifest: RunManifest) -> None:
    after = threading.Event()

    def wrong() -> None:
        raise KeyError("mine")

    with JournalWriter(tmp_path, manifest, JournalSettings(sync_ms=0)) as writer:
        writer.append(RecordKind.EVENT, "a", 1, b"")
        writer.when_durable(1, wrong)
        writer.when_durable(1, after.set)
        writer.commit()
        assert after.wait(WAIT_S)
        with pytest.raises(JournalError, match="a callback of the journal failed \\(KeyError: 'mine'\\)"):
            writer.commit()
        writer.commit()


def test_segments_are_wanted_by_size_and_by_age(tmp_path: Path, manifest: RunManifest) -> None:
    now = [0]
    settings = JournalSettings(segment_mb=0.01, segment_s=60)
    with JournalWriter(tmp_path, manifest, settings, wall_ns=lambda: now[0]) as writer:
        assert not writer.should_roll_segment()
        now[0] = 61_000_000_000
        assert writer.should_roll_segment()
        writer.roll_segment(b"")
        assert not writer.should_roll_segment()
        writer.append(RecordKind.EVENT, "a", 1, bytes(10_000))
        assert writer.should_roll_segment()


def test_a_large_snapshot_is_not_followed_by_another_at_once(tmp_path: Path, manifest: RunManifest) -> None:
    settings = JournalSettings(segment_mb=0.01)
    with JournalWriter(tmp_path, manifest, settings) as writer:
        writer.roll_segment(bytes(100_000))
        for _ in range(4):
            assert not writer.should_roll_segment()
            writer.append(RecordKind.EVENT, "a", 1, bytes(100_000))
            writer.commit()
        writer.append(RecordKind.EVENT, "a", 1, bytes(10_000))
        assert writer.should_roll_segment()


def journal_of(folder: Path, manifest: RunManifest, segments: int, settings: JournalSettings) -> JournalReader:
    with JournalWriter(folder, manifest, settings) as writer:
        for _ in range(segments - 1):
            writer.append(RecordKind.EVENT, "a", 1, bytes(10_000))
            writer.roll_segment(b"state")
        writer.append(RecordKind.EVENT, "a", 2, b"")
    return JournalReader(folder)


def test_old_segments_are_dropped_whole_by_size_and_the_rest_replays(tmp_path: Path, manifest: RunManifest) -> None:
    reader = journal_of(tmp_path, manifest, 12, JournalSettings(sync_ms=0, keep_mb=0.05))
    paths = reader.paths()
    delete_expired_segments(tmp_path, JournalSettings(keep_mb=0.05), 0)
    left = reader.paths()
    assert [path.name for path in left] == [f"{i:06d}.mcap" for i in range(13 - len(left), 13)]
    total = sum(path.stat().st_size for path in left)
    assert total <= 50_000 < total + left[0].stat().st_size
    assert len(paths) < 12, "the writer dropped some itself"
    records = list(reader.records())
    assert records[0].kind is RecordKind.SNAPSHOT
    assert [r.number for r in records] == list(range(records[0].number, 24))


def test_old_segments_are_dropped_by_age(tmp_path: Path, manifest: RunManifest) -> None:
    reader = journal_of(tmp_path, manifest, 4, JournalSettings())
    for age, path in enumerate(reversed(reader.paths())):
        os.utime(path, ns=(0, 10**18 - age * 3600 * 10**9))
    dropped = delete_expired_segments(tmp_path, JournalSettings(keep_s=2.5 * 3600), 10**18)
    assert [path.name for path in dropped] == ["000001.mcap"]
    assert delete_expired_segments(tmp_path, JournalSettings(), 10**18) == ()


def test_the_newest_segment_that_replays_stays_with_all_after_it(tmp_path: Path, manifest: RunManifest) -> None:
    journal_of(tmp_path, manifest, 3, JournalSettings())
    for _ in range(2):
        JournalWriter(tmp_path, manifest, first_number=6).close()
    torn = tmp_path / "000003.mcap"
    torn.write_bytes(torn.read_bytes()[:-400])
    dropped = delete_expired_segments(tmp_path, JournalSettings(keep_mb=1e-6, keep_s=1e-6), 2**62)
    assert [path.name for path in dropped] == ["000001.mcap", "000002.mcap"]
    raw = bytearray(torn.read_bytes())
    raw[raw.index(b"state")] ^= 1
    torn.write_bytes(raw)
    assert delete_expired_segments(tmp_path, JournalSettings(keep_mb=1e-6), 2**62) == ()


def test_two_writers_are_refused_and_a_failed_one_leaves_no_lock(tmp_path: Path, manifest: RunManifest) -> None:
    with JournalWriter(tmp_path, manifest):
        with pytest.raises(JournalLocked, match=f"process {os.getpid()} writes to this journal"):
            JournalWriter(tmp_path, manifest)
        assert len(JournalReader(tmp_path).paths()) == 1
    JournalWriter(tmp_path, manifest).close()
    with pytest.raises(JournalError, match="cannot be a journal's folder"):
        JournalWriter(tmp_path / "000001.mcap", manifest)


def test_settings_that_cannot_be_are_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"journal\.sync_ms: found -1; expected a number ≥ 0"):
        JournalSettings(sync_ms=-1)
    with pytest.raises(ConfigError, match=r"journal\.keep_mb: found 0; expected a number > 0"):
        JournalSettings(keep_mb=0)
    with pytest.raises(ConfigError, match=r"journal\.segment_s: found nan"):
        JournalSettings(segment_s=float("nan"))


def test_nothing_is_durable_before_the_disk_has_confirmed_file_and_folder(
    tmp_path: Path, manifest: RunManifest, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: queue.Queue[str] = queue.Queue()
    answers = threading.Semaphore(0)
    fsync = os.fsync

    def watched(handle: int) -> None:
        asked.put(Path(f"/proc/self/fd/{handle}").readlink().name)
        assert answers.acquire(timeout=WAIT_S)
        fsync(handle)

    writer = JournalWriter(tmp_path / "journal", manifest, JournalSettings(sync_ms=0))
    started = threading.Event()
    writer.when_durable(0, started.set)
    assert started.wait(WAIT_S)
    monkeypatch.setattr(os, "fsync", watched)
    writer.append(RecordKind.EVENT, "a", 1, b"")
    called = threading.Event()
    writer.when_durable(2, called.set)
    writer.roll_segment(b"state")
    seen = []
    while not called.is_set() and len(seen) < 10:
        try:
            seen.append(asked.get(timeout=0.05))
        except queue.Empty:
            continue
        assert (writer.durable < 2, called.is_set()) == (True, False)
        answers.release()
    assert called.wait(WAIT_S)
    assert seen[-3:] == ["000001.mcap", "000002.mcap", "journal"]
    assert writer.durable == 2
    for _ in range(10):
        answers.release()
    writer.close()
