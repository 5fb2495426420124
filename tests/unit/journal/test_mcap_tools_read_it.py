"""A segment is plain MCAP: the readers of the ``mcap`` package open it, checksums and all."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.data_stream import RecordBuilder
from mcap.exceptions import EndOfFile
from mcap.reader import McapReader, NonSeekingReader, SeekingReader
from mcap.records import Chunk, Message, MessageIndex
from mcap.records import Metadata as McapMetadata
from mcap.stream_reader import StreamReader
from msgspec import msgpack

from tickfix.journal import JournalReader, JournalRecord, JournalWriter, RecordKind, RunManifest
from tickfix.journal.segment_layout import CHANNEL_IDS, RecordBatch, frame_batch


@pytest.fixture(scope="module")
def folder(manifest: RunManifest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A closed segment and one that is not."""
    folder = tmp_path_factory.mktemp("journal")
    writer = JournalWriter(folder, manifest)
    for number in range(1, 30):
        writer.append(list(RecordKind)[number % 4], f"phone-{number % 3}", number - 5, bytes(number))
        if number % 4 == 0:
            writer.commit()
        if number == 20:
            writer.roll_segment(b"state")
    writer.commit()
    yield folder
    writer.close()


def same(record: JournalRecord, topic: str, message: Message) -> bool:
    assert msgpack.decode(message.data) == [record.number, record.device, record.payload]
    return (topic, message.log_time, message.publish_time, message.sequence) == (
        record.kind.value,
        record.wall_ns,
        record.t_ns % 2**64,
        record.number,
    )


@pytest.mark.parametrize("kind", [SeekingReader, NonSeekingReader])
def test_a_closed_segment_opens_in_both_readers(folder: Path, kind: type[McapReader]) -> None:
    path = folder / "000001.mcap"
    with path.open("rb") as file:
        messages = list(kind(file, validate_crcs=True).iter_messages(log_time_order=False))  # type: ignore[call-arg]
    records = list(JournalReader(path).records())
    assert len(messages) == len(records) == 20
    assert all(same(r, channel.topic, message) for r, (_, channel, message) in zip(records, messages, strict=True))


def test_the_index_of_a_closed_segment_finds_one_kind_and_a_span_of_time(folder: Path) -> None:
    path = folder / "000001.mcap"
    records = [record for record in JournalReader(path).records() if record.kind is RecordKind.DECISION]
    with path.open("rb") as file:
        reader = SeekingReader(file, validate_crcs=True)
        found = [m.sequence for _, _, m in reader.iter_messages(topics=["decision"], starting_at=records[2].wall_ns)]
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 20
        assert summary.statistics.chunk_count == len(summary.chunk_indexes) == 5
        assert [channel.topic for channel in summary.channels.values()] == [kind.value for kind in RecordKind]
        (metadata,) = reader.iter_metadata()
    assert found == [record.number for record in records[2:]]
    assert metadata.metadata["run"] == "r-1"


def test_an_unclosed_segment_opens_in_the_stream_reader_up_to_its_end(folder: Path) -> None:
    path = folder / "000002.mcap"
    seen: list[Any] = []
    with path.open("rb") as file, pytest.raises(EndOfFile):
        seen.extend(StreamReader(file, validate_crcs=True).records)
    messages = [record for record in seen if isinstance(record, Message)]
    assert [m.sequence for m in messages] == [r.number for r in JournalReader(path).records()] == list(range(21, 31))
    assert [record.name for record in seen if isinstance(record, McapMetadata)] == ["tickfix.manifest"]


def test_message_indexes_point_at_their_messages(folder: Path) -> None:
    with (folder / "000001.mcap").open("rb") as file:
        chunk: Chunk | None = None
        seen = 0
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                chunk = record
            elif isinstance(record, MessageIndex):
                assert chunk is not None
                for wall_ns, at in record.records:
                    assert chunk.data[at] == 5
                    assert int.from_bytes(chunk.data[at + 9 : at + 11], "little") == record.channel_id
                    assert int.from_bytes(chunk.data[at + 15 : at + 23], "little") == wall_ns
                    seen += 1
    assert seen == 20


def test_what_is_packed_by_hand_is_what_the_package_packs() -> None:
    batch = RecordBatch(2**32 + 7)
    for i in range(5):
        batch.add(list(RecordKind)[i % 2], "phone", 10 * i, 1000 - i, bytes(i))
    data = batch.data()
    builder: Any = RecordBuilder()
    indexes: dict[int, list[tuple[int, int]]] = {}
    for i in range(5):
        channel = CHANNEL_IDS[list(RecordKind)[i % 2]]
        indexes.setdefault(channel, []).append((1000 - i, builder.count))
        body = msgpack.encode((2**32 + 7 + i, "phone", bytes(i)))
        Message(channel_id=channel, log_time=1000 - i, data=body, publish_time=10 * i, sequence=7 + i).write(builder)
    assert data == builder.end()
    Chunk("", data, 1000, 996, zlib.crc32(data), len(data)).write(builder)
    for channel, entries in indexes.items():
        MessageIndex(channel, entries).write(builder)
    assert frame_batch(123, batch, data).data == builder.end()
