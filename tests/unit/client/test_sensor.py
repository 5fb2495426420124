"""A sensor's messages arrive, are kept until they are acknowledged, and go out again when they were not."""

from __future__ import annotations

import time

import numpy as np
import pytest
import zmq

from tickfix.client import BufferFullError, ClientError, Sensor
from tickfix.client.session import SEND_WINDOW
from tickfix.wire import Bye, Hello, message_to_event


@pytest.fixture
def link(sockets, clock, until):
    """Return a function that opens a sensor, connected and greeted, and drives both sides."""
    return Link(sockets, clock, until)


class Link:
    def __init__(self, sockets, clock, until):
        self.sockets, self.clock, self.until = sockets, clock, until
        self.sensor = None
        self.peer = None

    def open(self, device="d", **options):
        self.sensor = self.sockets.keep(
            Sensor(self.sockets.address, device, clock=self.clock, context=self.sockets.context, **options)
        )
        message = self.next()
        assert isinstance(message, Hello)
        return self.sensor

    def next(self):
        """Return the next message that reaches the engine."""
        self.peer, message = self.until(lambda: self.sockets.receive(5), lambda: self.sensor.flush(0.0))
        return message

    def ack(self, message, outcome="accepted", **more):
        """Acknowledge, and let the sensor hear it."""
        before = self.sensor.outcomes.total()
        self.sockets.ack(self.peer, message, outcome, **more)
        self.until(lambda: self.sensor.outcomes.total() > before, self.turn)

    def turn(self):
        self.sensor._socket.poll(5)
        self.sensor.flush(0.0)

    def silent(self):
        """Whether nothing more comes from the sensor."""
        self.sensor.flush(0.0)
        return self.sockets.receive(50) is None


def test_what_is_measured_arrives_bit_for_bit(link):
    sensor = link.open(session="s")
    t_ns = np.array([10, 20], np.int64)
    values = np.array([[1.0, -0.0, np.nan], [4.0, 5.0, 1e-320]])
    sensor.motion({"gyroscope": (t_ns, values), "pressure": ([5], [[1013.25]])})
    message = link.next()
    event = message_to_event(message, 7)
    assert (message.device, message.session, message.seq, message.ack) == ("d", "s", 1, True)
    assert event.sensors["gyroscope"].t_ns.tobytes() == t_ns.tobytes()
    assert event.sensors["gyroscope"].values.tobytes() == values.tobytes()
    assert event.sensors["pressure"].values.tolist() == [[1013.25]]


def test_every_kind_of_message_is_understood(link):
    sensor = link.open()
    sensor.scan(["a", "b"], [-60, -70.5], [1, 2], source="ble")
    scan = message_to_event(link.next(), 9)
    assert (scan.transmitters, scan.rssi_dbm.tolist(), scan.t_ns, scan.source) == (("a", "b"), [-60.0, -70.5], 2, "ble")
    sensor.scan([], [], [], t_ns=3)
    assert message_to_event(link.next(), 9).t_ns == 3
    sensor.pressure(4, 1000)
    assert message_to_event(link.next(), 9).pressure_hpa == 1000.0
    sensor.fix(5, "F1", (1, 2), covariance=[[1, 0], [0, 1]], source="camera")
    fix = message_to_event(link.next(), 9)
    assert (fix.xy.tolist(), fix.covariance.tolist(), fix.source) == ([1, 2], [[1, 0], [0, 1]], "camera")
    sensor.truth(6, "F1", np.array([3.0, 4.0]))
    assert message_to_event(link.next(), 9).xy.tolist() == [3.0, 4.0]
    sensor.send({"type": "pressure", "t_ns": 8, "pressure_hpa": 1.0, "seq": 99})
    assert link.next().seq == 6


@pytest.mark.parametrize("dtype", [np.float32, np.int32, ">f8"])
def test_other_arrays_of_numpy_are_converted(link, dtype):
    sensor = link.open()
    values = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9]], dtype)
    if dtype == ">f8":
        values = values.astype(float)[::2]
        sensor.motion({"gyroscope": ([1, 2], values)})
    else:
        sensor.motion({"gyroscope": (np.arange(3, dtype=np.int32), values)})
    got = message_to_event(link.next(), 9).sensors["gyroscope"].values
    assert got.tolist() == values.astype(float).tolist()


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda s: s.motion({"gyroscope": ([1, 2], [[1, 2, 3]])}), "gyroscope.values: found 3 numbers; expected a row"),
        (lambda s: s.motion({"gyroscope": ([1.5], [[1, 2, 3]])}), "gyroscope.t_ns: found"),
        (lambda s: s.motion({"gyroscope": ([2**63], [[1, 2, 3]])}), "expected integers of 64 bits"),
        (lambda s: s.motion({"gyroscope": ([1], ["abc"])}), "expected a row of numbers"),
        (lambda s: s.scan(["a"], ["x"], [1]), "rssi_dbm: found 'x'; expected a row"),
        (lambda s: s.scan(["a"], [1.0, 2.0], [1]), "found 1 transmitters, 2 numbers of rssi_dbm"),
    ],
)
def test_what_cannot_be_sent_is_named_and_takes_no_number(link, call, text):
    sensor = link.open()
    with pytest.raises(ClientError) as caught:
        call(sensor)
    assert text in str(caught.value)
    assert sensor.pressure(1, 1.0) == 1


