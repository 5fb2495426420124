"""The sensor and the listener in JavaScript, run by Node.js against real sockets."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
from pathlib import Path

import numpy as np
import pytest
import zmq

from tickfix.api import Belief, Component, Estimate, Status
from tickfix.wire import (
    VERSION,
    AckReply,
    ErrorReply,
    HeartbeatMessage,
    Hello,
    MessageLimits,
    PublicationEnvelope,
    WelcomeReply,
    decode_message,
    encode_engine_message,
    encode_estimate,
    message_to_event,
    stream_topics,
)

EXAMPLES = Path(__file__).parents[2] / "examples" / "javascript"
NODE = shutil.which("node")
PATIENCE_MS = 60_000

pytestmark = pytest.mark.skipif(NODE is None, reason="Node.js is not installed")


class Engine:
    """An engine's sockets: a ROUTER that answers as told, and an XPUB."""

    def __init__(self):
        self.context = zmq.Context()
        self.router, self.sensors = self._bound(zmq.ROUTER, "tcp://127.0.0.1:*")
        self.xpub, self.positions = self._bound(zmq.XPUB, "tcp://127.0.0.1:*")
        self.xpub.setsockopt(zmq.XPUB_VERBOSE, 1)

    def _bound(self, kind, address):
        socket = self.context.socket(kind)
        socket.linger = 1000
        socket.setsockopt(zmq.HEARTBEAT_IVL, 50)
        socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, PATIENCE_MS)  # on a busy machine a pong may take its time
        socket.bind(address)
        return socket, socket.getsockopt_string(zmq.LAST_ENDPOINT)

    def receive(self):
        assert self.router.poll(PATIENCE_MS), "the sensor fell silent"
        peer, data = self.router.recv_multipart()
        return peer, decode_message(data, MessageLimits())

    def answer(self, peer, message, outcome="accepted"):
        identity = {"device": message.device, "session": message.session, "seq": message.seq}
        if isinstance(message, Hello):
            answer = WelcomeReply(v=VERSION, run="r1", site="mall", limits={})
        elif outcome == "busy":
            answer = ErrorReply(v=VERSION, outcome="busy", field="message", found="much", expected="less", **identity)
        else:
            answer = AckReply(v=VERSION, outcome=outcome, **identity)
        self.router.send_multipart([peer, encode_engine_message(answer)])

    def hang_up(self):
        """Break every connection, as a dying engine does, and be there again at the same address."""
        monitor = self.router.get_monitor_socket(zmq.EVENT_CLOSED)
        self.router.unbind(self.sensors)
        assert monitor.poll(PATIENCE_MS)
        self.router.disable_monitor()
        monitor.close()
        self.router.close(linger=0)
        self.router, _ = self._bound(zmq.ROUTER, self.sensors)

    def publish(self, topic, run, seq, body):
        self.xpub.send_multipart([topic, encode_engine_message(PublicationEnvelope(v=VERSION, run=run, seq=seq)), body])

    def subscriptions(self, n):
        frames = []
        while len(frames) < n:
            assert self.xpub.poll(PATIENCE_MS), "the listener did not subscribe"
            frames.append(self.xpub.recv())
        return frames

    def close(self):
        self.router.close()
        self.xpub.close()
        self.context.term()


@pytest.fixture
def engine():
    opened = Engine()
    yield opened
    opened.close()


@pytest.fixture
def node():
    """Return a function that starts an example; none is left running."""
    started = []

    def start(script, *arguments):
        command = [NODE, str(EXAMPLES / script), *arguments]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        started.append(subprocess.Popen(command, text=True, **pipes))  # noqa: S603  # our own example
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


def test_the_sensor_is_understood_and_ends_when_all_is_acknowledged(engine, node):
    process = node("sensor.mjs", engine.sensors, "phone-17", "20", "1")
    peer, hello = engine.receive()
    assert isinstance(hello, Hello)
    assert (hello.device, hello.sensors) == ("phone-17", {"accelerometer": 50.0, "gyroscope": 50.0})
    engine.answer(peer, hello)
    events = []
    for _ in range(20):
        peer, message = engine.receive()
        events.append(message_to_event(message, 1))
        engine.answer(peer, message)
    out, err = process.communicate(timeout=PATIENCE_MS / 1000)
    assert process.returncode == 0, err
    assert json.loads(out) == {
        "device": "phone-17", "session": hello.session, "sent": 20, "outcomes": {"accepted": 20},
    }  # fmt: skip
    assert "welcome to mall, run r1" in err
    assert [event.seq for event in events] == list(range(1, 21))
    motion, scan = events[0], events[9]
    assert {name: len(samples) for name, samples in motion.sensors.items()} == {"accelerometer": 10, "gyroscope": 10}
    assert np.diff(motion.sensors["gyroscope"].t_ns).tolist() == [20_000_000] * 9
    assert motion.sensors["gyroscope"].t_ns.tolist() == motion.sensors["accelerometer"].t_ns.tolist()
    assert motion.sensors["accelerometer"].values[3].tolist() == [0.0, 0.0, 9.81]
    assert np.signbit(motion.sensors["gyroscope"].values[:, 1]).all()
    assert (scan.transmitters, scan.rssi_dbm.tolist()) == (("aa:bb:cc:00:00:01", "aa:bb:cc:00:00:02"), [-52.0, -71.5])
    assert np.diff(scan.heard_ns).tolist() == [-300_000_000]


