"""What waits to be published."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pytest

from tickfix.ports import io_thread
from tickfix.ports.io_thread import CallQueue, PublicationBacklog


@pytest.fixture
def call_queue() -> Iterator[CallQueue]:
    made = CallQueue()
    yield made
    made.close()


def test_publications_go_out_in_order_and_others_get_their_turns(call_queue: CallQueue) -> None:
    out: list[int] = []
    waiting, turns = PublicationBacklog(call_queue), []

    def publish(chunk: Sequence[int]) -> None:
        out.extend(chunk)
        turns.append(len(chunk))

    waiting.add(range(150), publish)
    waiting.add([150], publish)
    while call_queue:
        call_queue.run(1)
    assert out == list(range(151))
    assert max(turns) <= 64


def test_too_many_are_given_up_and_counted_and_room_comes_back(
    call_queue: CallQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(io_thread, "_MAX_WAITING", 100)
    out: list[int] = []
    waiting = PublicationBacklog(call_queue)
    waiting.add(range(90), out.extend)
    waiting.add(range(90, 120), out.extend)
    waiting.add([120], out.extend)
    assert waiting.discarded == 21
    call_queue.run(10)
    waiting.add([121], out.extend)
    call_queue.run(10)
    assert out == [*range(100), 121]


def test_the_bell_rings_once_however_many_errands_and_again_for_the_next(call_queue: CallQueue) -> None:
    done: list[int] = []
    for i in range(1_000):
        call_queue.add(lambda i=i: done.append(i))
    assert len(call_queue.wake.recv(4_096)) == 1
    call_queue.run(400)
    assert done == list(range(400))
    call_queue.run(600)
    call_queue.add(lambda: done.append(-1))
    assert len(call_queue.wake.recv(4_096)) == 1
    call_queue.run(1)
    assert done[-1] == -1
