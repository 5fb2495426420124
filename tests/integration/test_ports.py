"""The ports of an engine, with real sockets: what goes in is answered, what is published is heard."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import pytest
import zmq
from ports_lab import PATIENCE_MS, Client, Loop, all_done, free_ports, message, pressure

from tickfix.api import MotionSamples, Pressure
from tickfix.api.errors import PortError
from tickfix.ports import ASK_LOOP, Hub, PeerLimits, PortSettings, Publication
from tickfix.ports.port_settings import Clock
from tickfix.wire import Hello, MessageLimits, ReplyOutcome

Open = Callable[..., Hub]
Connect = Callable[..., Client]


def describe(what: str, args: Any) -> Any:
    if what == "plugins":
        raise KeyError("no such thing")
    if args.get("of") == "the loop":
        return ASK_LOOP
    return {"what": what, "args": dict(args)}


@pytest.fixture
def open_hub() -> Iterator[Open]:
    hubs: list[Hub] = []

    def start(clock: Clock | None = None, **settings: Any) -> Hub:
        hub = Hub(free_ports(**settings), run="run-1", site="office", describe=describe, clock=clock)
        hub.start()
        hubs.append(hub)
        return hub

    yield start
    for hub in hubs:
        hub.stop()


@pytest.fixture
def connect() -> Iterator[Connect]:
    context = zmq.Context()
    clients: list[Client] = []

    def make(kind: int, address: str, **more: Any) -> Client:
        clients.append(Client(context, kind, address, **more))
        return clients[-1]

    yield make
    for client in clients:
        client.socket.close(0)
    context.term()


@pytest.fixture
def run_loop() -> Iterator[Callable[..., Loop]]:
    loops: list[tuple[Loop, threading.Thread]] = []

    def start(hub: Hub, **more: Any) -> Loop:
        loop = Loop(hub, **more)
        thread = threading.Thread(target=loop.run, daemon=True)
        thread.start()
        loops.append((loop, thread))
        return loop

    yield start
    for loop, thread in loops:
        loop.ended.set()
        thread.join()


def books(hub: Hub) -> dict[str, int]:
    """Return the intake's outcomes, after making sure that they add up."""
    intake = hub.counters()["intake"]
    assert intake["received"] == sum(intake["outcomes"].values()) + intake["pending"]
    for peer in intake["peers"].values():
        assert peer["received"] >= sum(peer["outcomes"].values())
    return {name: n for name, n in intake["outcomes"].items() if n}


def take(hub: Hub, count: int) -> list[Any]:
    taken: list[Any] = []
    while len(taken) < count:
        came = hub.take(20.0)
        assert came, f"{len(taken)} of {count} came"
        taken += came
    return taken


# --- sensors -----------------------------------------------------------------------------------------------------


def test_a_dealer_is_welcomed_and_its_messages_are_acknowledged(open_hub: Open, connect: Connect) -> None:
    hub = open_hub()
    phone = connect(zmq.DEALER, hub.addresses.sensors)
    phone.tell("hello", device="p", session="s", seq=1)
    (hello,) = take(hub, 1)
    assert isinstance(hello.event, Hello)
    hub.answer(hello, ReplyOutcome.ACCEPTED)
    welcome = phone.hear()
    assert (welcome["type"], welcome["run"], welcome["site"]) == ("welcome", "run-1", "office")
    assert welcome["limits"]["message_bytes"] == MessageLimits().message_bytes

    phone.send(pressure(session="s", seq=2, ack=True))
    phone.send(pressure(session="s", seq=3))
    asked, silent = take(hub, 2)
    assert isinstance(asked.event, Pressure)
    assert (asked.wants_ack, silent.wants_ack) == (True, False)
    assert asked.event.arrival_ns <= silent.event.arrival_ns
    assert asked.received_ns <= silent.received_ns
    hub.answer(silent, ReplyOutcome.ACCEPTED)
    hub.answer(asked, ReplyOutcome.LATE, "two ticks")
    assert phone.hear() == {
        "type": "ack", "v": 1, "device": "p", "session": "s", "seq": 2, "outcome": "late", "detail": "two ticks",
    }  # fmt: skip
    assert books(hub) == {"accepted": 2, "late": 1}


