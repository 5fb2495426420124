"""The clients, in Python and in JavaScript, on the real ports of an engine."""

from __future__ import annotations

import json
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zmq
from live_lab import until
from ports_lab import PATIENCE_MS, Loop, all_done, allow, free_ports, make_keys

from tickfix.api import Belief, Estimate, Status
from tickfix.client import AccessDeniedError, Control, Keys, Listener, RequestRefusedError, RequestTimeoutError, Sensor
from tickfix.kernel.deduplication import SequenceWindow
from tickfix.ports import Hub
from tickfix.ports.port_settings import Clock, PeerLimits
from tickfix.ports.publishers import Publication
from tickfix.wire import CONTROL_REQUESTS, Hello, ReplyOutcome, encode_estimate

PATIENCE_S = PATIENCE_MS / 1000
NODE = shutil.which("node")
JAVASCRIPT = Path(__file__).parents[2] / "examples" / "javascript"


class Engine:
    """A real hub, and a loop that counts every numbered message once."""

    def __init__(self, settings, clock=None):
        told = {"describe": lambda what, args: {"asked": what, **args}, "clock": clock}
        self.hub = Hub(settings, run="r1", site="mall", **told)
        self.addresses = self.hub.start()
        self.seen = SequenceWindow()
        self.counted = []
        self.loop = Loop(self.hub, self._outcome)
        self.thread = threading.Thread(target=self.loop.run, daemon=True)
        self.thread.start()

    def _outcome(self, incoming):
        if isinstance(incoming.event, Hello):
            return ReplyOutcome.ACCEPTED
        if not self.seen.is_new(incoming.event.seq):
            return ReplyOutcome.DUPLICATE
        self.counted.append(incoming.event.seq)
        return ReplyOutcome.ACCEPTED

    def close(self):
        self.loop.ended.set()
        self.thread.join()
        self.hub.stop()


@pytest.fixture
def context() -> Iterator[zmq.Context]:
    opened = zmq.Context()
    yield opened
    opened.destroy(linger=0)


@pytest.fixture
def engine() -> Iterator[Engine]:
    opened = Engine(free_ports())
    yield opened
    opened.close()


def said(tick, floor="F1"):
    belief = Belief(floor=floor, xy=[1.0, 2.0], covariance=[[1.0, 0.0], [0.0, 1.0]])
    estimate = Estimate(device="d", pipeline="p", epoch=0, tick=tick, t_ns=tick, status=Status.TRACKING, belief=belief)
    return Publication("estimate", "mall", floor, "d", "p", encode_estimate(estimate))


def test_a_sensor_is_welcomed_and_everything_counts_once(engine, context):
    with Sensor(engine.addresses.sensors, "d", context=context) as sensor:
        sensor.hello({"gyroscope": 50.0})
        for k in range(600):
            sensor.motion({"gyroscope": ([k], [[0.0, 0.0, 1.0]])})
        assert sensor.flush(PATIENCE_S)
        assert sensor.bye(PATIENCE_S)
        assert sensor.welcome["site"] == "mall"
        assert sensor.welcome["limits"]["samples"] == 4096
    assert engine.counted == list(range(1, 602))
    assert sensor.outcomes == {"accepted": 601}
    assert engine.hub.counters()["replies_lost"] == 0


def test_an_engine_that_dies_again_and_again_gets_everything_once(context):
    """Every hub answers a few messages and goes down with whatever is under way."""
    engine = Engine(free_ports())
    settings = free_ports(sensors=engine.addresses.sensors)
    sensor = Sensor(engine.addresses.sensors, "d", context=context, resend_s=0.2)
    seen, counted = engine.seen, engine.counted
    for k in range(1500):
        sensor.pressure(k, 1000.0)
    for _ in range(4):
        sensor.flush(0.05)
        engine.close()
        engine = Engine(settings)
        engine.seen, engine.counted = seen, counted
    assert sensor.flush(PATIENCE_S)
    sensor.close()
    engine.close()
    assert sorted(counted) == list(range(1, 1501))
    assert set(sensor.outcomes) <= {"accepted", "duplicate", "busy"}


