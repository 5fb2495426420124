"""Whatever is sent to the ports: the process lives, others are served, and the books balance."""

from __future__ import annotations

import json
import random
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zmq
from hypothesis import given, settings
from hypothesis import strategies as st
from ports_lab import PATIENCE_MS, Client, free_ports, message, pressure

from tickfix.ports import Hub, PeerLimits
from tickfix.wire import MessageLimits, ReplyOutcome

GREETING = b"\xff" + b"\0" * 8 + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\0") + b"\0" * 32


class Process:
    """The ports in a process of their own, so that a crash is seen as one."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(  # noqa: S603 - our own script
            [sys.executable, str(Path(__file__).parent / "ports_process.py")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        self.addresses = json.loads(self.process.stdout.readline())

    def connection(self, port: str) -> socket.socket:
        host, _, number = self.addresses[port].removeprefix("tcp://").rpartition(":")
        return socket.create_connection((host, int(number)), timeout=PATIENCE_MS / 1000)

    def end(self) -> dict[str, Any]:
        """End it in order and return its counters."""
        out, _ = self.process.communicate("", timeout=PATIENCE_MS / 1000)
        assert self.process.returncode == 0
        return dict(json.loads(out))


@pytest.fixture
def process() -> Iterator[Process]:
    one = Process()
    yield one
    one.process.kill()
    one.process.communicate()


@pytest.fixture
def client() -> Iterator[Callable[[int, str], Client]]:
    context = zmq.Context()
    made: list[Client] = []

    def make(kind: int, address: str) -> Client:
        made.append(Client(context, kind, address))
        return made[-1]

    yield make
    for one in made:
        one.socket.close(0)
    context.term()


def ready(identity: bytes) -> bytes:
    """Return the ZMTP command that ends a NULL handshake."""

    def entry(name: bytes, value: bytes) -> bytes:
        return bytes([len(name)]) + name + len(value).to_bytes(4, "big") + value

    body = b"\x05READY" + entry(b"Socket-Type", b"DEALER") + entry(b"Identity", identity)
    return b"\x04" + bytes([len(body)]) + body


def shaken(process: Process, port: str, identity: bytes = b"") -> socket.socket:
    """Return a raw connection after its handshake."""
    connection = process.connection(port)
    connection.sendall(GREETING)
    heard = b""
    while len(heard) < len(GREETING):
        heard += connection.recv(len(GREETING) - len(heard))
    connection.sendall(ready(identity))
    assert connection.recv(256)
    return connection


def test_raw_garbage_on_every_port_closes_nothing_but_its_own_connection(
    process: Process, client: Callable[[int, str], Client]
) -> None:
    dice = random.Random(7)  # noqa: S311 - garbage, the same every time
    phone = client(zmq.REQ, process.addresses["sensors"])
    for round_ in range(60):
        for port in ("sensors", "positions", "control"):
            with suppress(ConnectionError), process.connection(port) as raw:
                kind = round_ % 4
                if kind == 0:
                    raw.sendall(dice.randbytes(dice.randrange(1, 300)))
                elif kind == 1:
                    raw.sendall(GREETING + dice.randbytes(dice.randrange(1, 300)))
                elif kind == 2:
                    raw.sendall((GREETING + ready(b""))[: dice.randrange(1, 100)])
                else:
                    # A frame whose length is a lie, then silence.
                    raw.sendall(GREETING + ready(dice.randbytes(dice.randrange(20))) + b"\x02" + b"\xff" * 8)
        phone.send(pressure(seq=round_ + 1))
        assert phone.hear()["outcome"] == "accepted"
    assert process.process.poll() is None
    intake = process.end()["intake"]
    assert intake["received"] == sum(intake["outcomes"].values())
    assert intake["outcomes"]["accepted"] == 60


def test_nobody_can_claim_the_routing_id_that_is_given_out_next(
    process: Process, client: Callable[[int, str], Client]
) -> None:
    # libzmq aborts the process when it is about to give out an id that a peer has claimed; unseeded, the ids of a
    # process would begin with 0x6b8b4567 on Linux, and seeded with few bits they could be tried out.
    crowd = [shaken(process, "sensors", b"\0" + (0x6B8B4567 + i).to_bytes(4, "big")) for i in range(8)]
    for _ in range(8):
        phone = client(zmq.REQ, process.addresses["sensors"])
        phone.send(message("hello", device="p"))
        assert phone.hear()["type"] == "welcome"
    for raw in crowd:
        raw.close()
    process.end()


def test_half_a_message_is_no_message(process: Process, client: Callable[[int, str], Client]) -> None:
    raw = shaken(process, "sensors")
    raw.sendall(b"\x01\x05first")  # a part to which more should come
    phone = client(zmq.REQ, process.addresses["sensors"])
    phone.send(pressure())
    assert phone.hear()["outcome"] == "accepted"
    raw.close()
    phone.send(pressure())
    assert phone.hear()["outcome"] == "accepted"
    assert process.end()["intake"]["received"] == 2


def test_a_sensor_that_is_killed_and_one_that_never_reads_harm_nobody(
    process: Process, client: Callable[[int, str], Client]
) -> None:
    deaf = shaken(process, "sensors")
    body = pressure("deaf", ack=True)
    for _ in range(2_000):
        deaf.sendall(b"\x00" + bytes([len(body)]) + body)
    phone = client(zmq.REQ, process.addresses["sensors"])
    for seq in range(1, 50):
        phone.send(pressure(seq=seq))
        assert phone.hear()["outcome"] == "accepted"
    deaf.close()
    control = client(zmq.REQ, process.addresses["control"])
    assert control.ask("health")["ok"] is True
    process.end()


def nested(depth: int) -> bytes:
    return b"\x81\xa4type" * depth + b"\xc0"


BODIES = st.one_of(
    st.binary(max_size=200),
    st.builds(lambda b, n: b[:n], st.just(pressure(seq=1)), st.integers(0, 60)),
    st.builds(lambda n, bit: bytearray_flip(pressure(seq=1), n, bit), st.integers(0, 40), st.integers(0, 7)),
    st.recursive(
        st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text(max_size=5) | st.binary(),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
        max_leaves=8,
    ).map(msgspec.msgpack.encode),
    st.dictionaries(
        st.sampled_from(["v", "type", "device", "session", "seq", "ack", "t_ns", "pressure_hpa", "sensors", "xy"]),
        st.sampled_from([1, 0, -1, 2**63, "motion", "pressure", "p", "", b"\0" * 16, [1.0, 2.0], {}, None, 1e300]),
    ).map(msgspec.msgpack.encode),
    st.integers(1, 3_000).map(nested),
    st.just(b"\xdf\xff\xff\xff\xff"),
    st.just(message("scan", device="p", transmitters=["a"] * 70_000, rssi_dbm=[], heard_ns=[])),
    st.just(b"\x81" + b"x" * 20_000),
    st.just(pressure(device="p", ack=True, seq=3)),
)
FRAMES = st.lists(BODIES | st.just(b""), min_size=1, max_size=5)


def bytearray_flip(body: bytes, at: int, bit: int) -> bytes:
    flipped = bytearray(body)
    flipped[at % len(flipped)] ^= 1 << bit
    return bytes(flipped)


@given(st.lists(st.tuples(st.booleans(), FRAMES), min_size=1, max_size=40))
@settings(max_examples=25)
def test_messages_in_are_the_sum_of_outcomes_whatever_comes(messages: list[tuple[bool, list[bytes]]]) -> None:
    limits = PeerLimits(messages_per_s=1e-3, message_burst=30)
    hub = Hub(
        free_ports(peer=limits, message=MessageLimits(message_bytes=100_000)),
        run="run-1", site="office", describe=lambda what, args: None,
    )  # fmt: skip
    hub.start()
    context = zmq.Context()
    senders = [Client(context, zmq.DEALER, hub.addresses.sensors) for _ in range(2)]
    try:
        for second, frames in messages:
            senders[second].send(*frames)
        patience = PATIENCE_MS
        intake = hub.counters()["intake"]
        # A message counts as received before it is in the queue, and as pending from then on.
        while intake["received"] < len(messages) or intake["pending"]:
            for item in hub.take(0.001):
                hub.answer(item, ReplyOutcome.ACCEPTED)
            intake = hub.counters()["intake"]
            patience -= 1
            assert patience, f"{intake['received']} of {len(messages)} came, {intake['pending']} are pending"
        counters = hub.counters()
        intake = counters["intake"]
        assert intake["received"] == len(messages)
        assert intake["pending"] == 0
        assert sum(intake["outcomes"].values()) == len(messages)
        assert sum(sum(peer["outcomes"].values()) for peer in intake["peers"].values()) == len(messages)
        assert counters["errors"] == {}
    finally:
        for sender in senders:
            sender.socket.close(0)
        context.term()
        hub.stop()


def test_the_books_balance_at_every_instant_of_a_flood() -> None:
    hub = Hub(free_ports(queue_messages=200), run="run-1", site="office", describe=lambda what, args: None)
    hub.start()
    context = zmq.Context()
    senders = [Client(context, zmq.DEALER, hub.addresses.sensors) for _ in range(4)]
    try:
        for i in range(2_000):
            for n, sender in enumerate(senders):
                sender.send(pressure(f"d{n}", seq=i + 1) if (i + n) % 5 else b"\xc1")
        received = 0
        while received < 8_000:
            for item in hub.take(0.001, 50):
                hub.answer(item, ReplyOutcome.ACCEPTED)
            intake = hub.counters()["intake"]
            received = intake["received"]
            assert received == sum(intake["outcomes"].values()) + intake["pending"]
    finally:
        for sender in senders:
            sender.socket.close(0)
        context.term()
        hub.stop()