def test_a_message_is_answered_once_however_often_the_loop_says_so(open_hub: Open, connect: Connect) -> None:
    hub = open_hub()
    phone = connect(zmq.DEALER, hub.addresses.sensors)
    phone.send(pressure(ack=True, seq=1))
    phone.send(pressure(ack=True, seq=2))
    first, second = take(hub, 2)
    hub.answer(first, ReplyOutcome.ACCEPTED)
    hub.answer(first, ReplyOutcome.STALE)
    hub.answer(second, ReplyOutcome.STALE)
    assert [(phone.hear()["seq"], phone.hear()["seq"])] == [(1, 2)]
    assert books(hub) == {"accepted": 1, "stale": 1}


def test_req_always_gets_exactly_one_answer(open_hub: Open, connect: Connect, run_loop: Callable[..., Loop]) -> None:
    hub = open_hub(peer=PeerLimits(messages_per_s=0.001, message_burst=8))
    run_loop(hub, outcome=lambda item: ReplyOutcome.BUSY if item.event.seq == 9 else ReplyOutcome.ACCEPTED)
    phone = connect(zmq.REQ, hub.addresses.sensors)
    answers = []
    for body in (
        message("hello", device="p"),
        message("hello", device="p", ack=True),
        pressure(),
        pressure(ack=True),
        pressure(seq=9),
        b"",
        b"\xc1",
        message("teleport", device="p"),
        pressure(),  # the ninth is over the limit
    ):
        phone.send(body)
        answer = phone.hear()
        answers.append((answer["type"], answer.get("outcome")))
    assert answers == [
        ("welcome", None), ("welcome", None), ("ack", "accepted"), ("ack", "accepted"), ("error", "busy"),
        ("error", "malformed"), ("error", "malformed"), ("error", "unknown"), ("error", "throttled"),
    ]  # fmt: skip
    assert phone.hears_nothing_for(50)
    assert books(hub) == {"accepted": 4, "busy": 1, "malformed": 2, "unknown": 1, "throttled": 1}


def test_an_error_names_field_value_and_expectation_though_no_ack_was_asked(open_hub: Open, connect: Connect) -> None:
    hub = open_hub()
    phone = connect(zmq.DEALER, hub.addresses.sensors)
    phone.send(pressure(device="p", seq=7, session="s", pressure_hpa="high"))
    error = phone.hear()
    assert (error["outcome"], error["field"], error["seq"], error["session"]) == ("malformed", "pressure_hpa", 7, "s")
    assert "high" in error["found"]
    assert "float" in error["expected"]


@pytest.mark.parametrize("frames", [(b"", b"a", b"b"), (b"a", b"b"), (b"",), (b"", b""), (b"x",) * 500])
def test_messages_of_odd_frames_are_malformed_and_what_follows_is_understood(
    open_hub: Open, connect: Connect, frames: tuple[bytes, ...]
) -> None:
    hub = open_hub()
    phone = connect(zmq.DEALER, hub.addresses.sensors)
    phone.send(*frames)
    assert phone.hear()["outcome"] == "malformed"
    phone.send(pressure())
    hub.answer(*take(hub, 1), ReplyOutcome.ACCEPTED)
    assert books(hub) == {"accepted": 1, "malformed": 1}


def test_what_is_longer_than_allowed_is_told_or_cut_off_and_others_go_on(open_hub: Open, connect: Connect) -> None:
    hub = open_hub(message=MessageLimits(message_bytes=10_000))
    phone, giant = (connect(zmq.DEALER, hub.addresses.sensors) for _ in range(2))
    giant.send(b"\x81" + b"x" * 15_000)
    error = giant.hear()
    assert (error["outcome"], error["found"]) == ("malformed", "15001 bytes")
    with giant.socket.get_monitor_socket(zmq.EVENT_DISCONNECTED) as monitor:
        giant.send(b"\x81" + b"x" * 50_000)  # libzmq cuts the connection: this never becomes a message
        assert monitor.poll(PATIENCE_MS)
        giant.socket.disable_monitor()
    giant.send(pressure("g"))
    phone.send(pressure())
    for item in take(hub, 2):
        hub.answer(item, ReplyOutcome.ACCEPTED)
    assert books(hub) == {"accepted": 2, "malformed": 1}


def test_unknown_fields_are_skipped_and_counted_and_unknown_sensors_carried(open_hub: Open, connect: Connect) -> None:
    hub = open_hub()
    phone = connect(zmq.DEALER, hub.addresses.sensors)
    batch = {"t_ns": [1], "values": [[0.0, 0.0, 9.81]]}
    phone.tell("motion", device="p", sensors={"accelerometer": batch, "nose": batch}, mood="good", hat=[1, 2])
    (item,) = take(hub, 1)
    assert isinstance(item.event, MotionSamples)
    assert list(item.event.sensors) == ["accelerometer", "nose"]
    all_done(hub)
    assert hub.counters()["intake"]["unknown_skipped"] == {"fields": 2}


