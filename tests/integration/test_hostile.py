"""Messages that no honest phone sends, by the thousand: the engine goes on, and its books balance."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import zmq
from live_lab import Lab, adds_up, outcome

MESSAGES = int(os.environ.get("TICKFIX_HOSTILE", "6000"))
CONFIG = """
[pipelines.kalman]
pdr = "steps"
fingerprint = "wknn"
filter = "kalman"
[ports.peer]
messages_per_s = 1e9
message_burst = 1000000000
bytes_per_s = 1e12
byte_burst = 1000000000000
"""
HOSTILE: list[Any] = [
    None,
    True,
    -1,
    2**63,
    2**64 - 1,
    1e308,
    float("nan"),
    float("inf"),
    "",
    "x" * 300,
    b"",
    b"\0" * 7,
    [],
    {},
    [[]],
]


@pytest.fixture
def lab(site: Path, tmp_path: Path) -> Iterator[Lab]:
    lab = Lab(site, tmp_path)
    yield lab
    lab.end()


def good(rng: np.random.Generator) -> dict[str, Any]:
    """Return one of the messages that a phone sends."""
    t_ns = int(rng.integers(0, 2**62))
    head = {
        "v": 1,
        "device": f"evil-{rng.integers(8)}",
        "session": "s",
        "seq": int(rng.integers(0, 2**40)),
        "ack": True,
    }
    kinds: list[dict[str, Any]] = [
        {"type": "hello", "sensors": {"accelerometer": 50.0}},
        {"type": "motion", "sensors": {"accelerometer": {"t_ns": [t_ns, t_ns + 1], "values": [[0.0, 0.0, 9.8]] * 2}}},
        {"type": "motion", "sensors": {"gyroscope": {"t_ns": rng.bytes(16), "values": rng.bytes(48)}}},
        {"type": "scan", "transmitters": ["a", "b"], "rssi_dbm": [-50.0, -60.0], "heard_ns": [t_ns, t_ns - 5]},
        {"type": "pressure", "t_ns": t_ns, "pressure_hpa": 1000.0},
        {"type": "fix", "t_ns": t_ns, "floor": "F1", "xy": [1.0, 2.0], "covariance": [[1.0, 0.0], [0.0, 1.0]]},
        {"type": "truth", "t_ns": t_ns, "floor": "F1", "xy": [1.0, 2.0]},
        {"type": "bye"},
    ]
    return head | kinds[int(rng.integers(len(kinds)))]


def spoilt(message: Any, rng: np.random.Generator) -> Any:
    """Return the message with something wrong, somewhere."""
    if isinstance(message, dict) and message and rng.random() < 0.8:
        name = list(message)[int(rng.integers(len(message)))]
        if rng.random() < 0.2:
            return {key: value for key, value in message.items() if key != name}
        return message | {name: spoilt(message[name], rng)}
    if isinstance(message, list) and message and rng.random() < 0.6:
        return [*message[:-1], spoilt(message[-1], rng)]
    return HOSTILE[int(rng.integers(len(HOSTILE)))]


def hostile(rng: np.random.Generator) -> list[bytes]:
    """Return the frames of a message that nobody should send."""
    kind = rng.integers(8)
    packed = msgspec.msgpack.encode(spoilt(good(rng), rng))
    if kind == 0:
        return [rng.bytes(int(rng.integers(0, 400)))]
    if kind == 1:
        return [packed[: int(rng.integers(0, len(packed)))]]
    if kind == 2:
        flipped = bytearray(packed or b"\0")
        flipped[int(rng.integers(len(flipped)))] ^= 1 << int(rng.integers(8))
        return [bytes(flipped)]
    if kind == 3:
        deep = b"\x81\xa1x" * int(rng.integers(1, 3000)) + b"\xc0"
        return [msgspec.msgpack.encode(good(rng))[:-1] + deep if rng.random() < 0.5 else deep]
    if kind == 4:
        return [packed] * int(rng.integers(2, 6))
    if kind == 5:
        return [b"", packed]
    return [packed]


def test_hostile_messages_are_refused_and_counted_one_by_one(lab: Lab, floor_folder: Path) -> None:
    engine = lab.serve(CONFIG, "--journal", lab.place / "journal")
    rng = np.random.default_rng(11)
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    with context.socket(zmq.DEALER) as peer:
        peer.linger = 0
        peer.sndtimeo = 10_000
        peer.rcvhwm = 10
        peer.connect(engine.at["sensors"])
        for _ in range(MESSAGES):
            try:
                peer.send_multipart(hostile(rng))
            except zmq.Again:
                pytest.fail(f"the engine takes nothing any more: {engine.lines} {''.join(engine.errors)}")
            while peer.poll(0):
                peer.recv_multipart()
        with engine.control() as control:
            outcomes = adds_up(control, at_least=MESSAGES)
            assert control.counters()["ports"]["errors"] == {}
    context.term()
    assert outcomes["malformed"] > MESSAGES / 4
    walk = min((floor_folder / "path_data_files").glob("*.txt"))
    assert outcome(lab.send(engine, walk, "--speed", "0"))["unknown"] == 0
    with engine.control() as control:
        assert control.health()["ok"]
        print(f"{MESSAGES} hostile messages:", control.status()["intake"])
    engine.stop()
