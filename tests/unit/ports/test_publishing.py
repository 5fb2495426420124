"""What is handed to libzmq, and what is only counted."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import zmq

from tickfix.ports.publishers import XpubPublisher

WAIT_MS = 30_000


class Port:
    """A publisher that is listened to within the process; what is sent has arrived when ``send`` returns."""

    def __init__(self) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._opened: list[zmq.Socket[bytes]] = []
        self.socket = self.open(zmq.XPUB)
        self.socket.bind("inproc://here")
        self.publisher = XpubPublisher(self.socket)

    def open(self, kind: int) -> zmq.Socket[bytes]:
        """Return a socket whose queue of messages is short; that of subscriptions has no end."""
        socket = self._context.socket(kind)
        self._opened.append(socket)
        socket.setsockopt(zmq.SNDHWM, 10 if kind == zmq.XPUB else 0)
        socket.setsockopt(zmq.RCVHWM, 0 if kind == zmq.XPUB else 10)
        return socket

    def close(self) -> None:
        for socket in self._opened:
            socket.close(0)
        self._context.term()

    def listener(self, *topics: bytes) -> zmq.Socket[bytes]:
        """Return a listener whose subscriptions have arrived."""
        socket = self.open(zmq.XSUB)
        socket.connect("inproc://here")
        self.say(socket, *(b"\x01" + topic for topic in topics))
        return socket

    def say(self, socket: zmq.Socket[bytes], *frames: bytes) -> None:
        for frame in frames:
            socket.send(frame)
        if frames:
            assert self.socket.poll(WAIT_MS)

    def send(self, topic: bytes) -> None:
        self.publisher.poll_subscriptions()
        self.publisher.send((topic, b"envelope", b"body"))


@pytest.fixture
def port() -> Iterator[Port]:
    port = Port()
    yield port
    port.close()


def heard(socket: zmq.Socket[bytes]) -> list[bytes]:
    """Return the topics that came."""
    topics = []
    while socket.poll(0):
        topics.append(socket.recv_multipart()[0])
    return topics


def test_what_nobody_subscribed_to_is_counted_all_the_same(port: Port) -> None:
    port.send(b"estimate/a")
    listener = port.listener(b"estimate/")
    port.send(b"device/a")
    port.send(b"estimate/b")
    assert heard(listener) == [b"estimate/b"]
    assert (port.publisher.sent, port.publisher.sent_bytes, port.publisher.stalls) == (3, 12, 0)


def test_who_subscribes_hears_the_very_next_message(port: Port) -> None:
    first = port.listener(b"estimate/")
    port.send(b"device/a")
    second = port.listener(b"dev")
    port.send(b"device/b")
    port.say(first, b"\x01")
    port.send(b"revision/c")
    assert (heard(first), heard(second)) == ([b"revision/c"], [b"device/b"])


def test_a_stranger_who_unsubscribes_takes_nothing_from_others(port: Port) -> None:
    listener, stranger = port.listener(b"estimate/"), port.listener(b"device/")
    port.send(b"estimate/a")
    port.say(stranger, b"\x00estimate/", b"\x00device/")
    port.send(b"estimate/b")
    assert heard(listener) == [b"estimate/a", b"estimate/b"]


@pytest.mark.parametrize("count", [31, 32, 33, 100, 1_500])
def test_however_many_topics_are_asked_for_each_is_heard(port: Port, count: int) -> None:
    listeners = [port.listener() for _ in range(4)]
    for n in range(count):
        port.say(listeners[n % 4], b"\x01device/%d/" % n)
    for n in (0, count // 2, count - 1):
        port.send(b"device/%d/a" % n)
        assert heard(listeners[n % 4]) == [b"device/%d/a" % n]


def test_a_new_socket_begins_without_listeners(port: Port) -> None:
    listener = port.listener(b"")
    port.send(b"estimate/a")
    other = port.open(zmq.XPUB)
    other.bind("inproc://there")
    port.publisher.attach(other)
    port.send(b"estimate/b")
    listener.connect("inproc://there")
    assert other.poll(WAIT_MS)
    port.send(b"estimate/c")
    assert heard(listener) == [b"estimate/a", b"estimate/c"]


def test_a_listener_that_does_not_read_is_one_stall_and_costs_others_nothing(port: Port) -> None:
    slow, quick = port.listener(b""), port.listener(b"")
    got = []
    for n in range(50):
        port.send(b"%d" % n)
        got += heard(quick)
    assert got == [b"%d" % n for n in range(50)]
    assert port.publisher.stalls > 0
    missed = heard(slow)
    assert 0 < len(missed) < 50
    assert missed == got[: len(missed)]