def test_a_full_queue_says_busy_and_takes_again_when_the_loop_has_taken(open_hub: Open, connect: Connect) -> None:
    hub = open_hub(queue_messages=4)
    phone = connect(zmq.DEALER, hub.addresses.sensors)
    for seq in range(1, 11):
        phone.send(pressure(seq=seq))
    assert [phone.hear()["outcome"] for _ in range(8)] == ["busy"] * 8
    assert [item.event.seq for item in take(hub, 2)] == [1, 2]
    phone.send(pressure(seq=11))
    assert take(hub, 1)[0].event.seq == 11
    assert hub.counters()["intake"]["pending"] == 3
    assert books(hub) == {"busy": 8}


def test_new_devices_or_all_are_refused_with_the_reason_until_it_is_lifted(
    open_hub: Open, connect: Connect, run_loop: Callable[..., Loop]
) -> None:
    hub = open_hub()
    run_loop(hub)
    phone = connect(zmq.REQ, hub.addresses.sensors)

    def outcome_for(device: str) -> tuple[str, str]:
        phone.send(pressure(device))
        answer = phone.hear()
        return answer["outcome"], answer.get("found", "")

    assert outcome_for("old") == ("accepted", "")
    hub.reject_new_devices("ticks are late")
    assert outcome_for("new") == ("busy", "a new device: ticks are late")
    assert outcome_for("old") == ("accepted", "")
    hub.reject_all_messages("the disk is full")
    assert outcome_for("old") == ("busy", "the disk is full")
    hub.reject_all_messages(None)
    hub.reject_new_devices(None)
    assert outcome_for("new") == ("accepted", "")


def test_devices_are_limited_and_one_that_left_makes_room(
    open_hub: Open, connect: Connect, run_loop: Callable[..., Loop]
) -> None:
    hub = open_hub(peer=PeerLimits(devices=2), devices=3, takeover_s=3600.0)
    run_loop(hub)
    one, two = (connect(zmq.REQ, hub.addresses.sensors) for _ in range(2))

    def outcome(client: Client, device: str) -> str:
        client.send(pressure(device))
        return str(client.hear()["outcome"])

    assert [outcome(one, device) for device in "abc"] == ["accepted", "accepted", "busy"]
    assert [outcome(two, device) for device in "cd"] == ["accepted", "busy"]
    assert outcome(two, "a") == "unauthorised"
    hub.forget("a")
    all_done(hub)
    assert outcome(two, "d") == "accepted"


def test_a_flood_is_throttled_before_decoding_and_costs_the_others_nothing(open_hub: Open, connect: Connect) -> None:
    hub = open_hub(peer=PeerLimits(messages_per_s=1.0, message_burst=50))
    flooder, phone = (connect(zmq.DEALER, hub.addresses.sensors) for _ in range(2))
    for seq in range(1, 2_001):
        flooder.send(pressure("flood", seq=seq))
    for seq in range(1, 41):
        phone.send(pressure("p", seq=seq, ack=True))
    heard = []
    while len(heard) < 40:
        for item in take(hub, 1):
            hub.answer(item, ReplyOutcome.ACCEPTED)
            if item.event.device == "p":
                heard.append(item.event.seq)
    assert heard == list(range(1, 41))
    assert [phone.hear()["outcome"] for _ in range(40)] == ["accepted"] * 40
    error = flooder.hear()
    assert (error["outcome"], error["field"]) == ("throttled", "message")


def test_a_peer_that_left_or_does_not_read_is_counted_and_harms_nobody(open_hub: Open, connect: Connect) -> None:
    hub = open_hub()
    phone = connect(zmq.DEALER, hub.addresses.sensors)
    gone = connect(zmq.DEALER, hub.addresses.sensors)
    gone.send(pressure("gone", ack=True))
    (item,) = take(hub, 1)
    gone.socket.close(0)
    phone.send(pressure("p", ack=True))
    (other,) = take(hub, 1)
    hub.answer(item, ReplyOutcome.ACCEPTED)
    hub.answer(other, ReplyOutcome.ACCEPTED)
    assert phone.hear()["outcome"] == "accepted"
    assert books(hub) == {"accepted": 2}


