"""Rounds of the loop, one by one, with real ports and a real replica."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from prometheus_client.parser import text_string_to_metric_families

from tickfix import config
from tickfix.api import Context, Event, MotionSamples, Pressure, Samples, Scan
from tickfix.kernel import KernelSettings
from tickfix.kernel.device import Device
from tickfix.live.engine import Engine
from tickfix.live.engine_status import EngineStatus
from tickfix.live.localization import LocatorThreads
from tickfix.live.publisher import WriteAheadBuffer
from tickfix.live.replica import Replica
from tickfix.live.sensor_source import SensorSource
from tickfix.live.serve_options import LiveSettings
from tickfix.ports import ASK_LOOP, Clock, ControlCommand, Hub, InboundMessage, Peer, PeerLimits, PortSettings
from tickfix.ports.peers import PeerState
from tickfix.registry import discover
from tickfix.wire import Bye
from tickfix.wire.engine_messages import RunDevice

S = 1_000_000_000
CONFIG = '[pipelines.k]\npdr = "steps"\nfilter = "kalman"\n'
ANY = "tcp://127.0.0.1:*"
STATIC = {"run": "r", "site": "s", "version": "0", "pipelines": [{"name": "k"}], "notes": []}


class ManualTime:
    """Time that stands still until a test moves it."""

    def __init__(self) -> None:
        self.now_ns = 10 * S
        self.clock = Clock(monotonic_ns=lambda: self.now_ns)


class Rounds:
    """An engine that goes round when it is told to; nothing comes in by its ports."""

    def __init__(self, clock: Clock | None = None) -> None:
        pipelines = config.build_pipelines(
            config.parse_config(CONFIG, "test", discover()).pipelines, Context(floors={}), {}
        )
        self.replica = Replica(pipelines, KernelSettings())
        ports = PortSettings(sensors=ANY, positions=ANY, control=ANY, follow="")
        self.hub = Hub(ports, run="r", site="s", describe=lambda _, __: {})
        self.hub.start()
        self.locator = LocatorThreads(self.replica.kernel.fingerprint_requests, self.hub.wake)
        self.status = EngineStatus(STATIC, clock)
        self.source = SensorSource(self.hub, self.locator, LiveSettings())
        self.engine = Engine(
            self.source,
            self.replica,
            self.hub,
            WriteAheadBuffer(None, self.hub),
            LiveSettings(),
            site="s",
            names=["k"],
            status=self.status,
        )
        self._peer = Peer(PeerState("p", None, PeerLimits(), 0), b"nobody", delimited=False)

    def ask(self, what: str) -> Any:
        """Ask as the control port does; whatever is left to the loop is answered in a round."""
        answer = self.status.describe(what, {})
        if answer is ASK_LOOP:
            answers: list[Any] = []
            self.engine._round([ControlCommand(what, {}, lambda ok, data: answers.append((ok, data)))])
            ((ok, answer),) = answers
            assert ok
        return answer

    def round(self, *events: Event | Bye) -> None:
        self.engine._round([InboundMessage(event, self._peer, False, time.monotonic_ns()) for event in events])

    @property
    def outcomes(self) -> dict[str, int]:
        found: dict[str, int] = self.hub.counters()["intake"]["outcomes"]
        return {outcome: n for outcome, n in found.items() if n}

    def close(self) -> None:
        self.locator.stop()
        self.hub.stop()


@pytest.fixture
def rounds() -> Iterator[Rounds]:
    rounds = Rounds()
    yield rounds
    rounds.close()


def motion(device: str, times_s: list[float], sensor: str = "accelerometer", seq: int = 0) -> MotionSamples:
    t_ns = np.array([round(t * S) for t in times_s], np.int64)
    columns = 1 if sensor == "pressure" else 3
    sensors = {sensor: Samples(t_ns, np.ones((len(t_ns), columns)))}
    return MotionSamples(sensors=sensors, device=device, session="s", seq=seq)


def test_a_goodbye_of_one_leaves_nothing_undone_of_another_whose_clock_began_anew(rounds: Rounds) -> None:
    rounds.round(motion("a", [100.0, 100.5, 101.0]), motion("b", [100.0]))
    anew = motion("a", [9000.0, 9001.0, 9002.5])
    rounds.round(anew, Bye(v=1, device="b"))
    assert rounds.replica.snapshot()
    assert rounds.replica.progress_by_device()["a"].epoch == 1
    assert list(rounds.replica.progress_by_device()) == ["a"]


def test_what_one_message_makes_due_is_folded_over_many_rounds_and_more_is_put_off(rounds: Rounds) -> None:
    bomb = motion("bomb", [59.0 * n for n in range(4_000)], "pressure")
    rounds.round(bomb)
    ticks = []
    for n in range(60):
        rounds.round(motion("good", [10.0 + n / 5]))
        ticks.append(rounds.engine.report()["ticks"])
    assert max(np.diff(ticks)) < 300
    assert rounds.engine.report()["ticks"] > 3_000
    assert rounds.replica.progress_by_device()["good"].backlog == 0
    before = rounds.outcomes.get("busy", 0)
    bombs = [replace(bomb, sensors={"pressure": Samples(one.t_ns + shift, one.values)}) for one, shift in again(bomb)]
    rounds.round(*bombs)
    rounds.round(*bombs)
    assert rounds.outcomes["busy"] > before
    assert rounds.engine.report()["deferred"] > 0
    rounds.round(Bye(v=1, device="bomb"))
    assert "bomb" in rounds.replica.progress_by_device()


def again(bomb: MotionSamples) -> list[tuple[Samples, int]]:
    return [(bomb.sensors["pressure"], n * 649 * S) for n in range(1, 8)]


def test_more_scans_than_can_wait_are_put_off(rounds: Rounds) -> None:
    def scan(n: int) -> Scan:
        t_ns = 100 * S + n
        heard_ns = np.array([t_ns], np.int64)
        return Scan(transmitters=("a",), rssi_dbm=np.array([-60.0]), heard_ns=heard_ns, device="d", session="s", seq=n)

    for n in range(1, 400):
        rounds.source.admit(InboundMessage(scan(n), rounds._peer, False, 0), rounds.engine, 0)
        rounds.engine.execute()
    assert rounds.outcomes == {"busy": 399 - 256}


def test_a_message_that_cannot_be_written_down_is_answered_and_ends_nothing(
    rounds: Rounds, caplog: pytest.LogCaptureFixture
) -> None:
    rounds.round(Pressure(t_ns=2**70, pressure_hpa=1.0, device="d"), motion("good", [1.0]))
    rounds.round(motion("good", [1.2]))
    assert rounds.outcomes == {"accepted": 2, "malformed": 1}
    (record,) = caplog.records
    assert "could not be taken in: WireError" in record.getMessage()
    assert (record.name, vars(record)["code"], vars(record)["device"]) == (
        "tickfix.live.sensor_source",
        "message_failed",
        "d",
    )
    assert rounds.engine.report()["errors"] == 1


def test_a_device_that_the_kernel_lost_is_forgotten_by_the_loop(
    rounds: Rounds, monkeypatch: pytest.MonkeyPatch
) -> None:
    rounds.round(motion("d", [1.0]), motion("good", [1.0]))
    honest = Device.run

    def broken(device: Device, tick: int | None = None, max_ticks: int | None = None) -> Any:
        if device._device == "d" and device.number == 0:
            raise ZeroDivisionError
        return (yield from honest(device, tick, max_ticks))

    monkeypatch.setattr(Device, "run", broken)
    journaled: list[object] = []
    monkeypatch.setattr(WriteAheadBuffer, "decision", lambda _, decision, *__: journaled.append(decision))
    rounds.round(motion("d", [1.5]), motion("good", [1.5]))
    assert [one.device for one in journaled if isinstance(one, RunDevice)] == ["d", "good"]
    assert rounds.replica.kernel.devices == ("good",)
    assert [one["device"] for one in rounds.engine.devices(10)] == ["good"]
    assert rounds.engine.report()["failures"] == {"device quarantined: ZeroDivisionError": 1}
    rounds.round(motion("d", [2.0]), motion("good", [2.0]))
    assert rounds.replica.progress_by_device()["d"].epoch == 1


def test_status_is_collected_only_when_it_is_asked_for_and_at_most_five_times_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    time = ManualTime()
    rounds = Rounds(time.clock)
    collected: list[str] = []
    report, devices = rounds.engine.report, rounds.engine.devices
    monkeypatch.setattr(rounds.engine, "report", lambda: collected.append("report") or report())
    monkeypatch.setattr(rounds.engine, "devices", lambda most: collected.append("devices") or devices(most))
    for n in range(20):
        time.now_ns += S
        rounds.round(motion("d", [1.0 + n / 5]))
    assert collected == []
    status = rounds.ask("status")
    assert (status["devices"], status["pipelines"]) == (1, [{"name": "k", "primary": True, "state": "running"}])
    assert rounds.ask("counters")["engine"]["ticks"] == status["ticks"] > 10
    assert collected == ["report"]
    assert [one["device"] for one in rounds.ask("devices")] == ["d"]
    assert collected == ["report", "devices"]
    time.now_ns += S // 5
    rounds.round(motion("d", [6.0]))
    assert rounds.ask("status")["ticks"] > status["ticks"]
    assert collected == ["report", "devices", "report"]
    rounds.close()


def test_a_loop_that_hangs_is_reported_and_its_last_status_is_answered() -> None:
    time = ManualTime()
    rounds = Rounds(time.clock)
    rounds.round(motion("d", [1.0, 2.0]))
    assert rounds.ask("health") == {"ok": True, "problems": [], "loop_age_s": 0.0}
    status = rounds.ask("status")
    time.now_ns += S
    assert rounds.status.describe("status", {}) is ASK_LOOP
    time.now_ns += 2 * S
    assert rounds.status.describe("status", {})["ticks"] == status["ticks"]
    assert rounds.ask("health")["problems"] == ["the loop has been silent for 3.0 s"]
    with pytest.raises(ValueError, match="what: found 'weather'"):
        rounds.ask("weather")
    rounds.close()


def test_metrics_show_the_numbers_of_the_status(rounds: Rounds) -> None:
    for n in range(12):
        rounds.round(motion("d", [1.0 + n / 5]))
    status, text = rounds.ask("status"), rounds.ask("metrics")
    found = {
        sample.name: sample
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if sample.labels in ({}, {"outcome": "accepted"})
    }
    assert found["tickfix_ticks_total"].value == status["ticks"] > 5
    assert found["tickfix_rounds_total"].value >= status["rounds"]
    assert found["tickfix_devices"].value == 1
    assert found["tickfix_tick_latency_seconds_count"].value == status["tick_latency_ms"]["count"] == status["ticks"]
    assert found["tickfix_tick_latency_seconds_sum"].value > 0
    assert found["tickfix_overloaded"].value == 0
    accepted = found["tickfix_measurements_total"]
    assert (accepted.labels, accepted.value) == ({"outcome": "accepted"}, status["measurements"]["accepted"])
