"""Processes that are stopped and go on, as when a laptop sleeps: SIGSTOP and SIGCONT."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from live_lab import CALM, LIGHT, Lab, adds_up, estimates, outcome, repeats, same_in_the_end, until
from stored_floor import Command

from tickfix.client import Listener

WATCHDOG_S = 1.5
SILENCE_S = 3.0
"""An engine that sleeps for longer than its watchdog waits."""


def test_a_sender_and_an_engine_that_sleep_lose_nothing_and_their_ticks_come_again(
    lab: Lab, floor_folder: Path, tickfix: Command
) -> None:
    walk, journal = min((floor_folder / "path_data_files").glob("*.txt")), lab.place / "journal"
    calm = lab.serve(CALM, "--journal", lab.place / "calm")
    outcome(lab.send(calm, walk, "--copies", "2", "--speed", "0"))
    calm.stop()

    config = f"{LIGHT}[live]\ncoast_s = 1.0\nwatchdog_s = {WATCHDOG_S}\n"
    engine = lab.serve(config, "--journal", journal, before=os.setsid)
    silences: list[float] = []
    with (
        Listener(
            engine.at["positions"], ["device/"], on_heartbeat_timeout=silences.append, heartbeat_timeout_s=SILENCE_S
        ) as listener,
        engine.control() as control,
    ):

        def ticks_come() -> bool:
            return listener.receive(0.05) is not None

        def coasts_no_further() -> bool:
            told = control.devices()
            return len(told) == 2 and all(d["next_tick"] > d["newest_ns"] // 200_000_000 + 5 for d in told)

        sender = lab.send(engine, walk, "--copies", "2", "--speed", "4")
        until(ticks_come)
        os.kill(sender.pid, signal.SIGSTOP)
        until(coasts_no_further)
        while listener.receive(0.5):
            pass
        os.kill(sender.pid, signal.SIGCONT)
        until(ticks_come)

        os.killpg(engine.popen.pid, signal.SIGSTOP)
        try:
            until(lambda: not ticks_come() and bool(silences))
        finally:
            os.killpg(engine.popen.pid, signal.SIGCONT)
        until(ticks_come)
        sent = outcome(sender)
        assert (sent["unknown"], sent["refused"]) == (0, {})
        outcomes = adds_up(control)
        assert listener.missed == 0
    assert outcomes.keys() - {name for name, n in outcomes.items() if not n} <= {"accepted", "late", "duplicate"}
    engine.stop()
    assert [line["notice"] for line in engine.lines if "notice" in line] == []
    same_in_the_end(lab.place / "calm", journal)
    ticks = [e.tick for e in estimates(journal) if e.revision == 0 and e.pipeline == "kalman"]
    assert set(ticks) == set(range(min(ticks), max(ticks) + 1))
    assert repeats(tickfix, journal)["estimates"]