def test_an_acknowledged_message_is_forgotten_and_not_sent_again(link, clock):
    told = []
    sensor = link.open(on_outcome=lambda *outcome: told.append(outcome))
    sensor.pressure(1, 1.0)
    link.ack(link.next(), "late", detail="0.2 s")
    clock.now_s += 60
    assert link.silent()
    assert sensor.unacknowledged == 0
    assert told == [(1, "late", "0.2 s")]


def test_what_is_not_acknowledged_is_sent_again_with_its_number(link, clock):
    sensor = link.open(resend_s=2.0)
    sensor.pressure(1, 1.0)
    first = link.next()
    clock.now_s += 1.9
    assert link.silent()
    clock.now_s += 0.2
    assert link.next() == first
    assert (sensor.sent, sensor.resent) == (1, 1)


def test_every_further_try_waits_longer(link, clock):
    sensor = link.open(resend_s=1.0)
    sensor.pressure(1, 1.0)
    link.next()
    clock.now_s += 1.1
    link.next()
    clock.now_s += 1.1
    assert link.silent()
    clock.now_s += 1.0
    link.next()
    assert sensor.resent == 2


@pytest.mark.parametrize("outcome", ["busy", "throttled"])
def test_what_the_engine_could_not_take_is_sent_again(link, clock, outcome):
    sensor = link.open(resend_s=2.0)
    sensor.pressure(1, 1.0)
    first = link.next()
    link.ack(first, outcome)
    assert link.silent()
    assert sensor.unacknowledged == 1
    clock.now_s += 2.1
    assert link.next() == first
    link.ack(first)
    assert sensor.outcomes == {outcome: 1, "accepted": 1}
    assert sensor.unacknowledged == 0


def test_a_refused_message_is_over_and_its_reason_told(link):
    told = []
    sensor = link.open(on_outcome=lambda *outcome: told.append(outcome))
    sensor.pressure(1, 1.0)
    message = link.next()
    link.sockets.refuse(link.peer, message, "malformed", field="t_ns", found="1", expected="2")
    link.until(lambda: told, link.turn)
    assert told == [(1, "malformed", "t_ns: found 1; expected 2")]
    assert sensor.unacknowledged == 0


def test_acknowledgements_of_others_change_nothing(link):
    sensor = link.open(session="new")
    sensor.pressure(1, 1.0)
    message = link.next()
    other = type(message)(v=1, device="d", session="old", seq=1, t_ns=1, pressure_hpa=1.0)
    link.sockets.ack(link.peer, other)
    link.sockets.router.send_multipart([link.peer, b"\xc1garbage"])
    link.sockets.welcome(link.peer)
    link.until(lambda: sensor.welcome, link.turn)
    assert sensor.unacknowledged == 1
    assert not sensor.outcomes


def test_after_a_restart_of_the_engine_it_greets_and_sends_all_again_at_once(link):
    sensor = link.open(resend_s=1000.0)
    sensor.hello({"gyroscope": 50.0}, clock="boot")
    assert link.next().sensors == {"gyroscope": 50.0}
    for k in range(3):
        sensor.pressure(k, 1.0)
        link.next()
    link.sockets.restart()
    hello = link.next()
    assert isinstance(hello, Hello)
    assert (hello.sensors, hello.clock) == ({"gyroscope": 50.0}, "boot")
    assert [link.next().seq for _ in range(3)] == [1, 2, 3]


def test_what_is_measured_while_nobody_is_there_arrives_in_order_later(sockets, clock, until, tmp_path):
    sockets.address = f"ipc://{tmp_path}/later"
    sensor = sockets.keep(Sensor(sockets.address, "d", clock=clock, context=sockets.context))
    for k in range(600):
        sensor.pressure(k, 1.0)
    assert sensor.sent == 0
    sockets.restart()
    seqs = []

    def serve():
        sensor.flush(0.0)
        while (got := sockets.receive(1)) is not None:
            peer, message = got
            if not isinstance(message, Hello):
                seqs.append(message.seq)
                sockets.ack(peer, message)

    until(lambda: sensor.unacknowledged == 0, serve)
    assert seqs == list(range(1, 601))


