"""Flipped, cut, zeroed, doubled and strange bytes: reading never fails, and never believes what is not intact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
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
from tickfix.journal.segment_reader import SegmentReader

SEVERAL = 4


@dataclass(frozen=True)
class Sample:
    """A journal of a closed and an unclosed segment, in memory."""

    files: dict[str, bytes]
    records: dict[int, JournalRecord]
    last_of: dict[str, int]


@pytest.fixture(scope="module")
def sample(manifest: RunManifest, tmp_path_factory: pytest.TempPathFactory) -> Sample:
    folder = tmp_path_factory.mktemp("sample")
    kinds, rng = (RecordKind.EVENT, RecordKind.DECISION, RecordKind.ESTIMATE), np.random.default_rng(4)
    with JournalWriter(folder, manifest, wall_ns=lambda: 10**18) as writer:  # the same bytes every time
        for commit in range(2 * SEVERAL):
            if commit == SEVERAL:
                writer.roll_segment(b"state" * 9)
            for i in range(1 + commit % 3):
                writer.append(kinds[i], f"phone-{i}", 1000 * commit + i, rng.bytes(7 * i))
            writer.commit()
        files = {path.name: path.read_bytes() for path in JournalReader(folder).paths()}
        segments = JournalReader(folder).segments()
    records = {record.number: record for record in JournalReader(folder).records()}
    return Sample(files, records, {s.path.name: s.last_number for s in segments})


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damaged")


Change = Callable[[bytes], bytes]
PLACE = st.floats(0, 1, exclude_max=True)


def flipped(places: Sequence[tuple[float, int]]) -> Change:
    def change(raw: bytes) -> bytes:
        new = bytearray(raw)
        for where, mask in places:
            new[int(where * len(new))] ^= mask
        return bytes(new)

    return change


def replaced(where: float, width: int, by: bytes) -> Change:
    def change(raw: bytes) -> bytes:
        at = int(where * len(raw))
        return raw[:at] + by + raw[at + width :]

    return change


FLIPS = st.lists(st.tuples(PLACE, st.integers(1, 255)), min_size=1, max_size=3).map(flipped)
CUTS = PLACE.map(lambda where: lambda raw: raw[: int(where * len(raw))])
ZEROS = st.builds(lambda at, n: replaced(at, n, bytes(n)), PLACE, st.integers(1, 600))
DOUBLES = PLACE.map(lambda where: lambda raw: raw[: int(where * len(raw))] + raw)
STRANGERS = st.builds(replaced, PLACE, st.integers(0, 40), st.binary(max_size=40))
CHANGES = st.one_of(FLIPS, CUTS, ZEROS, DOUBLES, STRANGERS)


def stored(sample: Sample, place: Path, name: str, changed: bytes) -> JournalReader:
    for other, raw in sample.files.items():
        (place / other).write_bytes(changed if other == name else raw)
    return JournalReader(place)


def check(sample: Sample, place: Path, name: str, change: Change) -> None:
    raw = sample.files[name]
    changed = change(raw)
    reader = stored(sample, place, name, changed)
    damage: list[SegmentDamage] = []
    seen = list(reader.records(on_damage=damage.append))
    assert seen == [sample.records[record.number] for record in seen]
    assert [r.number for r in seen] == sorted({r.number for r in seen})
    for found in damage:
        assert found.path == place / name or "missing" in found.what
        assert 0 <= found.offset <= found.path.stat().st_size
        assert f"{found.path}: at byte {found.offset}: " in str(found)
    (segment,) = (s for s in reader.segments(thorough=True) if s.path.name == name)
    if changed != raw and not (raw.startswith(changed) and not segment.complete):
        assert segment.damage, "what is changed is named"
    if not segment.damage:
        missing = [n for n in sample.records if n <= segment.last_number and n not in {r.number for r in seen}]
        assert not missing
    assert (place / name).read_bytes() == changed
    for since in (ReadStart.FIRST, ReadStart.REPLAYABLE):
        strict: list[JournalRecord] = []
        try:
            strict.extend(reader.records(since))
        except JournalError:
            continue
        assert [r.number for r in strict] == list(range(strict[0].number, strict[-1].number + 1)) if strict else True


@given(change=CHANGES, name=st.sampled_from(["000001.mcap", "000002.mcap"]))
@settings(max_examples=150)
def test_nothing_damaged_is_believed(sample: Sample, place: Path, change: Change, name: str) -> None:
    check(sample, place, name, change)


@pytest.mark.parametrize("name", ["000001.mcap", "000002.mcap"])
def test_one_flipped_byte_is_found_wherever_it_is_and_costs_one_commit_at_most(
    sample: Sample, place: Path, name: str
) -> None:
    raw = sample.files[name]
    for at in range(0, len(raw), 7):
        changed = bytearray(raw)
        changed[at] ^= 1 << at % 8
        reader = stored(sample, place, name, bytes(changed))
        damage: list[SegmentDamage] = []
        seen = {r.number: r for r in reader.records(on_damage=damage.append)}
        assert damage, f"byte {at}"
        assert all(found.offset <= at for found in damage if "missing" not in found.what)
        assert seen.items() <= sample.records.items()
        assert len(seen) >= len(sample.records) - 3, f"byte {at}"


@pytest.mark.parametrize("name", ["000001.mcap", "000002.mcap"])
def test_a_file_cut_anywhere_is_read_up_to_there(sample: Sample, place: Path, name: str) -> None:
    raw = sample.files[name]
    counts = []
    for at in range(0, len(raw), 5):
        reader = stored(sample, place, name, raw[:at])
        (segment,) = (s for s in reader.segments() if s.path.name == name)
        assert not segment.complete
        assert all(found.offset <= at for found in segment.damage)
        counts.append(segment.last_number - segment.first_number + 1)
    assert counts == sorted(counts)
    assert counts[-1] == len([n for n in sample.records if n <= sample.last_of[name]]) - (
        0 if name == "000001.mcap" else sample.last_of["000001.mcap"]
    )


def test_records_missing_in_the_middle_end_a_replay_with_file_and_offset(sample: Sample, place: Path) -> None:
    raw = bytearray(sample.files["000001.mcap"])
    raw[raw.index(b"phone-1")] ^= 4
    reader = stored(sample, place, "000001.mcap", bytes(raw))
    seen = []
    with pytest.raises(JournalDamaged, match=r"checksum .*are missing") as caught:
        seen.extend(record.number for record in reader.records())
    assert caught.value.path == place / "000001.mcap"
    assert 0 < caught.value.offset < raw.index(b"phone-0", caught.value.offset) < caught.value.offset + 200


def test_a_commit_that_stands_there_twice_is_read_once(sample: Sample, place: Path) -> None:
    raw = sample.files["000002.mcap"]
    (*_, (at, _)) = SegmentReader(stored(sample, place, "000002.mcap", raw).paths()[1]).batches()
    reader = stored(sample, place, "000002.mcap", raw + raw[at:])
    assert [record.number for record in reader.records()] == list(sample.records)
    (found,) = reader.segments()[1].damage
    assert (found.offset, "record" in found.what) == (len(raw), True)


def test_a_closed_segment_is_read_on_behind_a_chunk_whose_head_is_gone(sample: Sample, place: Path) -> None:
    raw = bytearray(sample.files["000001.mcap"])
    batches = list(SegmentReader(stored(sample, place, "000001.mcap", bytes(raw)).paths()[0]).batches())
    at, lost = batches[1]
    raw[at : at + 49] = bytes(49)
    reader = stored(sample, place, "000001.mcap", bytes(raw))
    damage: list[SegmentDamage] = []
    seen = [record.number for record in reader.records(on_damage=damage.append)]
    assert seen == [number for number in sample.records if number not in {record.number for record in lost}]
    assert damage[0].offset == at
    unclosed = bytes(raw[: batches[-1][0]])
    cut = [record.number for record in stored(sample, place, "000001.mcap", unclosed).records(on_damage=print)]
    assert cut[: len(batches[0][1]) + 1] == [*(r.number for r in batches[0][1]), sample.last_of["000001.mcap"] + 1]


def test_lengths_that_no_file_can_have_are_damage_like_any_other(sample: Sample, place: Path) -> None:
    raw = bytearray(sample.files["000002.mcap"])
    batches = list(SegmentReader(stored(sample, place, "000002.mcap", bytes(raw)).paths()[1]).batches())
    at = batches[2][0]
    for length in (2**64 - 1, 2**63, 2**40):
        raw[at + 1 : at + 9] = raw[at + 25 : at + 33] = raw[at + 41 : at + 49] = length.to_bytes(8, "little")
        (_, segment) = stored(sample, place, "000002.mcap", bytes(raw)).segments()
        assert [damage.offset for damage in segment.damage] == [at]
        assert segment.last_number == batches[1][1][-1].number
