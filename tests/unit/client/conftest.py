"""An engine's sockets without an engine: what tests of clients talk to."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import zmq

from tickfix.wire import (
    VERSION,
    AckReply,
    ErrorReply,
    HeartbeatMessage,
    MessageLimits,
    PublicationEnvelope,
    WelcomeReply,
    decode_message,
    encode_engine_message,
)

PATIENCE_MS = 60_000
"""How long a test waits for what must come."""


class Sockets:
    """A ROUTER and an XPUB, real ones; everything goes over tcp on this machine."""

    def __init__(self):
        self.context = zmq.Context()
        self._clients = []
        self.router = self._open(zmq.ROUTER)
        self.address = self._bound(self.router)
        self.xpub = self._open(zmq.XPUB)
        self.positions = self._bound(self.xpub)

    def _open(self, kind):
        socket = self.context.socket(kind)
        socket.linger = 0
        return socket

    def _bound(self, socket, address="tcp://127.0.0.1:*"):
        socket.bind(address)
        return socket.getsockopt_string(zmq.LAST_ENDPOINT)

    def keep(self, client):
        """Return a client, which is closed after the test."""
        self._clients.append(client)
        return client

    def receive(self, timeout_ms=0):
        """Return (peer, message) or None."""
        if not self.router.poll(timeout_ms):
            return None
        peer, data = self.router.recv_multipart()
        return peer, decode_message(data, MessageLimits())

    def say(self, peer, answer):
        """Send an answer to a peer."""
        self.router.send_multipart([peer, encode_engine_message(answer)])

    def ack(self, peer, message, outcome="accepted", detail=""):
        """Acknowledge a message."""
        identity = {"device": message.device, "session": message.session, "seq": message.seq}
        self.say(peer, AckReply(v=VERSION, outcome=outcome, detail=detail, **identity))

    def refuse(self, peer, message, outcome, **what):
        """Answer with an error."""
        identity = {"device": message.device, "session": message.session, "seq": message.seq}
        self.say(peer, ErrorReply(v=VERSION, outcome=outcome, **what, **identity))

    def welcome(self, peer, run="r1", limits=None):
        """Answer a hello."""
        self.say(peer, WelcomeReply(v=VERSION, run=run, site="mall", limits=limits or {}))

    def restart(self):
        """Close the sensors port as a dying engine does, and open it again at the same address."""
        if self.address.startswith("tcp"):
            monitor = self.router.get_monitor_socket(zmq.EVENT_CLOSED)
            self.router.unbind(self.address)
            assert monitor.poll(PATIENCE_MS), "the address is not free again"
            self.router.disable_monitor()
            monitor.close()
        self.router.close()
        self.router = self._open(zmq.ROUTER)
        self.router.bind(self.address)

    def subscriptions(self, n):
        """Wait for ``n`` subscriptions."""
        return [self.xpub.recv() for _ in range(n) if self.xpub.poll(PATIENCE_MS)]

    def publish(self, topic, seq, body, run="r1"):
        """Publish a body under a topic."""
        self.xpub.send_multipart([topic, encode_engine_message(PublicationEnvelope(v=VERSION, run=run, seq=seq)), body])

    def beat(self, seq, run="r1"):
        """Publish a heartbeat."""
        body = HeartbeatMessage(v=1, run=run, site="mall", wall_ns=1, uptime_s=1.0, devices=0, seq=seq)
        self.publish(b"heartbeat", seq, encode_engine_message(body), run)

    def close(self):
        """Close everything."""
        self.router.close()
        self.xpub.close()
        for client in self._clients:
            client.close()
        self.context.destroy(linger=0)


class Clock:
    """Seconds that pass when told."""

    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def sockets():
    """Return real sockets of an engine."""
    opened = Sockets()
    yield opened
    opened.close()


@pytest.fixture
def clock():
    """Return a clock that stands."""
    return Clock()


@pytest.fixture
def until() -> Callable:
    """Return a loop that turns both sides until something is there."""

    def turn(found, step, tries=20_000):
        for _ in range(tries):
            step()
            value = found()
            if value:
                return value
        raise AssertionError("it never came")

    return turn