def test_the_sensor_sends_again_what_a_dying_engine_and_a_busy_one_did_not_take(engine, node):
    process = node("sensor.mjs", engine.sensors, "d", "5", "1")
    for _ in range(3):
        engine.receive()
    engine.hang_up()
    peer, hello = engine.receive()
    assert isinstance(hello, Hello), "a new connection begins with hello"
    engine.answer(peer, hello)
    taken = []
    while len(taken) < 5:
        peer, message = engine.receive()
        if message.seq == 2 and message.seq not in taken:
            engine.answer(peer, message, "busy")
            peer, message = wait_for(engine, 2, taken)
        if message.seq not in taken:
            taken.append(message.seq)
        engine.answer(peer, message)
    out, err = process.communicate(timeout=PATIENCE_MS / 1000)
    assert process.returncode == 0, err
    assert sorted(taken) == [1, 2, 3, 4, 5]
    assert json.loads(out)["outcomes"] == {"accepted": 5, "busy": 1}
    assert "message: found much; expected less" in err


def wait_for(engine, seq, taken):
    """Take what else comes until the message of this number comes again."""
    while True:
        peer, message = engine.receive()
        if message.seq == seq:
            return peer, message
        taken.append(message.seq)
        engine.answer(peer, message)


def estimate(tick, **more):
    belief = Belief(
        floor="F1",
        xy=[1.25, -0.0],
        covariance=[[1.0, 0.1], [0.1, 2.0]],
        floor_probabilities=(("F1", 0.75), ("Ü", 0.25)),
        mixture=(Component(weight=1.0, floor="F1", xy=[1.0, 2.0], covariance=[[1.0, 0.0], [0.0, 1.0]]),),
        heading_rad=-3.0,
    )
    return Estimate(
        device="d/é", pipeline="p", epoch=0, tick=tick, t_ns=tick * 200_000_000, status=Status.TRACKING,
        belief=belief, reasons=("recovered",), **more,
    )  # fmt: skip


def test_the_listener_prints_estimates_and_tells_gaps_and_restarts(engine, node):
    process = node("listener.mjs", engine.positions, "estimate/mall/", "4")
    assert engine.subscriptions(2) == [b"\x01estimate/mall/", b"\x01heartbeat"]
    by_floor, by_device = stream_topics("estimate", "mall", "F1", "d/é", "p")
    beat = HeartbeatMessage(v=1, run="r1", site="mall", wall_ns=2**62, uptime_s=0.5, devices=1, seq=1)
    engine.publish(b"heartbeat", "r1", 1, encode_engine_message(beat))
    for run, seq in (("r1", 70_000), ("r1", 70_000), ("r1", 70_001), ("r1", 70_004), ("r2", 1)):
        engine.publish(by_floor, run, seq, encode_estimate(estimate(seq, motion_age_ns=2**60 + 1)))
        engine.publish(by_device, run, seq, encode_estimate(estimate(seq)))
    out, err = process.communicate(timeout=PATIENCE_MS / 1000)
    assert process.returncode == 0, err
    told = [json.loads(line) for line in out.splitlines()]
    assert [one["tick"] for one in told] == [70_000, 70_001, 70_004, 1]
    first = told[0]
    assert (first["device"], first["status"], first["t_ns"]) == ("d/é", "tracking", 70_000 * 200_000_000)
    assert first["motion_age_ns"] == str(2**60 + 1)
    assert first["belief"]["xy"] == [1.25, 0]
    assert first["belief"]["floor_probabilities"] == [["F1", 0.75], ["Ü", 0.25]]
    assert first["belief"]["mixture"][0]["weight"] == 1
    assert err.splitlines() == ["missed 2 of estimate/mall/d%2F%C3%A9/p", "the engine restarted: run r2"]


class Raw:
    """A connection to an example, byte by byte, after its handshake."""

    def __init__(self, server, socket_type):
        self.socket, _ = server.accept()
        self.socket.settimeout(PATIENCE_MS / 1000)
        self.socket.sendall(b"\xff" + b"\0" * 8 + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\0") + b"\0" * 32)
        self.exactly(64)
        self.command(b"\x05READY\x0bSocket-Type" + len(socket_type).to_bytes(4, "big") + socket_type)
        assert self.frame().startswith(b"\x05READY")

    def command(self, body):
        self.socket.sendall(b"\x04" + bytes([len(body)]) + body)

    def exactly(self, n):
        data = b""
        while len(data) < n:
            data += self.socket.recv(n - len(data))
        return data

    def frame(self):
        is_long = self.exactly(1)[0] & 2
        return self.exactly(int.from_bytes(self.exactly(8 if is_long else 1), "big"))


@pytest.mark.parametrize(
    ("script", "arguments", "socket_type"),
    [("sensor.mjs", ("d", "5", "1"), b"ROUTER"), ("listener.mjs", ("estimate/", "1"), b"XPUB")],
)
def test_a_ping_is_answered_with_what_it_carries(node, script, arguments, socket_type):
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(PATIENCE_MS / 1000)
        node(script, f"tcp://127.0.0.1:{server.getsockname()[1]}", *arguments)
        raw = Raw(server, socket_type)
        raw.command(b"\x04PING\0\x50tell me")
        while (frame := raw.frame())[:5] != b"\x04PONG":
            assert frame[:1] != b"\x04", f"the example says {frame!r}"
        assert frame == b"\x04PONGtell me"
        raw.socket.close()


def test_an_example_called_wrongly_says_how(node):
    for script in ("sensor.mjs", "listener.mjs"):
        process = node(script)
        _, err = process.communicate(timeout=PATIENCE_MS / 1000)
        assert (process.returncode, err.split(":")[0]) == (2, "usage")