def test_a_throttled_sensor_gets_through_in_the_end(context):
    slower = [100]  # so that a slow machine is no slower than the rate
    clock = Clock(monotonic_ns=lambda: time.monotonic_ns() // slower[0])
    engine = Engine(free_ports(peer=PeerLimits(messages_per_s=400.0, message_burst=20)), clock)
    with Sensor(engine.addresses.sensors, "d", context=context, resend_s=0.1) as sensor:
        for k in range(100):
            sensor.pressure(k, 1000.0)
        until(lambda: sensor.flush(0.02) or engine.hub.counters()["intake"]["outcomes"]["throttled"])
        slower[0] = 1
        assert sensor.flush(PATIENCE_S)
        assert sensor.resent > 0
    engine.close()
    assert sorted(engine.counted) == list(range(1, 101))


def test_a_listener_gets_the_last_value_and_then_what_comes(engine, context):
    engine.hub.publish([said(1), said(2)])
    all_done(engine.hub)
    with Listener(engine.addresses.positions, ["estimate/mall/"], context=context) as listener:
        assert listener.receive(PATIENCE_S)["tick"] == 2
        with Listener(engine.addresses.positions, ["device/mall/d/"], context=context) as other:
            assert other.receive(PATIENCE_S)["tick"] == 2
        engine.hub.publish([said(3, "F2"), said(4)])
        assert [listener.receive(PATIENCE_S)["tick"] for _ in range(2)] == [3, 4]
        assert (listener.missed, listener.run) == (0, "r1")
        while listener.heartbeat is None:
            listener.receive(0.1)
        assert listener.heartbeat["site"] == "mall"


def test_control_is_answered(engine, context):
    with Control(engine.addresses.control, timeout_s=PATIENCE_S, context=context) as control:
        for what in CONTROL_REQUESTS:
            assert control.request(what), what
        assert control.subscribe_info()["run"] == "r1"
        assert control.primary("x") == {"did": "primary", "pipeline": "x"}
        with pytest.raises(RequestRefusedError, match="what: found 'dance'"):
            control.request("dance")


def test_keys_open_the_doors_they_are_for(context, tmp_path):
    pairs = make_keys(tmp_path, "phone", "stranger")
    ports = ["sensors", "positions", "control"]
    allow(tmp_path, {"name": "phone", "key": pairs["phone"].public, "devices": ["d"], "ports": ports})
    engine = Engine(free_ports(keys=tmp_path))
    keys = Keys.read(tmp_path / "phone.key", tmp_path / "engine.pub")
    with Sensor(engine.addresses.sensors, "d", keys=keys, context=context) as sensor:
        sensor.pressure(1, 1000.0)
        assert sensor.flush(PATIENCE_S)
    with Sensor(engine.addresses.sensors, "e", keys=keys, context=context) as sensor:
        sensor.pressure(1, 1000.0)
        assert sensor.flush(PATIENCE_S)
        assert sensor.outcomes == {"unauthorised": 1}
    with Control(engine.addresses.control, keys=keys, timeout_s=PATIENCE_S, context=context) as control:
        assert control.status() == {"asked": "status"}
    engine.hub.publish([said(1)])
    with Listener(engine.addresses.positions, keys=keys, context=context) as listener:
        assert listener.receive(PATIENCE_S)["tick"] == 1
    stranger = Keys.read(tmp_path / "stranger.key", tmp_path / "engine.pub")
    shut_out = Sensor(engine.addresses.sensors, "d", keys=stranger, context=context)
    shut_out.pressure(2, 1000.0)
    assert not shut_out.flush(0.3)
    assert shut_out.close() == 1
    engine.close()
    assert engine.counted == [1]


def test_whoever_is_shut_out_is_told_why(context, tmp_path):
    pairs = make_keys(tmp_path, "phone", "stranger")
    allow(tmp_path, {"name": "phone", "key": pairs["phone"].public, "ports": ["positions"]})
    guarded, open_to_all = Engine(free_ports(keys=tmp_path)), Engine(free_ports())
    phone, stranger = (Keys.read(tmp_path / f"{name}.key", tmp_path / "engine.pub") for name in ("phone", "stranger"))
    mistaken = Keys(phone.public, phone.secret, stranger.public)
    told = {"context": context, "timeout_s": PATIENCE_S}
    for keys, why in ((phone, "this key"), (stranger, "this key"), (None, "requires a key, and none was given")):
        with (
            Control(guarded.addresses.control, keys=keys, **told) as control,
            pytest.raises(AccessDeniedError, match=why),
        ):
            control.status()
    for keys, why in ((stranger, "this key"), (None, "requires a key")):
        with (
            Listener(guarded.addresses.positions, keys=keys, context=context) as listener,
            pytest.raises(AccessDeniedError, match=why),
        ):
            listener.receive(PATIENCE_S)
    with (
        Control(open_to_all.addresses.control, keys=phone, **told) as control,
        pytest.raises(AccessDeniedError, match="asks for none"),
    ):
        control.status()
    with Control(guarded.addresses.control, keys=mistaken, **told) as control:
        control._clock = lambda: (
            PATIENCE_S + 1.0 if control._handshake.suspected_cause else 0.0
        )  # time passes once it has a doubt
        with pytest.raises(RequestTimeoutError, match=r"is engine\.pub the public key of this very engine"):
            control.status()
    guarded.close()
    open_to_all.close()


def test_whoever_was_shut_out_before_it_asks_is_told_why_and_never_waits(context, tmp_path):
    pairs = make_keys(tmp_path, "phone")
    allow(tmp_path, {"name": "phone", "key": pairs["phone"].public, "ports": ["positions"]})
    guarded = Engine(free_ports(keys=tmp_path))
    keys = Keys.read(tmp_path / "phone.key", tmp_path / "engine.pub")
    with Control(guarded.addresses.control, keys=keys, context=context, timeout_s=PATIENCE_S) as control:
        until(lambda: not control._socket.get(zmq.EVENTS) & zmq.POLLOUT)
        for _ in range(2):
            with pytest.raises(AccessDeniedError, match="this key"):
                control.status()
    guarded.close()


@pytest.mark.skipif(NODE is None, reason="Node.js is not installed")
def test_javascript_gets_through_to_the_real_ports(engine):
    command = [NODE, str(JAVASCRIPT / "sensor.mjs"), engine.addresses.sensors, "js", "30", "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE_S)  # noqa: S603
    assert json.loads(done.stdout)["outcomes"] == {"accepted": 30}
    assert engine.counted == list(range(1, 31))
    engine.hub.publish([said(7)])
    command = [NODE, str(JAVASCRIPT / "listener.mjs"), engine.addresses.positions, "device/mall/d/", "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE_S)  # noqa: S603
    assert json.loads(done.stdout)["tick"] == 7
