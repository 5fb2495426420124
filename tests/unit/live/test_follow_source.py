"""A follower on real sockets: it takes over the leader's decisions in the leader's order, and counts what it missed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import groupby

import numpy as np
import pytest

from tickfix import config
from tickfix.api import Context, MotionSamples, Samples, Scan
from tickfix.kernel import KernelSettings
from tickfix.live.engine import Engine
from tickfix.live.follower import FollowSource, Leader
from tickfix.live.publisher import WriteAheadBuffer
from tickfix.live.replica import Replica
from tickfix.live.serve_options import LiveSettings
from tickfix.ports import Hub, PortSettings
from tickfix.registry import discover
from tickfix.wire import encode_event
from tickfix.wire.engine_messages import AdmitScan, FinishDevice, RunDevice, encode_decision

S = 1_000_000_000
ANY = "tcp://127.0.0.1:*"
CONFIG = '[pipelines.k]\npdr = "steps"\nfilter = "kalman"\n'
ROUNDS = 500
"""A subscription needs its time to arrive; each round waits for records up to 0.2 s."""


class Pair:
    """A leader's ports, and an engine that follows them."""

    def __init__(self) -> None:
        pipelines = config.build_pipelines(
            config.parse_config(CONFIG, "test", discover()).pipelines, Context(floors={}), {}
        )
        self.leader = Hub(
            PortSettings(sensors=ANY, positions=ANY, control=ANY, follow=ANY), run="l", site="s", describe=lambda *_: {}
        )
        self.own = Hub(
            PortSettings(sensors=ANY, positions=ANY, control=ANY, follow=""), run="f", site="s", describe=lambda *_: {}
        )
        self.leader.start()
        self.own.start()
        self.source = FollowSource(Leader(self.leader.addresses.follow), self.own)
        write_ahead = WriteAheadBuffer(None, self.own)
        self.journaled: list[str] = []
        decision, estimate = write_ahead.decision, write_ahead.estimate
        write_ahead.decision = lambda what, *rest: (  # type: ignore[method-assign]
            self.journaled.append(type(what).__name__),
            decision(what, *rest),
        )[1]
        write_ahead.estimate = lambda encoded: (  # type: ignore[method-assign]
            self.journaled.append("estimate"),
            estimate(encoded),
        )[1]
        self.engine = Engine(
            self.source,
            Replica(pipelines, KernelSettings()),
            self.own,
            write_ahead,
            LiveSettings(),
            site="s",
            names=["k"],
        )
        self.number = 0

    def publish(self, *records: tuple[bytes, bytes]) -> None:
        numbered = []
        for kind, body in records:
            self.number += 1
            numbered.append((kind, self.number, body))
        self.leader.follow(numbered)

    def rounds_until(self, happened: Callable[[], bool]) -> None:
        for _ in range(ROUNDS):
            if happened():
                return
            self.engine._round(self.source.receive(self.engine))
        raise AssertionError(f"it never happened: {self.source.counts}, {self.journaled}")

    def join(self) -> None:
        """Publish motion of a device of its own until some has arrived."""
        for n in range(ROUNDS):
            self.publish(motion("probe", float(n)))
            self.engine._round(self.source.receive(self.engine))
            if self.source.counts["records"]:
                return
        raise AssertionError("the follower never subscribed")

    def close(self) -> None:
        self.source.close()
        self.leader.stop()
        self.own.stop()


@pytest.fixture
def pair() -> Iterator[Pair]:
    pair = Pair()
    yield pair
    pair.close()


def motion(device: str, from_s: float) -> tuple[bytes, bytes]:
    t_ns = np.array([round((from_s + n / 50) * S) for n in range(50)], np.int64)
    event = MotionSamples(sensors={"accelerometer": Samples(t_ns, np.ones((50, 3)))}, device=device)
    return b"event", encode_event(event)


def test_decisions_are_taken_over_in_the_order_in_which_the_leader_made_them(pair: Pair) -> None:
    pair.join()
    scan = Scan(transmitters=("a",), rssi_dbm=np.array([-60.0]), heard_ns=np.array([101 * S]), t_ns=101 * S, device="d")
    pair.publish(
        motion("d", 100.0),
        (b"decision", encode_decision(RunDevice(device="d"))),
        (b"event", encode_event(scan)),
        (b"decision", encode_decision(AdmitScan(number=pair.number + 3))),
        (b"decision", encode_decision(AdmitScan(number=10**6))),
        (b"decision", encode_decision(FinishDevice(device="d", reason="bye"))),
    )
    pair.rounds_until(lambda: "FinishDevice" in pair.journaled)
    kinds = [kind for kind, _ in groupby(pair.journaled)]
    assert kinds == ["RunDevice", "estimate", "AdmitScan", "FinishDevice", "estimate"]
    report = pair.engine.report()
    assert report["replication"]["orphaned_decisions"] == 1
    assert report["leader_run"] == "l"
    assert [one["device"] for one in pair.engine.devices(10)] == ["probe"]


def test_a_record_that_cannot_be_decoded_is_counted_and_logged(pair: Pair, caplog: pytest.LogCaptureFixture) -> None:
    pair.join()
    pair.publish((b"decision", b"nonsense"), motion("d", 100.0))
    pair.rounds_until(lambda: pair.source.counts["malformed"] > 0)
    assert pair.engine.report()["replication"]["malformed"] == 1
    assert [vars(record)["code"] for record in caplog.records] == ["record_malformed"]
