"""The queue to the loop, and the books of the intake."""

from __future__ import annotations

import threading

from hypothesis import given
from hypothesis import strategies as st

from tickfix.api import Pressure
from tickfix.ports.inbound_queue import ControlCommand, InboundMessage, InboundQueue, IntakeCounters
from tickfix.ports.peers import Peer, PeerState
from tickfix.ports.port_settings import PeerLimits
from tickfix.wire import ReplyOutcome

EVENT = Pressure(t_ns=0, pressure_hpa=1000.0, device="p")


def state(name: str) -> PeerState:
    return PeerState(name, None, PeerLimits(), 0)


def incoming(owner: PeerState, n_bytes: int = 1) -> InboundMessage:
    return InboundMessage(EVENT, Peer(owner, b"id", delimited=False), wants_ack=False, received_ns=0, n_bytes=n_bytes)


def test_what_comes_first_is_taken_first_and_no_more_than_asked() -> None:
    inbox, one = InboundQueue(10, 1_000), state("one")
    items = [incoming(one) for _ in range(5)]
    assert all(inbox.try_put(item) for item in items)
    assert inbox.take(0.0, 3) == items[:3]
    assert inbox.take(0.0, 3) == items[3:]
    assert inbox.take(0.0, 3) == []


def test_the_queue_is_bounded_in_messages_and_in_bytes() -> None:
    few = InboundQueue(4, 1_000)
    assert [few.try_put(incoming(state(name))) for name in "abcde"] == [True] * 4 + [False]
    assert few.waiting == (4, 4)
    small = InboundQueue(100, 1_000)
    big = state("big")
    assert small.try_put(incoming(big, 400))
    assert not small.try_put(incoming(big, 601))
    assert small.waiting == (1, 400)


def test_once_half_full_nobody_may_hold_more_than_a_part() -> None:
    inbox, greedy, modest = InboundQueue(100, 10**9), state("greedy"), state("modest")
    assert sum(inbox.try_put(incoming(greedy)) for _ in range(1_000)) == 50
    assert sum(inbox.try_put(incoming(modest)) for _ in range(20)) == 20
    assert not inbox.try_put(incoming(greedy))


def test_bytes_are_shared_too() -> None:
    inbox, greedy, modest = InboundQueue(10**6, 1_000), state("greedy"), state("modest")
    assert sum(inbox.try_put(incoming(greedy, 100)) for _ in range(100)) == 5
    assert inbox.try_put(incoming(modest, 100))


def test_room_comes_back_when_the_loop_takes() -> None:
    inbox, one = InboundQueue(4, 1_000), state("one")
    while inbox.try_put(incoming(one)):
        pass
    held = one.waiting
    assert len(inbox.take(0.0, 100)) == held
    assert (one.waiting, one.waiting_bytes, inbox.waiting) == (0, 0, (0, 0))
    assert inbox.try_put(incoming(one))


def test_orders_come_through_a_queue_full_of_messages() -> None:
    inbox, one = InboundQueue(2, 1_000), state("one")
    while inbox.try_put(incoming(one)):
        pass
    order = ControlCommand("stop", {}, lambda ok, data: None)
    assert inbox.command(order)
    assert order in inbox.take(0.0, 100)


def test_whoever_waits_is_woken_by_a_message_and_by_the_end() -> None:
    inbox, taken = InboundQueue(10, 1_000), []
    waiter = threading.Thread(target=lambda: taken.extend(inbox.take(60.0, 10)))
    waiter.start()
    item = incoming(state("one"))
    inbox.try_put(item)
    waiter.join(10.0)
    assert taken == [item]
    waiter = threading.Thread(target=inbox.take, args=(60.0, 10))
    waiter.start()
    inbox.close()
    waiter.join(10.0)
    assert not waiter.is_alive()


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 300), st.booleans()), max_size=100))
def test_bounds_and_shares_hold_whatever_comes(steps: list[tuple[int, int, bool]]) -> None:
    accounts = [state(str(i)) for i in range(3)]
    inbox = InboundQueue(12, 1_000)
    inside: list[InboundMessage] = []
    for who, size, takes in steps:
        item = incoming(accounts[who], size)
        if inbox.try_put(item):
            inside.append(item)
        if takes:
            taken = [i for i in inbox.take(0.0, 2) if isinstance(i, InboundMessage)]
            assert taken == inside[: len(taken)]
            inside = inside[len(taken) :]
        assert inbox.waiting == (len(inside), sum(i.n_bytes for i in inside))
        assert len(inside) <= 12
        assert inbox.waiting[1] <= 1_000
        assert [a.waiting for a in accounts] == [sum(i.peer.state is a for i in inside) for a in accounts]


def test_a_message_is_settled_once() -> None:
    intake, one = IntakeCounters(), state("one")
    item = incoming(one)
    intake.receive(one, 10)
    assert intake.snapshot([one])["pending"] == 1
    assert intake.count_outcome_once(item, ReplyOutcome.LATE)
    assert not intake.count_outcome_once(item, ReplyOutcome.ACCEPTED)
    seen = intake.snapshot([one])
    assert (seen["received"], seen["pending"], seen["outcomes"]["late"], seen["outcomes"]["accepted"]) == (1, 0, 1, 0)
    assert seen["peers"]["one"] == {"received": 1, "received_bytes": 10, "outcomes": {"late": 1}}