def test_a_phone_that_comes_back_under_its_own_routing_id_is_heard_at_once(open_hub: Open, connect: Connect) -> None:
    hub = open_hub()
    for seq in (1, 2):
        # The first connection stays: to the hub it looks alive, as one of a phone that changed its network does.
        phone = connect(zmq.DEALER, hub.addresses.sensors, routing_id=b"phone-17")
        phone.send(pressure("p", session="s", seq=seq, ack=True))
        (item,) = take(hub, 1)
        hub.answer(item, ReplyOutcome.ACCEPTED)
        assert phone.hear()["seq"] == seq


# --- positions ---------------------------------------------------------------------------------------------------


def said(device: str = "p", floor: str | None = "F1", body: bytes = b"body", family: Any = "estimate") -> Publication:
    return Publication(family, "office", floor, device, "fusion", body)


def subscriber(connect: Connect, hub: Hub, *topics: bytes) -> Client:
    client = connect(zmq.SUB, hub.addresses.positions)
    for topic in topics:
        client.socket.subscribe(topic)
    return client


def frames(client: Client) -> tuple[bytes, int, bytes]:
    """Return the next publication that is no repetition."""
    while True:
        topic, envelope, body = client.socket.recv_multipart()
        seen = msgspec.msgpack.decode(envelope)
        assert (seen["v"], seen["run"]) == (1, "run-1")
        if seen["seq"] > client.heard.get(topic, 0):
            client.heard[topic] = seen["seq"]
            return topic, seen["seq"], body


def publish(hub: Hub, *what: Publication) -> None:
    """Publish, and wait until it is out."""
    hub.publish(what)
    all_done(hub)


def test_a_new_subscriber_gets_the_last_value_of_every_stream_its_prefix_matches(
    open_hub: Open, connect: Connect
) -> None:
    hub = open_hub(heartbeat_s=3600.0)
    publish(hub, said("a", body=b"a1"), said("b", body=b"b1"), said("a", body=b"a2"), said("a", "F2", b"a3"))
    by_device = subscriber(connect, hub, b"device/office/a/")
    assert frames(by_device) == (b"device/office/a/fusion", 3, b"a3")
    first_floor = subscriber(connect, hub, b"estimate/office/F1/")
    assert frames(first_floor) == (b"estimate/office/F1/b/fusion", 1, b"b1")  # a has gone to F2
    everything = subscriber(connect, hub, b"")
    assert {frames(everything) for _ in range(4)} == {
        (b"device/office/a/fusion", 3, b"a3"), (b"estimate/office/F2/a/fusion", 3, b"a3"),
        (b"device/office/b/fusion", 1, b"b1"), (b"estimate/office/F1/b/fusion", 1, b"b1"),
    }  # fmt: skip


def test_a_subscriber_that_is_there_hears_every_number_in_order(open_hub: Open, connect: Connect) -> None:
    hub = open_hub(heartbeat_s=3600.0)
    hub.publish([said()])
    listener = subscriber(connect, hub, b"estimate/")
    assert frames(listener)[1] == 1
    hub.publish([said(body=b"%d" % i) for i in range(2, 500)])
    assert [frames(listener)[1:] for _ in range(2, 500)] == [(i, b"%d" % i) for i in range(2, 500)]


def test_revisions_have_topics_and_numbers_of_their_own_and_no_last_value(open_hub: Open, connect: Connect) -> None:
    hub = open_hub(heartbeat_s=3600.0)
    listener = subscriber(connect, hub, b"revision/", b"device/")
    hub.publish([said()])
    assert frames(listener)[0] == b"device/office/p/fusion"
    publish(hub, said(family="revision", body=b"r1"), said(family="revision", body=b"r2"), said())
    assert [frames(listener) for _ in range(3)] == [
        (b"revision/office/F1/p/fusion", 1, b"r1"),
        (b"revision/office/F1/p/fusion", 2, b"r2"),
        (b"device/office/p/fusion", 2, b"body"),
    ]
    late = subscriber(connect, hub, b"revision/", b"device/")
    assert frames(late)[0] == b"device/office/p/fusion"


def test_names_cannot_break_out_of_their_topic(open_hub: Open, connect: Connect) -> None:
    hub = open_hub(heartbeat_s=3600.0)
    hub.publish(
        [Publication("estimate", "a/b", None, "../p é", "x", b"1"), Publication("estimate", "a/b", "-", "q", "x", b"2")]
    )
    listener = subscriber(connect, hub, b"estimate/")
    topics = {frames(listener)[0] for _ in range(2)}
    assert topics == {b"estimate/a%2Fb/-/..%2Fp%20%C3%A9/x", b"estimate/a%2Fb/%2D/q/x"}


