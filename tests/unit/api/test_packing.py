"""States become bytes and come back, bit for bit; nothing else is built from bytes."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tickfix.api import Floats, Ints, pack, unpack
from tickfix.api.packing import PrepackedValue, nbytes


@dataclass(frozen=True)
class Inner:
    """What a state may hold."""

    numbers: Floats
    counts: Ints
    name: str = ""


@dataclass(frozen=True)
class State:
    """A state of everything that is allowed."""

    inner: Inner
    several: tuple[Inner, ...] = ()
    ratio: float = 0.0
    n: int = 0
    known: bool = False
    maybe: float | None = None
    raw: bytes = b""
    pairs: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Stranger:
    """A class that no state names."""

    x: int = 0


arrays = st.lists(st.floats(width=64), max_size=6).map(np.array)
inners = st.builds(
    Inner,
    arrays,
    st.lists(st.integers(-(2**63), 2**63 - 1), max_size=4).map(lambda x: np.array(x, np.int64)),
    st.text(),
)
states = st.builds(
    State,
    inner=inners,
    several=st.lists(inners, max_size=3).map(tuple),
    ratio=st.floats(),
    n=st.integers(-(2**63), 2**64 - 1),
    known=st.booleans(),
    maybe=st.none() | st.floats(),
    raw=st.binary(),
    pairs=st.lists(st.tuples(st.text(), st.floats()), max_size=3).map(tuple),
)


@settings(max_examples=100)
@given(states)
def test_a_state_comes_back_bit_for_bit(state: State) -> None:
    again = unpack(pack(state), State)
    assert pack(again) == pack(state)
    assert again.inner.numbers.tobytes() == state.inner.numbers.tobytes()
    assert struct.pack("<d", again.ratio) == struct.pack("<d", state.ratio)
    assert (again.n, again.known, again.raw) == (state.n, state.known, state.raw)
    assert type(again.several) is tuple
    assert not again.inner.numbers.flags.writeable


@settings(max_examples=30)
@given(states)
def test_what_was_packed_before_stands_for_what_it_was_packed_from(state: State) -> None:
    for value in (state, state.inner, state.inner.numbers):
        assert pack((1, PrepackedValue(pack(value)), "a")) == pack((1, value, "a"))


@settings(max_examples=300)
@given(st.binary(max_size=60) | st.tuples(states.map(pack), st.integers(0, 200), st.integers(0, 255)))
def test_broken_bytes_are_refused_or_make_some_other_state(data: Any) -> None:
    if isinstance(data, tuple):
        good, at, byte = data
        data = good[: at % len(good)] + bytes([byte]) + good[at % len(good) + 1 :]
    try:
        found = unpack(data, State)
    except ValueError:
        return
    assert isinstance(found, State)


def test_layout_byte_order_and_writability_of_an_array_leave_no_trace() -> None:
    table = np.arange(6.0).reshape(2, 3)
    same = [table, np.asfortranarray(table), table.astype(">f8"), np.arange(12.0).reshape(2, 6)[:, ::2] * 0 + table]
    assert len({pack(array) for array in same}) == 1


def test_numpy_scalars_are_packed_as_numbers() -> None:
    assert pack((np.float64(0.1), np.int64(3), np.bool_(True))) == pack((0.1, 3, True))


@pytest.mark.parametrize("value", [[1], {"a": 1}, {1}, object(), np.array(["text"]), np.array([None]), 1j, State])
def test_what_states_may_not_hold_is_named(value: Any) -> None:
    with pytest.raises(TypeError, match="states hold"):
        pack((value,))


def test_a_class_that_the_state_does_not_name_is_not_built() -> None:
    with pytest.raises(ValueError, match="found a packed Stranger, expected one of Inner, State"):
        unpack(pack(Stranger()), State)


def test_a_value_of_another_type_is_refused() -> None:
    with pytest.raises(ValueError, match="found a packed Inner, expected State"):
        unpack(pack(Inner(np.zeros(1), np.zeros(1, np.int64))), State)
    with pytest.raises(ValueError, match="packed int"):
        unpack(msgpack.packb(3), State)


def test_memory_is_that_of_the_arrays_and_a_little_more() -> None:
    state = State(Inner(np.zeros(1000), np.zeros(10, np.int64)))
    assert 8080 < nbytes(state) < 9500
