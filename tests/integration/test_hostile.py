"""Messages that no honest phone sends, by the thousand: the engine goes on, and its books balance."""

from __future__ import annotations

import contextlib
import itertools
import os
import resource
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import zmq
from live_lab import Engine, Lab, adds_up, estimates, outcome, until
from stored_floor import Command

from tickfix.api import LATEST_NS

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


@contextlib.contextmanager
def dealer(engine: Engine) -> Iterator[zmq.Socket[bytes]]:
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    try:
        with context.socket(zmq.DEALER) as peer:
            peer.linger = 0
            peer.sndtimeo = peer.rcvtimeo = 60_000
            peer.connect(engine.at["sensors"])
            yield peer
    finally:
        context.term()


def said_to(peer: zmq.Socket[bytes], **message: Any) -> dict[str, Any]:
    peer.send(msgspec.msgpack.encode({"v": 1, "device": "wild", "session": "s", "ack": True} | message))
    answer: dict[str, Any] = msgspec.msgpack.decode(peer.recv())
    return answer


END = 2**63 - 1
WILD: list[tuple[dict[str, Any], str]] = [
    ({"type": "pressure", "t_ns": END, "pressure_hpa": 1000.0}, "t_ns"),
    ({"type": "fix", "t_ns": END, "floor": "F1", "xy": [1.0, 2.0]}, "t_ns"),
    ({"type": "truth", "t_ns": END, "floor": "F1", "xy": [1.0, 2.0]}, "t_ns"),
    ({"type": "scan", "t_ns": END, "transmitters": [], "rssi_dbm": [], "heard_ns": []}, "t_ns"),
    ({"type": "scan", "transmitters": ["a"], "rssi_dbm": [-50.0], "heard_ns": [END]}, "heard_ns[0]"),
    ({"type": "motion", "sensors": {"gyroscope": {"t_ns": [END], "values": [[0.0] * 3]}}}, "sensors.gyroscope.t_ns[0]"),
]


def test_times_at_the_end_of_64_bits_are_refused_by_name_and_those_that_count_end_no_engine(
    lab: Lab, tickfix: Command
) -> None:
    journal = lab.place / "journal"
    engine = lab.serve(CONFIG, "--no-watchdog", "--journal", journal)
    with dealer(engine) as peer:
        for seq, (message, field) in enumerate(WILD, 1):
            answer = said_to(peer, seq=seq, **message)
            assert (answer["type"], answer["outcome"], answer["field"]) == ("error", "malformed", field)
            assert (answer["found"], answer["expected"]) == (str(END), f"a time from 0 to {LATEST_NS} ns")
        for n in range(20):
            t_ns = [LATEST_NS - 4 * 10**9 + n * 200_000_000 + k * 20_000_000 for k in range(10)] + [END]
            sensors = {"accelerometer": {"t_ns": t_ns, "values": [[0.0, 0.0, 9.8]] * 11}}
            assert said_to(peer, seq=100 + n, type="motion", sensors=sensors)["outcome"] in {"accepted", "late"}
        at_last = {"t_ns": LATEST_NS, "floor": "F1", "xy": [1.0, 2.0]}
        assert said_to(peer, seq=200, type="fix", **at_last)["outcome"] in {"accepted", "late"}
        with engine.control() as control:
            until(lambda: control.status()["measurements"].get("invalid") == 20)
    engine.stop()
    resumed = lab.serve(CONFIG, "--no-watchdog", "--journal", journal, "--resume")
    with dealer(resumed) as peer:
        assert said_to(peer, seq=200, type="fix", **at_last)["outcome"] == "duplicate"
    resumed.stop()
    assert max(e.t_ns for e in estimates(journal)) < 2**62 + 10**10
    assert "every byte is the same" in tickfix("replay", "--journal", journal).stdout


