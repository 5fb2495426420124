"""An engine reduced to its ports: a real hub, a loop that answers, and clients of every kind."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import zmq

from tickfix.ports import ControlCommand, Hub, InboundMessage, PortAddresses, PortSettings
from tickfix.ports.authentication import KeyPair, create_key_pair, read_key_pair
from tickfix.wire import ReplyOutcome

PATIENCE_MS = 30_000
"""How long a test waits for what must come; nothing here waits for time to pass."""


def free_ports(**settings: Any) -> PortSettings:
    """Return settings on free ports of this machine."""
    free = dict.fromkeys(("sensors", "positions", "control", "follow"), "tcp://127.0.0.1:*")
    return PortSettings(**(free | settings))


def all_done(hub: Hub) -> None:
    """Wait until the thread of the ports has done what it was told so far, and noted all that was taken from it."""
    done = threading.Event()
    hub._call_queue.add(done.set)  # errands are run in their order, and rounds begin with them
    assert done.wait(PATIENCE_MS / 1000)


@dataclass
class Loop:
    """A loop that accepts whatever comes, until it is held."""

    hub: Hub
    outcome: Callable[[InboundMessage], ReplyOutcome] = lambda _: ReplyOutcome.ACCEPTED
    taken: list[InboundMessage] = field(default_factory=list)
    orders: list[ControlCommand] = field(default_factory=list)
    ended: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        while not self.ended.is_set():
            for item in self.hub.take(0.02):
                if isinstance(item, ControlCommand):
                    self.orders.append(item)
                    item.reply(True, {"did": item.what, **item.args})
                else:
                    self.taken.append(item)
                    self.hub.answer(item, self.outcome(item))


@dataclass
class Client:
    """A socket of any kind, with keys or without; received maps are unpacked.

    Attributes:
        events: of libzmq, to be noted on ``monitor`` from before the first connection on.
    """

    context: zmq.Context[Any]
    kind: int
    address: str
    keys: tuple[KeyPair, str] | None = None
    routing_id: bytes = b""
    heard: dict[bytes, int] = field(default_factory=dict)
    events: int = 0

    def __post_init__(self) -> None:
        self.socket = self.context.socket(self.kind)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.setsockopt(zmq.RCVTIMEO, PATIENCE_MS)
        self.socket.setsockopt(zmq.SNDTIMEO, PATIENCE_MS)
        self.socket.setsockopt(zmq.RECONNECT_IVL, 10)
        if self.routing_id:
            self.socket.setsockopt(zmq.ROUTING_ID, self.routing_id)
        if self.keys is not None:
            pair, server = self.keys
            self.socket.curve_publickey = pair.public.encode()
            self.socket.curve_secretkey = pair.secret.encode()
            self.socket.curve_serverkey = server.encode()
        self.monitor = self.socket.get_monitor_socket(self.events) if self.events else None
        self.socket.connect(self.address)

    def close(self) -> None:
        if self.monitor is not None:
            self.socket.disable_monitor()
            self.monitor.close(0)
        self.socket.close(0)

    def send(self, *frames: bytes) -> None:
        self.socket.send_multipart(frames)

    def tell(self, kind: str, **fields: Any) -> None:
        self.send(message(kind, **fields))

    def hear(self) -> dict[str, Any]:
        return dict(msgspec.msgpack.decode(self.socket.recv_multipart()[-1]))

    def ask(self, what: str, **args: Any) -> dict[str, Any]:
        self.tell("request", what=what, args=args)
        return self.hear()

    def hears_nothing_for(self, ms: int) -> bool:
        return not self.socket.poll(ms)


def message(kind: str, **fields: Any) -> bytes:
    """Return a message of version 1."""
    return msgspec.msgpack.encode({"v": 1, "type": kind} | fields)


def pressure(device: str = "p", **fields: Any) -> bytes:
    """Return the smallest useful message."""
    return message("pressure", **({"device": device, "t_ns": 1, "pressure_hpa": 1000.0} | fields))


def make_keys(folder: Path, *names: str) -> dict[str, KeyPair]:
    """Make keys for an engine and others."""
    return {name: read_key_pair(create_key_pair(name, folder).with_suffix(".key")) for name in ("engine", *names)}


def allow(folder: Path, *entries: Mapping[str, Any]) -> None:
    """Write the allow-list, as a whole."""
    lines = []
    for entry in entries:
        lines.append("[[allow]]")
        lines += [f"{key} = {msgspec.json.encode(value).decode()}" for key, value in entry.items()]
    (folder / "new").write_text("\n".join(lines) + "\n")
    (folder / "new").replace(folder / "allowed.toml")


__all__ = [
    "PATIENCE_MS",
    "Client",
    "Loop",
    "PortAddresses",
    "all_done",
    "allow",
    "free_ports",
    "make_keys",
    "message",
    "pressure",
]
