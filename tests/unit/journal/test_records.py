"""Bytes whose checksum is right and that no journal writes are refused all the same."""

from __future__ import annotations

import pytest

from tickfix.journal import RecordKind
from tickfix.journal.segment_layout import RecordBatch, RecordFormatError, parse_batch


def messages(first: int, count: int) -> bytes:
    batch = RecordBatch(first)
    for _ in range(count):
        batch.add(RecordKind.EVENT, "a", 1, 2, b"payload")
    return batch.data()


def test_records_are_parsed_into_the_group_they_were() -> None:
    batch, records = parse_batch(messages(7, 3))
    assert [record.number for record in records] == [7, 8, 9]
    assert (batch.first, batch.next, len(batch)) == (7, 10, 3)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "no messages"),
        (messages(7, 2) + messages(8, 1), "record 8 with sequence 8; expected record 9"),
        (messages(7, 2) + messages(10, 1), "record 10 with sequence 10; expected record 9"),
        (messages(7, 1)[:11] + b"\x09" + messages(7, 1)[12:], "record 7 with sequence 9; expected record 7"),
        (b"\x04" + messages(7, 1)[1:], "opcode 4, channel 1"),
        (messages(7, 1)[:9] + b"\x09" + messages(7, 1)[10:], "channel 9"),
        (messages(7, 1)[:-1], "expected a message"),
        (messages(7, 1) + b"\x05", "requires a buffer"),
        (messages(7, 1)[:31] + b"\xc1" + messages(7, 1)[32:], "malformed"),
    ],
)
def test_what_no_journal_writes_is_refused(data: bytes, words: str) -> None:
    with pytest.raises(RecordFormatError, match=words):
        parse_batch(data)