def test_never_more_than_a_window_is_under_way(link):
    sensor = link.open()
    for k in range(SEND_WINDOW + 10):
        sensor.pressure(k, 1.0)
    messages = [link.next() for _ in range(SEND_WINDOW)]
    assert link.silent()
    for message in messages[1:]:
        link.sockets.ack(link.peer, message)
    link.until(lambda: sensor.unacknowledged == 11, link.turn)
    assert link.silent(), "the oldest holds the window, so that no number is ever too old for the engine to know"
    link.ack(messages[0])
    assert link.next().seq == SEND_WINDOW + 1


def test_when_too_much_waits_a_new_message_is_refused_clearly(sockets, clock):
    sensor = sockets.keep(Sensor(sockets.address, "d", clock=clock, context=sockets.context, buffer_messages=3))
    for k in range(3):
        sensor.pressure(k, 1.0)
    with pytest.raises(BufferFullError, match=r"3 messages \(\d+ bytes\) wait .* is the engine running"):
        sensor.pressure(3, 1.0)
    assert sensor.unacknowledged == 3


def test_when_too_much_waits_the_oldest_may_go(sockets, clock):
    dropped = []
    sensor = sockets.keep(
        Sensor(sockets.address, "d", clock=clock, context=sockets.context, buffer_bytes=300, on_drop=dropped.append)
    )
    for k in range(10):
        sensor.pressure(k, 1.0)
    assert dropped == list(range(1, len(dropped) + 1))
    assert sensor.unacknowledged == 10 - len(dropped) > 0
    with pytest.raises(BufferFullError):
        sensor.scan(["x" * 400], [1.0], [1])


def test_flush_waits_for_the_last_acknowledgement_and_no_longer(link):
    sensor = link.open()
    sensor.pressure(1, 1.0)
    message = link.next()
    sensor._clock = time.monotonic
    assert sensor.flush(0.01) is False
    link.sockets.ack(link.peer, message)
    assert sensor.flush(60.0) is True


def test_bye_goes_out_after_all_else_was_acknowledged(link):
    sensor = link.open()
    sensor.pressure(1, 1.0)
    message = link.next()
    assert sensor.bye(0.0) is False
    assert link.silent()
    link.ack(message)
    assert sensor.bye(0.0) is False
    bye = link.next()
    assert isinstance(bye, Bye)
    link.ack(bye)
    assert sensor.bye(0.0) is True
    assert link.silent(), "goodbye is said once"


def test_welcome_is_kept_and_a_refused_hello_explained(link):
    sensor = link.open()
    hello = Hello(v=1, device="d", session=sensor.session)
    link.sockets.refuse(link.peer, hello, "busy", field="devices", found="2000", expected="fewer")
    link.until(lambda: sensor.refused, link.turn)
    assert sensor.refused == "devices: found 2000; expected fewer"
    link.sockets.welcome(link.peer, run="r7")
    link.until(lambda: sensor.welcome, link.turn)
    assert (sensor.welcome["run"], sensor.refused) == ("r7", "")


def test_sessions_differ_and_an_old_one_goes_on_with_its_numbers(sockets, clock):
    one, other = (sockets.keep(Sensor(sockets.address, "d", context=sockets.context)) for _ in range(2))
    assert one.session != other.session
    again = sockets.keep(Sensor(sockets.address, "d", session=one.session, first_seq=41, context=sockets.context))
    assert again.pressure(1, 1.0) == 41


def test_an_address_that_cannot_be_is_refused(sockets):
    with pytest.raises(ClientError, match="found 'nowhere'"):
        Sensor("nowhere", "d", context=sockets.context)


def test_close_tells_how_much_is_unknown(sockets):
    sensor = sockets.keep(Sensor(sockets.address, "d", context=sockets.context))
    sensor.pressure(1, 1.0)
    assert sensor.close() == 1
    assert sensor.close() == 1


def test_ipc_works_as_tcp_does(sockets, until, tmp_path):
    router = sockets.context.socket(zmq.ROUTER)
    router.bind(f"ipc://{tmp_path}/sensors")
    sensor = sockets.keep(Sensor(f"ipc://{tmp_path}/sensors", "d", context=sockets.context))
    until(lambda: router.poll(5), lambda: sensor.flush(0.0))
    router.close(linger=0)


def test_a_message_beyond_the_limits_is_refused_before_the_engine_hangs_up(link):
    sensor = link.open()
    with pytest.raises(ClientError, match=r"motion: found \d+ bytes; expected at most 262144 in one message"):
        sensor.motion({"gyroscope": (range(10_000), [[0.0, 0.0, 0.0]] * 10_000)})
    link.sockets.welcome(link.peer, limits={"message_bytes": 200})
    link.until(lambda: sensor.welcome, link.turn)
    with pytest.raises(ClientError, match="at most 200"):
        sensor.scan(["x" * 200], [1.0], [1])
    assert sensor.pressure(1, 1.0) == 1