def test_a_device_that_left_is_not_repeated_and_its_numbers_go_on(open_hub: Open, connect: Connect) -> None:
    hub = open_hub(heartbeat_s=3600.0)
    publish(hub, said("a"), said("b"))
    hub.forget("a")
    all_done(hub)
    assert frames(subscriber(connect, hub, b"device/"))[0] == b"device/office/b/fusion"
    hub.publish([said("a")])
    assert frames(subscriber(connect, hub, b"device/office/a"))[1] == 2


def test_heartbeats_carry_the_run_and_count(open_hub: Open, connect: Connect) -> None:
    hub = open_hub(heartbeat_s=0.01)
    listener = subscriber(connect, hub, b"heartbeat")
    beats = []
    for _ in range(3):
        topic, seq, body = frames(listener)
        beat = msgspec.msgpack.decode(body)
        assert (topic, beat["type"], beat["run"], beat["site"], beat["seq"]) == (
            b"heartbeat", "heartbeat", "run-1", "office", seq,
        )  # fmt: skip
        beats.append(seq)
    assert beats == list(range(beats[0], beats[0] + 3))


def test_a_listener_that_does_not_read_is_counted_and_costs_the_others_nothing(
    open_hub: Open, connect: Connect
) -> None:
    hub = open_hub(heartbeat_s=3600.0)
    hub.publish([said(body=b"0")])
    dead = connect(zmq.SUB, hub.addresses.positions)
    dead.socket.setsockopt(zmq.RCVHWM, 1)
    dead.socket.subscribe(b"device/")
    assert frames(dead)[2] == b"0"
    quick = subscriber(connect, hub, b"device/")
    assert frames(quick)[2] == b"0"
    numbers: list[int] = []
    body = b"x" * 2_000
    total = 30_000
    # A listener is quick when it has read all there is before more is said than its queue holds.
    for done in range(1_000, total + 1, 1_000):
        hub.publish([said(body=body)] * 1_000)
        while not numbers or numbers[-1] <= done:
            numbers.append(frames(quick)[1])
    missing = set(range(2, total + 2)).symmetric_difference(numbers)
    assert not missing, f"{len(missing)} of {total}, from {min(missing)} to {max(missing)}"
    assert hub.counters()["publications"]["stalls"] >= 1


def test_followers_get_the_records_as_they_are(open_hub: Open, connect: Connect) -> None:
    hub = open_hub()
    follower = connect(zmq.SUB, hub.addresses.follow)
    follower.socket.subscribe(b"")
    number = 0
    while follower.hears_nothing_for(5):  # a subscription needs its time to arrive
        number += 1
        hub.follow([(b"event", number, b"e%d" % number)])
    first = follower.socket.recv_multipart()
    begin = msgspec.msgpack.decode(first[1])["number"]
    hub.follow([(b"event", number + 1, b"bytes"), (b"decision", number + 2, b"more")])
    seen = [first]
    while msgspec.msgpack.decode(seen[-1][1])["number"] < number + 2:
        seen.append(follower.socket.recv_multipart())
    assert [msgspec.msgpack.decode(envelope)["number"] for _, envelope, _ in seen] == list(range(begin, number + 3))
    assert [(kind, body) for kind, _, body in seen[-2:]] == [(b"event", b"bytes"), (b"decision", b"more")]


# --- control -----------------------------------------------------------------------------------------------------


def test_control_answers_while_the_loop_takes_nothing(open_hub: Open, connect: Connect) -> None:
    hub = open_hub()
    for kind in (zmq.REQ, zmq.DEALER):
        client = connect(kind, hub.addresses.control)
        reply = client.ask("status", deep=True)
        assert reply == {
            "type": "reply", "v": 1, "what": "status", "ok": True,
            "data": {"what": "status", "args": {"deep": True}},
        }  # fmt: skip
        assert client.ask("subscribe_info")["data"]["positions"] == hub.addresses.positions
        failed = client.ask("plugins")
        assert (failed["ok"], failed["data"]) == (False, "KeyError: 'no such thing'")
        unknown = client.ask("teleport")
        assert (unknown["type"], unknown["outcome"], unknown["field"]) == ("error", "unknown", "what")
        client.send(b"nonsense")
        assert client.hear()["outcome"] == "malformed"
    assert hub.counters()["control"] == {"requests": 10, "refused": 4}


