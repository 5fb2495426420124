"""Engines, phones and listeners as processes of their own, on real sockets, and what happens when they fail."""

from __future__ import annotations

import json
import os
import resource
import signal
import socket
import threading
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zmq
from live_lab import (
    CALM,
    LIGHT,
    PATIENCE_S,
    WAITING,
    Lab,
    Process,
    adds_up,
    estimates,
    hear,
    last_word,
    lasting_addresses,
    outcome,
    repeats,
    same_in_the_end,
    track_digest,
    until,
)
from stored_floor import Command

from tickfix.client import Listener, Sensor
from tickfix.journal import JournalReader, RecordKind
from tickfix.wire.engine_messages import AdmitScan, FinishDevice, decode_decision

SEED = 7
KILLS = int(os.environ.get("TICKFIX_KILLS", "3"))


@pytest.fixture(scope="session")
def walks(floor_folder: Path) -> list[Path]:
    return sorted((floor_folder / "path_data_files").glob("*.txt"))[:2]


def test_what_is_published_is_in_the_journal_and_repeats_to_the_byte(
    lab: Lab, walks: list[Path], tickfix: Command
) -> None:
    journal = lab.place / "journal"
    engine = lab.serve(LIGHT, "--journal", journal)
    with Listener(engine.at["positions"], ["device/"]) as listener:
        until(lambda: listener.receive(0.05) is None and listener.heartbeat is not None)
        sent = outcome(lab.send(engine, *walks, "--speed", "0"))
        assert sent["unknown"] == 0
        with engine.control() as control:
            status = control.status()
            adds_up(control)
        ended = engine.stop()
        heard = hear(listener, ended["ticks"])
        assert listener.missed == 0
    again = sum(sent["outcomes"].get(outcome, 0) for outcome in ("busy", "throttled"))
    assert sum(sent["outcomes"].values()) - again == sent["messages"] + len(walks)
    assert status["failures"] == {}
    published = [e for e in estimates(journal) if e.revision == 0 and e.pipeline == "kalman"]
    assert ended["ticks"] == len(published) > 100
    in_journal = [(e.device, e.tick, None if e.belief is None else tuple(e.belief.xy.tolist())) for e in published]
    said = [(e["device"], e["tick"], None if e["belief"] is None else tuple(e["belief"]["xy"])) for e in heard]
    assert sorted(said, key=str) == sorted(in_journal, key=str)
    repeated = repeats(tickfix, journal)
    assert repeated["estimates"] == 2 * len(published)
    exported = json.loads(tickfix("journal", "info", journal, "--json").stdout)
    assert exported


def test_killed_at_random_it_goes_on_and_settles_as_if_nothing_had_happened(
    lab: Lab, walks: list[Path], tickfix: Command
) -> None:
    calm = lab.serve(CALM, "--journal", lab.place / "calm")
    outcome(lab.send(calm, *walks, "--speed", "0"))
    calm.stop()
    journal, rng = lab.place / "journal", np.random.default_rng(SEED)
    engine = lab.serve(LIGHT, "--journal", journal, at=lasting_addresses())
    sender = lab.send(engine, *walks, "--speed", "6" if KILLS < 10 else "0.25")
    for _ in range(KILLS):
        wanted = _records(journal) + int(rng.integers(20, 200))
        until(lambda wanted=wanted: _records(journal) > wanted or sender.poll() is not None)
        engine.kill()
        engine = lab.serve(LIGHT, "--journal", journal, "--resume", at=engine.at)
    sent = outcome(sender)
    assert sent["unknown"] == 0
    engine.stop()
    same_in_the_end(lab.place / "calm", journal)
    repeated = repeats(tickfix, journal)
    published = Counter((e.device, e.pipeline, e.epoch, e.tick) for e in estimates(journal) if e.revision == 0)
    twice = published.total() - len(published)
    assert twice == 0
    print(
        f"{KILLS} kills: {sent['messages']} messages, {sent['unknown']} unacknowledged; settled as undisturbed; "
        f"{repeated['segments']} segments, {repeated['estimates']} estimates and {repeated['revisions']} revisions "
        f"repeated, {repeated['differences']} differences; {twice} ticks published twice"
    )


