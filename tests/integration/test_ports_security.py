"""Who is let in: keys, the allow-list, what a key is bound to, and addresses that others can reach."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import zmq
from ports_lab import PATIENCE_MS, Client, all_done, allow, free_ports, make_keys, message, pressure

from tickfix.api import ConfigError
from tickfix.api.errors import PortError
from tickfix.ports import Hub, PortSettings, Publication
from tickfix.ports.authentication import KeyPair
from tickfix.ports.sockets import OLDEST_LIBZMQ, check_libzmq
from tickfix.wire import ReplyOutcome

ALL = ["sensors", "positions", "control", "follow"]
CLOSED = (
    zmq.EVENT_HANDSHAKE_FAILED_AUTH
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_DISCONNECTED
)
"""What libzmq notes when it gives a connection up."""


def describe(what: str, args: Any) -> Any:
    return what


class Guarded:
    """An engine with keys, and clients that have some."""

    def __init__(self, folder: Path, *names: str, **settings: Any) -> None:
        self.folder = folder
        self.keys = make_keys(folder, *names)
        self.settings = settings
        self.context = zmq.Context()
        self.clients: list[Client] = []

    def allow(self, **devices_and_ports: tuple[list[str], list[str]]) -> None:
        allow(
            self.folder,
            *(
                {"name": name, "key": self.keys[name].public, "devices": devices, "ports": ports}
                for name, (devices, ports) in devices_and_ports.items()
            ),
        )

    def open(self) -> Hub:
        settings = free_ports(keys=self.folder, heartbeat_s=3600.0, **self.settings)
        self.hub = Hub(settings, run="run-1", site="office", describe=describe)
        self.hub.start()
        return self.hub

    def client(self, kind: int, port: str, name: str | None, server: str | None = None) -> Client:
        keys: tuple[KeyPair, str] | None = None
        if name is not None:
            keys = (self.keys[name], server or self.keys["engine"].public)
        self.clients.append(Client(self.context, kind, getattr(self.hub.addresses, port), keys, events=CLOSED))
        return self.clients[-1]

    def refusals(self, port: str) -> int:
        return int(self.hub.counters()["keys"]["refused"].get(port, 0))

    def close(self) -> None:
        for client in self.clients:
            client.close()
        self.context.term()
        self.hub.stop()


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[Callable[..., Guarded]]:
    made: list[Guarded] = []

    def make(*names: str, **settings: Any) -> Guarded:
        made.append(Guarded(tmp_path / "keys", *names, **settings))
        return made[-1]

    yield make
    for one in made:
        one.close()


def answered(hub: Hub, client: Client, body: bytes) -> dict[str, Any]:
    """Send a message and answer whatever comes of it with ``accepted``, until the client has heard something."""
    client.send(body)
    for _ in range(PATIENCE_MS // 10):
        for item in hub.take(0.01):
            hub.answer(item, ReplyOutcome.ACCEPTED)
        if client.socket.poll(0):
            return client.hear()
    raise AssertionError("no answer")


def closed(client: Client) -> None:
    """Wait until libzmq gives a connection up."""
    assert client.monitor is not None
    assert client.monitor.poll(PATIENCE_MS)


def test_a_key_comes_in_where_the_list_says_and_speaks_for_its_devices_only(guarded: Callable[..., Guarded]) -> None:
    engine = guarded("phone", "desk")
    engine.allow(phone=(["phone-*"], ["sensors"]), desk=([], ["control", "positions"]))
    hub = engine.open()
    phone = engine.client(zmq.REQ, "sensors", "phone")
    assert answered(hub, phone, pressure("phone-1"))["outcome"] == "accepted"
    refused = answered(hub, phone, pressure("watch-1"))
    assert (refused["outcome"], refused["field"], refused["found"]) == ("unauthorised", "device", "'watch-1'")
    assert "phone-*" in refused["expected"]
    for kind in ("fix", "truth"):
        body = message(kind, device="watch-1", t_ns=1, floor="F1", xy=[0.0, 0.0])
        assert answered(hub, phone, body)["outcome"] == "unauthorised"
    assert engine.client(zmq.REQ, "control", "desk").ask("health")["data"] == "health"
    intake = hub.counters()["intake"]
    assert set(intake["peers"]) == {"phone"}
    assert {k: n for k, n in intake["outcomes"].items() if n} == {"accepted": 1, "unauthorised": 3}


@pytest.mark.parametrize("port", ALL)
def test_strangers_get_no_further_than_the_handshake(guarded: Callable[..., Guarded], port: str) -> None:
    engine = guarded("known", "stranger")
    engine.allow(known=(["*"], [p for p in ALL if p != port]))
    engine.open()
    kind = zmq.SUB if port in ("positions", "follow") else zmq.DEALER
    for name in ("stranger", "known"):
        before = engine.refusals(port)
        client = engine.client(kind, port, name)
        closed(client)
        assert engine.refusals(port) > before
    assert engine.hub.counters()["keys"]["admitted"] == {}


def test_without_keys_or_with_the_wrong_engine_key_nobody_gets_in(guarded: Callable[..., Guarded]) -> None:
    engine = guarded("phone", "other")
    engine.allow(phone=(["*"], ALL))
    hub = engine.open()
    plain = engine.client(zmq.DEALER, "sensors", None)
    plain.send(pressure())
    closed(plain)
    mistaken = engine.client(zmq.DEALER, "sensors", "phone", server=engine.keys["other"].public)
    mistaken.send(pressure())
    # The engine drops a handshake made for another key without a word; what counts is that nothing comes in.
    phone = engine.client(zmq.REQ, "sensors", "phone")
    assert answered(hub, phone, pressure())["outcome"] == "accepted"
    assert hub.counters()["intake"]["received"] == 1


def test_a_list_that_grows_lets_in_and_one_that_shrinks_shuts_out_at_once(guarded: Callable[..., Guarded]) -> None:
    engine = guarded("phone", "second")
    engine.allow(phone=(["*"], ["sensors"]))
    hub = engine.open()
    phone = engine.client(zmq.REQ, "sensors", "phone")
    assert answered(hub, phone, pressure())["outcome"] == "accepted"
    engine.allow(second=(["*"], ["sensors"]))
    second = engine.client(zmq.REQ, "sensors", "second")
    assert answered(hub, second, pressure("q"))["outcome"] == "accepted"
    refused = answered(hub, phone, pressure())
    assert (refused["outcome"], refused["field"]) == ("unauthorised", "key")
    assert hub.counters()["intake"]["outcomes"]["unauthorised"] == 1


def test_a_key_exchanged_under_its_name_takes_the_old_ones_rights(guarded: Callable[..., Guarded]) -> None:
    engine = guarded("phone", "new")
    engine.allow(phone=(["*"], ["sensors"]))
    hub = engine.open()
    old = engine.client(zmq.REQ, "sensors", "phone")
    assert answered(hub, old, pressure())["outcome"] == "accepted"
    engine.keys["phone"] = engine.keys["new"]
    engine.allow(phone=(["*"], ["sensors"]))
    new = engine.client(zmq.REQ, "sensors", "phone")
    assert answered(hub, new, pressure())["outcome"] == "accepted"
    assert answered(hub, old, pressure())["outcome"] == "unauthorised"


def test_a_listener_whose_key_is_withdrawn_is_cut_off_and_the_others_come_back(
    guarded: Callable[..., Guarded],
) -> None:
    engine = guarded("good", "bad")
    engine.allow(good=([], ["positions"]), bad=([], ["positions"]))
    hub = engine.open()
    hub.publish([Publication("estimate", "office", "F1", "p", "fusion", b"1")])
    all_done(hub)
    heard = []
    for name in ("good", "bad"):
        heard.append(engine.client(zmq.SUB, "positions", name))
        heard[-1].socket.subscribe(b"device/")
        for listener in heard:  # a repetition for one is heard by all
            assert listener.socket.recv_multipart()[2] == b"1"
    good, bad = heard
    engine.allow(good=([], ["positions"]))
    closed(bad)
    assert good.socket.recv_multipart()[2] == b"1"  # the last value again: it has come back
    hub.publish([Publication("estimate", "office", "F1", "p", "fusion", b"2")])
    assert good.socket.recv_multipart()[2] == b"2"
    closed(engine.client(zmq.SUB, "positions", "bad"))
    assert engine.refusals("positions") >= 1
    assert not bad.socket.poll(0)


def test_with_keys_limits_are_the_keys_not_the_connections(guarded: Callable[..., Guarded]) -> None:
    engine = guarded("phone", "gateway", takeover_s=3600.0)
    allow(
        engine.folder,
        {"name": "phone", "key": engine.keys["phone"].public, "devices": ["*"], "ports": ALL,
         "most_devices": 2, "messages_per_s": 100},
        {"name": "gateway", "key": engine.keys["gateway"].public, "devices": ["*"], "ports": ALL},
    )  # fmt: skip
    hub = engine.open()
    one, two = (engine.client(zmq.REQ, "sensors", "phone") for _ in range(2))
    assert answered(hub, one, pressure("a"))["outcome"] == "accepted"
    assert answered(hub, two, pressure("a"))["outcome"] == "accepted"  # the same key: the same speaker
    assert answered(hub, two, pressure("b"))["outcome"] == "accepted"
    assert answered(hub, one, pressure("c"))["outcome"] == "busy"
    other = engine.client(zmq.REQ, "sensors", "gateway")
    assert answered(hub, other, pressure("c"))["outcome"] == "accepted"
    assert answered(hub, other, pressure("a"))["outcome"] == "unauthorised"


def test_addresses_that_others_can_reach_need_keys(tmp_path: Path) -> None:
    for address in ("tcp://0.0.0.0:5571", "tcp://*:*", "tcp://10.0.0.1:5571", "tcp://[::]:5571"):
        with pytest.raises(ConfigError, match=r"ports\.follow: .*`tickfix keys new engine --folder keys`"):
            Hub(free_ports(follow=address), run="r", site="s", describe=describe)
    make_keys(tmp_path)
    settings = replace(free_ports(sensors="tcp://0.0.0.0:*"), keys=tmp_path)
    hub = Hub(settings, run="r", site="s", describe=describe)
    assert hub.start().sensors.startswith("tcp://0.0.0.0:")
    hub.stop()


def test_keys_that_cannot_be_used_are_named_before_anything_is_opened(tmp_path: Path) -> None:
    with pytest.raises(PortError, match=r"engine\.key: cannot be read"):
        Hub(PortSettings(keys=tmp_path), run="r", site="s", describe=describe)
    make_keys(tmp_path)
    (tmp_path / "engine.key").chmod(0o644)
    with pytest.raises(PortError, match="chmod 600"):
        Hub(PortSettings(keys=tmp_path), run="r", site="s", describe=describe)


def test_a_libzmq_with_known_holes_is_refused() -> None:
    check_libzmq(OLDEST_LIBZMQ)
    check_libzmq((4, 4, 0))
    for version in ((4, 3, 3), (4, 2, 99), (3, 9, 9)):
        with pytest.raises(PortError, match="has known holes"):
            check_libzmq(version)
    with pytest.raises(PortError, match="without CURVE"):
        check_libzmq(OLDEST_LIBZMQ, curve=False)