def test_a_query_that_needs_the_loop_is_answered_by_it_and_no_other_waits_for_that(
    open_hub: Open, connect: Connect, run_loop: Callable[..., Loop]
) -> None:
    hub = open_hub()
    patient, other = (connect(zmq.REQ, hub.addresses.control) for _ in range(2))
    patient.tell("request", what="status", args={"of": "the loop"})
    assert other.ask("status")["data"] == {"what": "status", "args": {}}
    assert patient.hears_nothing_for(1)
    run_loop(hub)
    answer = patient.hear()
    assert (answer["ok"], answer["data"]) == (True, {"did": "status", "of": "the loop"})


def test_orders_are_carried_out_by_the_loop(open_hub: Open, connect: Connect, run_loop: Callable[..., Loop]) -> None:
    hub = open_hub()
    loop = run_loop(hub)
    client = connect(zmq.REQ, hub.addresses.control)
    assert client.ask("primary", pipeline="kalman")["data"] == {"did": "primary", "pipeline": "kalman"}
    assert client.ask("drain")["ok"] is True
    assert [order.what for order in loop.orders] == ["primary", "drain"]


def test_a_flood_of_requests_is_throttled(open_hub: Open, connect: Connect) -> None:
    # However slow this machine is, 400 requests are too many for the seconds that pass.
    hub = open_hub(Clock(monotonic_ns=lambda: time.monotonic_ns() // 100))
    flooder, other = (connect(zmq.REQ, hub.addresses.control) for _ in range(2))
    outcomes = [flooder.ask("health").get("outcome", "") for _ in range(400)]
    assert "throttled" in outcomes
    assert other.ask("health")["ok"] is True


# --- opening and closing -----------------------------------------------------------------------------------------


def test_addresses_are_free_again_after_a_stop(open_hub: Open, tmp_path: Any) -> None:
    hub = open_hub(follow=f"ipc://{tmp_path}/follow")
    where = hub.addresses
    assert (tmp_path / "follow").stat().st_mode & 0o777 == 0o600
    hub.stop()
    assert not (tmp_path / "follow").exists()
    again = open_hub(sensors=where.sensors, positions=where.positions, control=where.control, follow=where.follow)
    assert again.addresses == where


def test_an_address_in_use_is_named_with_its_holder_and_nothing_stays_open(open_hub: Open) -> None:
    first = open_hub()
    second = Hub(free_ports(control=first.addresses.control), run="run-2", site="office", describe=describe)
    with pytest.raises(PortError, match=r"ports\.control: tcp://127.* is in use: .*holds it"):
        second.start()
    second.stop()


def test_what_was_published_before_the_stop_is_still_delivered(open_hub: Open, connect: Connect) -> None:
    hub = open_hub(heartbeat_s=3600.0)
    hub.publish([said()])
    listener = subscriber(connect, hub, b"device/")
    assert frames(listener)[1] == 1
    hub.publish([said()] * 1_000)
    hub.stop()
    assert [frames(listener)[1] for _ in range(1_000)] == list(range(2, 1_002))


def test_everything_goes_over_ipc_too(open_hub: Open, connect: Connect, tmp_path: Any) -> None:
    names = ("sensors", "positions", "control", "follow")
    hub = open_hub(**{name: f"ipc://{tmp_path}/{name}" for name in names})
    phone = connect(zmq.REQ, hub.addresses.sensors)
    phone.send(pressure())
    hub.answer(*take(hub, 1), ReplyOutcome.ACCEPTED)
    assert phone.hear()["outcome"] == "accepted"
    assert connect(zmq.REQ, hub.addresses.control).ask("health")["ok"] is True


def test_settings_say_which_limit_makes_no_sense() -> None:
    with pytest.raises(Exception, match=r"ports\.queue_messages: found 0"):
        PortSettings(queue_messages=0)
    with pytest.raises(Exception, match=r"ports\.peer\.byte_burst: found 10; expected at least"):
        PortSettings(peer=PeerLimits(byte_burst=10))


def test_a_follow_port_may_be_left_closed(open_hub: Open, connect: Connect) -> None:
    hub = open_hub(follow="")
    assert hub.addresses.follow == ""
    hub.follow([(b"event", 1, b"bytes")])
    assert connect(zmq.REQ, hub.addresses.control).ask("subscribe_info")["data"]["follow"] == ""