def test_a_sender_and_a_listener_that_are_killed_harm_nobody(lab: Lab, walks: list[Path], tickfix: Command) -> None:
    engine = lab.serve(LIGHT, "--journal", lab.place / "journal")
    deaf = lab.start("listen", engine.at["positions"], "--json")
    os.kill(deaf.pid, signal.SIGSTOP)
    victim = lab.send(engine, walks[0], "--speed", "2")
    until(lambda: _records(lab.place / "journal") > 50)
    victim.kill()
    deaf.kill()
    sent = outcome(lab.send(engine, walks[1], "--speed", "0"))
    assert sent["unknown"] == 0
    with engine.control() as control:
        assert control.health()["ok"]
    engine.stop()
    repeats(tickfix, lab.place / "journal")


HANGING = '''
import time
from tickfix.api import Fix, hookimpl
from tickfix_filters.kalman import Kalman

class Hanging(Kalman):
    """Hangs when it has seen some fixes."""
    name = "hanging"
    seen = 0
    def update(self, state, fix, rng):
        type(self).seen += 1
        while type(self).seen > 3:
            time.sleep(1)
        return super().update(state, fix, rng)

@hookimpl
def tickfix_register():
    return [Hanging]
'''
FAILING = '''
import numpy as np
from dataclasses import replace
from tickfix.api import hookimpl
from tickfix_filters.kalman import Kalman

class Raising(Kalman):
    """Raises at every fix."""
    name = "raising"
    def update(self, state, fix, rng):
        raise RuntimeError("on purpose")

class Nan(Kalman):
    """Believes NaN."""
    name = "nan"
    def estimate(self, state):
        belief = super().estimate(state)
        return replace(belief, xy=belief.xy * np.nan)

@hookimpl
def tickfix_register():
    return [Raising, Nan]
'''
SLOW = '''
import time
from tickfix.api import hookimpl
from tickfix_fingerprint.knn import Wknn

class Slow(Wknn):
    """Takes two ticks and a half for a scan."""
    name = "slow"
    def locate(self, window):
        time.sleep(0.5)
        return super().locate(window)

@hookimpl
def tickfix_register():
    return [Slow]
'''


def pipeline(name: str, filter_: str, fingerprint: str = "wknn") -> str:
    return f'[pipelines.{name}]\npdr = "steps"\nfingerprint = "{fingerprint}"\nfilter = "{filter_}"\n'


def test_an_engine_that_hangs_is_restarted_without_the_culprit(
    lab: Lab, walks: list[Path], package: Callable[..., Mapping[str, str]], tickfix: Command
) -> None:
    lab.env |= package("hanging_filter", HANGING)
    journal = lab.place / "journal"
    config = pipeline("hanging", "hanging") + pipeline("kalman", "kalman") + "[live]\nwatchdog_s = 2.0\n"
    engine = lab.serve(config, "--journal", journal, at=lasting_addresses())
    sender = lab.send(engine, walks[0], "--speed", "6")
    assert "hung in filter 'hanging'" in engine.notice("hung")
    sent = outcome(sender)
    assert sent["unknown"] == 0
    with engine.control() as control:
        status = control.status()
        assert [p["state"].split(":")[0] for p in status["pipelines"]] == ["left out", "running"]
        assert not control.health()["ok"]
    engine.stop()
    lab.env["PYTHONPATH"] = str(lab.place)
    repeats(tickfix, journal, PYTHONPATH=str(lab.place))
    kalman = [e.tick for e in estimates(journal) if e.pipeline == "kalman" and e.revision == 0]
    assert sorted(set(kalman)) == list(range(min(kalman), max(kalman) + 1)), "ticks are missing"


