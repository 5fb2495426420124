"""What waits to be published."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pytest

from tickfix.ports import backlog
from tickfix.ports.backlog import Backlog
from tickfix.ports.waking import Errands


@pytest.fixture
def errands() -> Iterator[Errands]:
    made = Errands()
    yield made
    made.close()


def test_publications_go_out_in_order_and_others_get_their_turns(errands: Errands) -> None:
    out: list[int] = []
    waiting, turns = Backlog(errands), []

    def publish(chunk: Sequence[int]) -> None:
        out.extend(chunk)
        turns.append(len(chunk))

    waiting.add(range(150), publish)
    waiting.add([150], publish)
    while errands:
        errands.run(1)
    assert out == list(range(151))
    assert max(turns) <= 64


def test_too_many_are_given_up_and_counted_and_room_comes_back(
    errands: Errands, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(backlog, "_WAITING", 100)
    out: list[int] = []
    waiting = Backlog(errands)
    waiting.add(range(90), out.extend)
    waiting.add(range(90, 120), out.extend)
    waiting.add([120], out.extend)
    assert waiting.discarded == 21
    errands.run(10)
    waiting.add([121], out.extend)
    errands.run(10)
    assert out == [*range(100), 121]


def test_the_bell_rings_once_however_many_errands_and_again_for_the_next(errands: Errands) -> None:
    done: list[int] = []
    for i in range(1_000):
        errands.add(lambda i=i: done.append(i))
    assert len(errands.wake.recv(4_096)) == 1
    errands.run(400)
    assert done == list(range(400))
    errands.run(600)
    errands.add(lambda: done.append(-1))
    assert len(errands.wake.recv(4_096)) == 1
    errands.run(1)
    assert done[-1] == -1
