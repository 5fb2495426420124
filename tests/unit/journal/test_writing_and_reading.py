"""What is committed is read back: the bytes, the numbers, in their order, across segments and runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tickfix.journal import (
    JournalDamaged,
    JournalError,
    JournalReader,
    JournalRecord,
    JournalWriter,
    ReadStart,
    RecordKind,
    RunManifest,
    SegmentDamage,
)

RECORDS = st.lists(
    st.lists(
        st.tuples(
            st.sampled_from(RecordKind), st.text(max_size=8), st.integers(-(2**63), 2**63 - 1), st.binary(max_size=40)
        ),
        max_size=5,
    ),
    max_size=6,
)


@given(commits=RECORDS)
@settings(max_examples=60)
def test_every_record_comes_back_as_it_was_appended(
    commits: Sequence[Sequence[tuple[RecordKind, str, int, bytes]]],
    manifest: RunManifest,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    folder = tmp_path_factory.mktemp("journal")
    clock = count(100)
    expected = []
    with JournalWriter(folder, manifest, wall_ns=lambda: next(clock)) as writer:
        for commit in commits:
            for kind, device, t_ns, payload in commit:
                number = writer.append(kind, device, t_ns, payload)
                expected.append((kind, number, device, t_ns, payload))
            writer.commit()
    found = list(JournalReader(folder).records())
    assert [(r.kind, r.number, r.device, r.t_ns, r.payload) for r in found] == expected
    assert [r.number for r in found] == list(range(1, len(expected) + 1))
    assert [r.wall_ns for r in found] == sorted({r.wall_ns for r in found})
    (segment,) = JournalReader(folder).segments(thorough=True)
    assert (segment.complete, segment.damage, segment.manifest) == (True, (), manifest)
    assert (segment.first_number, segment.last_number) == (1, len(expected))


def test_what_is_not_committed_is_not_there_and_what_is_needs_no_closing(tmp_path: Path, manifest: RunManifest) -> None:
    with JournalWriter(tmp_path, manifest) as writer:
        writer.append(RecordKind.EVENT, "a", 1, b"one")
        assert list(JournalReader(tmp_path).records()) == []
        writer.commit()
        writer.append(RecordKind.EVENT, "a", 2, b"two")
        assert [r.payload for r in JournalReader(tmp_path).records()] == [b"one"]
        (segment,) = JournalReader(tmp_path).segments()
        assert (segment.complete, segment.damage, segment.last_number) == (False, (), 1)


def test_numbers_of_what_is_discarded_are_given_again(tmp_path: Path, manifest: RunManifest) -> None:
    with JournalWriter(tmp_path, manifest) as writer:
        writer.append(RecordKind.EVENT, "a", 1, b"one")
        writer.commit()
        assert writer.append(RecordKind.EVENT, "a", 2, b"two") == 2
        assert (writer.pending, writer.discard(), writer.pending) == (1, 1, 0)
        assert writer.append(RecordKind.DECISION, "a", 3, b"three") == 2
    assert [(r.number, r.payload) for r in JournalReader(tmp_path).records()] == [(1, b"one"), (2, b"three")]


def test_numbers_run_beyond_32_bits(tmp_path: Path, manifest: RunManifest) -> None:
    first = 2**32 - 1
    with JournalWriter(tmp_path, manifest, first_number=first) as writer:
        for _ in range(3):
            writer.append(RecordKind.EVENT, "a", 1, b"")
    assert [r.number for r in JournalReader(tmp_path).records()] == [first, first + 1, first + 2]


def test_a_new_segment_begins_with_its_snapshot_and_the_old_one_is_closed(
    tmp_path: Path, manifest: RunManifest
) -> None:
    with JournalWriter(tmp_path, manifest) as writer:
        writer.append(RecordKind.EVENT, "a", 1, b"one")
        writer.roll_segment(b"state")
        first, second = JournalReader(tmp_path).segments(thorough=True)
        assert (first.complete, first.first_number, first.last_number) == (True, 1, 1)
        assert (second.complete, second.first_number, second.last_number) == (False, 2, 2)
        writer.append(RecordKind.EVENT, "a", 2, b"two")
    reader = JournalReader(tmp_path)
    assert [(r.kind, r.number) for r in reader.records(ReadStart.REPLAYABLE)] == [
        (RecordKind.SNAPSHOT, 2),
        (RecordKind.EVENT, 3),
    ]
    assert [r.number for r in reader.records()] == [1, 2, 3]
    assert [[r.number for r in reader.records(n)] for n in (1, 2, 3, 4)] == [[1, 2, 3], [2, 3], [3], []]
    assert [s.replayable for s in reader.segments()] == [True, True]


def test_a_run_goes_on_in_a_new_segment_and_the_old_one_is_untouched(tmp_path: Path, manifest: RunManifest) -> None:
    with JournalWriter(tmp_path, manifest) as writer:
        writer.append(RecordKind.EVENT, "a", 1, b"one")
    before = (tmp_path / "000001.mcap").read_bytes()
    with JournalWriter(tmp_path, manifest, first_number=2) as writer:
        writer.append(RecordKind.EVENT, "a", 2, b"two")
    assert (tmp_path / "000001.mcap").read_bytes() == before
    assert [r.number for r in JournalReader(tmp_path).records()] == [1, 2]
    assert [s.replayable for s in JournalReader(tmp_path).segments()] == [True, False]
    assert next(JournalReader(tmp_path).records(ReadStart.REPLAYABLE)).number == 1


def test_the_newest_run_is_read_where_a_folder_holds_several(tmp_path: Path, manifest: RunManifest) -> None:
    for run in ("x", "y"):
        with JournalWriter(tmp_path, replace(manifest, run=run)) as writer:
            writer.append(RecordKind.EVENT, "a", 1, run.encode())
    assert [r.payload for r in JournalReader(tmp_path).records()] == [b"y"]
    assert [r.payload for r in JournalReader(tmp_path / "000001.mcap").records()] == [b"x"]


def test_numbers_that_are_missing_or_come_again_are_refused(tmp_path: Path, manifest: RunManifest) -> None:
    for first in (1, 4):
        with JournalWriter(tmp_path, manifest, first_number=first) as writer:
            writer.append(RecordKind.EVENT, "a", 1, b"")
    read: list[JournalRecord] = []
    with pytest.raises(JournalDamaged, match=r"000002\.mcap: at byte \d+: .*; records 2–3 are missing"):
        read.extend(JournalReader(tmp_path).records())
    told: list[SegmentDamage] = []
    assert [r.number for r in JournalReader(tmp_path).records(on_damage=told.append)] == [1, 4]
    assert [damage.what for damage in told] == ["records 2–3 are missing"]
    with JournalWriter(tmp_path, manifest, first_number=3) as writer:
        writer.append(RecordKind.EVENT, "a", 1, b"")
    with pytest.raises(JournalDamaged, match=r"000003\.mcap: at byte \d+: record 3 again; expected record 5"):
        read.extend(JournalReader(tmp_path).records(on_damage=print))


def test_a_place_without_a_journal_is_named(tmp_path: Path) -> None:
    with pytest.raises(JournalError, match="nowhere: no readable folder"):
        JournalReader(tmp_path / "nowhere").segments()
    with pytest.raises(JournalError, match="no segment in it"):
        JournalReader(tmp_path).segments()


def test_what_64_bits_or_utf8_cannot_hold_is_refused_and_nothing_is_appended(
    tmp_path: Path, manifest: RunManifest
) -> None:
    with JournalWriter(tmp_path, manifest) as writer:
        with pytest.raises(ValueError, match=f"found t_ns = {2**63}"):
            writer.append(RecordKind.EVENT, "a", 2**63, b"")
        with pytest.raises(ValueError, match="surrogates"):
            writer.append(RecordKind.EVENT, "\ud800", 1, b"")
        assert writer.append(RecordKind.EVENT, "a", 1, b"") == 1
    assert len(list(JournalReader(tmp_path).records())) == 1


def test_a_closed_writer_says_so(tmp_path: Path, manifest: RunManifest) -> None:
    writer = JournalWriter(tmp_path, manifest)
    writer.close()
    writer.close()
    with pytest.raises(JournalError, match="this journal is closed"):
        writer.commit()