def test_a_pipeline_that_raises_or_says_nan_harms_only_itself(
    lab: Lab, walks: list[Path], package: Callable[..., Mapping[str, str]]
) -> None:
    calm = lab.serve(pipeline("kalman", "kalman") + WAITING, "--journal", lab.place / "calm")
    outcome(lab.send(calm, walks[0], "--speed", "0"))
    calm.stop()
    lab.env |= package("failing_filters", FAILING)
    config = pipeline("raising", "raising") + pipeline("nan", "nan") + pipeline("kalman", "kalman") + WAITING
    engine = lab.serve(config, "--journal", lab.place / "journal")
    outcome(lab.send(engine, walks[0], "--speed", "0"))
    with engine.control() as control:
        failures = control.status()["failures"]
    engine.stop()
    assert failures["filter 'raising': RuntimeError"] > 0
    assert failures["filter 'nan': FloatingPointError"] > 0
    for key, track in last_word(lab.place / "calm").items():
        assert track_digest(track) == track_digest(last_word(lab.place / "journal")[key])


def test_a_scan_that_takes_longer_than_a_tick_delays_no_tick(
    lab: Lab, walks: list[Path], package: Callable[..., Mapping[str, str]], tickfix: Command
) -> None:
    lab.env |= package("slow_fingerprint", SLOW)
    journal = lab.place / "journal"
    engine = lab.serve(pipeline("slow", "kalman", "slow"), "--journal", journal)
    sent = outcome(lab.send(engine, walks[0], "--speed", "1.5"))
    assert sent["unknown"] == 0
    engine.stop()
    between: list[int] = []
    waiting: dict[int, int] = {}
    said = 0
    for record in JournalReader(journal).records():
        if record.kind is RecordKind.ESTIMATE:
            said += 1
        elif record.kind is RecordKind.EVENT and b"transmitters" in record.payload:
            waiting[record.number] = said
        elif record.kind is RecordKind.DECISION:
            decision = decode_decision(record.payload)
            if isinstance(decision, AdmitScan):
                between.append(said - waiting[decision.number])
    # Half a second of walking at one and a half times its pace are three to four ticks.
    assert len(between) > 5
    assert float(np.median(between)) >= 3
    repeats(tickfix, journal, PYTHONPATH=str(lab.place))


def test_a_flood_and_garbage_from_one_cost_the_others_nothing(lab: Lab, walks: list[Path]) -> None:
    engine = lab.serve(LIGHT, "--journal", lab.place / "journal")
    stop = threading.Event()
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()

    def flood() -> None:
        rng = np.random.default_rng(SEED)
        with context.socket(zmq.DEALER) as peer:
            peer.linger = 0
            peer.connect(engine.at["sensors"])
            fine = msgspec.msgpack.encode(
                {"v": 1, "type": "pressure", "device": "flood", "t_ns": 1, "pressure_hpa": 1000.0}
            )
            while not stop.is_set():
                garbage = rng.bytes(int(rng.choice([0, 1, 50, 5000])))
                message = (fine, garbage, fine[:-4], b"\x91" * 4000)[int(rng.integers(4))]
                if peer.poll(10, zmq.POLLOUT):
                    peer.send(message)

    thread = threading.Thread(target=flood, daemon=True)
    thread.start()
    sent = outcome(lab.send(engine, *walks, "--speed", "6"))
    stop.set()
    thread.join(PATIENCE_S)
    assert sent["unknown"] == 0, sent
    assert not {"busy", "throttled"} & set(sent["outcomes"]), "a flood from one was held against another"
    with engine.control() as control:
        outcomes = adds_up(control)
    assert outcomes["malformed"] + outcomes["throttled"] > 1000
    engine.stop()
    context.term()


def test_a_full_disk_stops_the_intake_and_keeps_the_past(lab: Lab, walks: list[Path], tickfix: Command) -> None:
    journal = lab.place / "journal"
    limit = 600_000

    def small_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    engine = lab.serve(LIGHT, "--journal", journal, before=small_files)
    sender = lab.send(engine, walks[0], "--speed", "0")
    assert "Intake has stopped" in engine.notice("Intake")
    with engine.control() as control:
        until(lambda: not control.health()["ok"])
        assert "full" in control.status()["overload"]
    sender.kill()
    engine.kill()
    assert json.loads(tickfix("journal", "verify", journal, "--json", code=0).stdout)
    assert repeats(tickfix, journal)["estimates"]
    again = lab.serve(LIGHT, "--journal", journal, "--resume")
    assert outcome(lab.send(again, walks[1], "--speed", "0"))["unknown"] == 0
    again.stop()
    repeats(tickfix, journal)


