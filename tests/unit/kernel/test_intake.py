"""Recognising duplicates by their number."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from tickfix.kernel.deduplication import SequenceWindow


@settings(max_examples=200)
@given(st.lists(st.integers(1, 300), max_size=200))
def test_each_number_is_new_once_in_whatever_order_they_come(numbers: list[int]) -> None:
    sequence, seen = SequenceWindow(), set[int]()
    for seq in numbers:
        assert sequence.is_new(seq) == (seq not in seen)
        seen.add(seq)
    assert len(sequence.missing) == max(seen, default=0) - len(seen)


def test_what_is_remembered_is_bounded_and_older_numbers_count_as_seen() -> None:
    sequence = SequenceWindow()
    assert sequence.is_new(10**15)
    assert len(sequence.missing) == 4096
    assert sequence.is_new(10**15 - 4096)
    assert not sequence.is_new(10**15 - 4097)


@settings(max_examples=200)
@given(st.lists(st.integers(1, 9_000), max_size=50), st.integers(1, 9_000))
def test_what_was_seen_survives_as_bits(numbers: list[int], asked: int) -> None:
    sequence = SequenceWindow()
    for seq in numbers:
        sequence.is_new(seq)
    again = SequenceWindow(sequence.highest, sequence.gaps)
    assert again.missing == sequence.missing
    assert again.has_seen(asked) == sequence.has_seen(asked)
    assert sequence.has_seen(asked) is not again.is_new(asked)
    assert again.has_seen(asked)
    assert len(again.gaps) <= 512


def test_a_number_that_leaps_absurdly_makes_nothing_that_follows_a_duplicate() -> None:
    sequence = SequenceWindow()
    assert sequence.is_new(1)
    assert sequence.is_new(2**60)
    assert sequence.is_new(2)
    assert not sequence.is_new(2)