def bombs() -> Iterator[dict[str, Any]]:
    """Yield single messages that make much work."""
    far = [1_000 * 10**9 + 59 * 10**9 * n for n in range(4_000)]
    yield {"device": "leaps", "type": "motion", "sensors": {"pressure": {"t_ns": far, "values": [[1.0]] * 4_000}}}
    walk = {"t_ns": far[:1], "values": [[0.0, 0.0, 9.8]]}
    yield {"device": "holds", "type": "motion", "sensors": {"accelerometer": walk}}
    yield {"device": "holds", "type": "motion", "sensors": {"pressure": {"t_ns": far, "values": [[1.0]] * 4_000}}}
    yield {"device": "holds", "type": "bye"}
    anew = [n * 100 * 10**9 + k * 10**9 for n in range(1, 1_300) for k in range(3)]
    rows = [[0.0, 0.0, 9.8]] * len(anew)
    yield {"device": "anew", "type": "motion", "sensors": {"gyroscope": {"t_ns": anew, "values": rows}}}
    for n in range(40):
        dense = [5 * 10**9 - n * 4_000 - k for k in range(4_000)]
        yield {
            "device": "crowds",
            "type": "motion",
            "sensors": {"pressure": {"t_ns": dense, "values": [[1.0]] * 4_000}},
        }
    for n in range(300):
        yield {"device": "scans", "type": "scan", "transmitters": [], "rssi_dbm": [], "heard_ns": [], "t_ns": 10**9 - n}


def test_single_messages_that_make_much_work_keep_the_others_from_nothing(lab: Lab, floor_folder: Path) -> None:
    engine = lab.serve(CONFIG + "[live]\nwatchdog_s = 5.0\n", "--journal", lab.place / "journal")
    walk = min((floor_folder / "path_data_files").glob("*.txt"))
    sender = lab.send(engine, walk, "--speed", "3")
    with dealer(engine) as peer, engine.control() as control:
        for seq, bomb in enumerate(bombs(), 1):
            answer = said_to(peer, seq=seq, **bomb)
            assert answer["outcome"] in {"accepted", "late", "stale", "duplicate", "busy"}, answer
        assert outcome(sender)["unknown"] == 0
        status = control.status()
        assert status["run"] == engine.at["run"], "it was restarted"
        assert status["errors"] == 0
        assert status["measurements"]["overflow"] > 0
        assert status["measurements"]["dropped"] > 0
        assert status["overloads"] == 0
        until(lambda: all(d["next_tick"] * 200_000_000 > d["newest_ns"] - 10**9 for d in control.devices()))
    engine.stop()


def test_connections_that_take_all_file_descriptors_end_no_engine(lab: Lab) -> None:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (96, 128))

    config = CONFIG + "[journal]\nsegment_mb = 0.002\n"
    engine = lab.serve(config, "--no-watchdog", "--journal", lab.place / "journal", before=limit)
    host, port = engine.at["sensors"].removeprefix("tcp://").split(":")
    with dealer(engine) as peer, engine.control() as control, contextlib.ExitStack() as crowd:
        assert said_to(peer, type="hello")["type"] == "welcome"
        assert control.health()["ok"]
        numbers = itertools.count(1)

        def send(count: int) -> None:
            for seq in itertools.islice(numbers, count):
                answer = said_to(peer, seq=seq, type="pressure", t_ns=seq * 200_000_000, pressure_hpa=1000.0)
                assert answer["type"] in {"ack", "welcome"}

        def journal_finds_no_file() -> bool:
            # Connections that never greet are dropped after a while: on a slow machine they have to be renewed.
            with contextlib.suppress(TimeoutError):
                for _ in range(200):
                    crowd.enter_context(socket.create_connection((host, int(port)), timeout=1.0))
            send(40)
            return "Too many open files" in control.status()["journal"].get("problem", "")

        until(journal_finds_no_file)
        crowd.close()

        def goes_on() -> bool:
            send(100)
            return "problem" not in control.status()["journal"]

        until(goes_on)
        assert control.health()["ok"]
    engine.stop()
    assert len(list((lab.place / "journal").glob("*.mcap"))) > 1


def test_hostile_messages_are_refused_and_counted_one_by_one(lab: Lab, floor_folder: Path) -> None:
    engine = lab.serve(CONFIG, "--journal", lab.place / "journal")
    rng = np.random.default_rng(11)
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    with context.socket(zmq.DEALER) as peer:
        peer.linger = 0
        peer.sndtimeo = 60_000
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