def test_an_engine_that_follows_says_the_same_and_may_die_unnoticed(
    lab: Lab, walks: list[Path], tickfix: Command
) -> None:
    leader = lab.serve(LIGHT, "--journal", lab.place / "leader")
    second = lab.serve(LIGHT, "--journal", lab.place / "second", "--follow", leader.at["follow"])
    doomed = lab.serve(LIGHT, "--follow", leader.at["follow"])
    with second.control() as control:
        control.status()
    _until_followed(lab, leader, (second, doomed))
    os.kill(doomed.popen.pid, signal.SIGSTOP)
    outcome(lab.send(leader, *walks, "--speed", "0"))
    doomed.kill()
    with leader.control() as control:
        ticks = control.status()["ticks"]
    with second.control() as control:
        until(lambda: control.status()["ticks"] >= ticks)
        assert control.status()["replication"].get("missed", 0) == 0
    leader.stop()
    second.stop()
    # What the probe said before it was heard is not the follower's.
    same_in_the_end(lab.place / "leader", lab.place / "second", beyond=False, but=("probe",))
    repeats(tickfix, lab.place / "second")


def test_an_engine_that_follows_settles_what_it_has_when_it_is_drained(lab: Lab, tickfix: Command) -> None:
    leader = lab.serve(LIGHT, "--journal", lab.place / "leader")
    second = lab.serve(LIGHT, "--journal", lab.place / "second", "--follow", leader.at["follow"])
    _until_followed(lab, leader, (second,))
    with Sensor(leader.at["sensors"], "phone") as phone, second.control() as control:
        phone.pressure(10_000_000_000, 1000.0)
        assert phone.flush(PATIENCE_S)
        until(lambda: control.devices() and control.devices()[-1]["device"] == "phone")
        assert control.drain()
    assert second.popen.wait(PATIENCE_S) == 0
    records = JournalReader(lab.place / "second").records()
    decisions = [decode_decision(record.payload) for record in records if record.kind is RecordKind.DECISION]
    assert FinishDevice(device="phone", reason="drained") in decisions
    repeats(tickfix, lab.place / "second")
    with leader.control() as control:
        assert [one["device"] for one in control.devices()] == ["phone"]


def test_messages_to_the_operator_are_json_lines_with_codes_if_wanted(lab: Lab, tickfix: Command) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        ended = tickfix("serve", lab.site, "--control", address, "--log-format", "json", "--no-watchdog", code=2)
    (line,) = map(json.loads, ended.stderr.splitlines())
    assert (line["level"], line["logger"], line["code"]) == ("critical", "tickfix.cli.serve", "engine_failed")
    assert address in line["message"]


def _until_followed(lab: Lab, leader: Process, followers: tuple[Process, ...]) -> None:
    """Send a device of its own until every follower has heard of it."""
    with Sensor(leader.at["sensors"], "probe") as probe:  # type: ignore[attr-defined]
        for follower in followers:
            with follower.control() as control:  # type: ignore[attr-defined]
                n = Counter[str]()

                def heard(control: object = control, n: Counter[str] = n) -> bool:
                    n["asked"] += 1
                    probe.truth(n["asked"] * 10_000_000, "F1", (0.0, 0.0))  # which makes no tick
                    probe.flush(1.0)
                    return bool(control.status()["replication"].get("records"))  # type: ignore[attr-defined]

                until(heard)
        assert probe.bye(PATIENCE_S)


def _records(journal: Path) -> int:
    """Return roughly how many records there are: bytes tell without reading."""
    return sum(file.stat().st_size for file in journal.glob("*.mcap")) // 600
