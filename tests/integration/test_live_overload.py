"""An engine that cannot keep up: it says so, keeps whom it has, lets nobody new in, recovers; and what it publishes."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from live_lab import PATIENCE_S, Lab, adds_up, estimates, hear, repeats, until
from live_scripts import Letter, Post, letters, walks
from stored_floor import Command

from tickfix.client import Listener, Sensor

S = 1_000_000_000
SLOW = '''
import os
import time
from tickfix.api import hookimpl
from tickfix_filters.kalman import Kalman

class Slow(Kalman):
    """Takes longer than a tick for each, as long as a file says so."""
    name = "slow"
    def step(self, state, motion, observations, rng):
        if os.path.exists(os.environ["SLOW_WHILE"]):
            time.sleep(0.3)
        return super().step(state, motion, observations, rng)

@hookimpl
def tickfix_register():
    return [Slow]
'''
CONFIG = """
[pipelines.slow]
pdr = "steps"
fingerprint = "wknn"
filter = "slow"
[live]
overload_s = 0.5
coast_s = 1.0
"""


@pytest.fixture
def slowness(lab: Lab, package: Callable[..., Mapping[str, str]]) -> Path:
    """Return the file that makes engines slow as long as it is there."""
    file = lab.place / "slow"
    file.touch()
    lab.env |= {**package("slow_filter", SLOW), "SLOW_WHILE": str(file)}
    return file


def config(overrun: str) -> str:
    """Return the configuration with an overrun policy."""
    return f'{CONFIG}overrun = "{overrun}"\n'


def script(device: str, seconds: int) -> list[Letter]:
    """Return what a phone sends in so many seconds, from its first scan on: before one, a filter has nothing to do."""
    (walk,) = walks(1, 40.0)
    sent = letters(device, walk)
    began_ns = next(letter.at_ns for letter in sent if letter.is_scan)
    after = [replace(letter, at_ns=letter.at_ns - began_ns) for letter in sent]
    return [letter for letter in after if 0 <= letter.at_ns < seconds * S]


def all_journaled(journal: Path) -> list[int]:
    """Return the ticks that were said for the first time."""
    return [e.tick for e in estimates(journal) if e.revision == 0]


def test_overload_is_announced_refuses_new_devices_keeps_the_old_and_ends_by_itself(
    lab: Lab, slowness: Path, tickfix: Command
) -> None:
    journal, over = lab.place / "journal", threading.Event()
    engine = lab.serve(config("each"), "--journal", journal)
    old = Post(engine.at["sensors"])

    def walk() -> None:
        with old:
            old.play(script("old", 45), over.is_set)

    with (
        Listener(engine.at["positions"], ["device/"]) as listener,
        Sensor(engine.at["sensors"], "new", resend_s=0.2) as new,
        engine.control() as control,
    ):
        until(lambda: listener.receive(0.05) is None and listener.heartbeat is not None)
        walker = threading.Thread(target=walk, daemon=True)
        walker.start()
        assert "new devices are refused" in engine.notice("overload")
        new.pressure(S, 1000.0)
        until(lambda: new.flush(0.05) or new.outcomes["busy"] > 0)
        assert new.unacknowledged
        assert "a new device: the engine is more than 0.5 s behind" in new.refused
        assert "overload: more than 0.5 s behind" in tickfix("status", engine.at["control"], "--timeout", "60").stdout
        assert not control.health()["ok"]
        slowness.unlink()
        engine.notice("keeps up again")
        over.set()
        walker.join(PATIENCE_S)
        assert new.flush(PATIENCE_S)
        until(lambda: control.health()["ok"])
        outcomes = adds_up(control)
        ended = engine.stop()
        hear(listener, len(all_journaled(journal)))
        assert listener.missed == 0
    assert new.outcomes["accepted"] == 1
    assert outcomes["busy"] >= new.outcomes["busy"] > 0
    assert old.outcomes["old"].keys() <= {"accepted", "late"}
    assert (ended["overloads"], ended["suppressed"]) == (1, 0)
    ticks = [e.tick for e in estimates(journal) if e.device == "old" and e.revision == 0]
    assert ticks == list(range(min(ticks), max(ticks) + 1))
    repeats(tickfix, journal, PYTHONPATH=str(lab.place), SLOW_WHILE=str(slowness))


def test_an_overrun_policy_of_newest_publishes_less_and_folds_everything(
    lab: Lab, slowness: Path, tickfix: Command
) -> None:
    journal = lab.place / "journal"
    engine = lab.serve(config("newest"), "--journal", journal)
    with Listener(engine.at["positions"], ["device/"]) as listener, Post(engine.at["sensors"]) as post:
        until(lambda: listener.receive(0.05) is None and listener.heartbeat is not None)
        post.deliver(script("old", 4))
        slowness.unlink()
        post.leave(["old"])
        withheld = engine.stop()["suppressed"]
        ticks = all_journaled(journal)
        heard = [estimate["tick"] for estimate in hear(listener, len(ticks) - withheld)]
        assert listener.missed == 0
    assert withheld > 5
    assert ticks == list(range(min(ticks), max(ticks) + 1))
    assert heard == sorted(set(heard) & set(ticks))
    repeats(tickfix, journal, PYTHONPATH=str(lab.place), SLOW_WHILE=str(slowness))


def test_an_overrun_policy_of_fail_ends_the_engine_and_says_why(
    lab: Lab, slowness: Path, floor_folder: Path, tickfix: Command
) -> None:
    engine = lab.serve(config("fail"), "--journal", lab.place / "journal")
    sender = lab.send(engine, min((floor_folder / "path_data_files").glob("*.txt")), "--speed", "1")
    assert engine.popen.wait(PATIENCE_S) == 3
    sender.kill()
    engine.wait_until_read()
    assert "s behind with 1 devices, and overrun = 'fail'" in "".join(engine.errors)
    assert sum("serving" in line for line in engine.lines) == 1
    slowness.unlink()
    assert repeats(tickfix, lab.place / "journal", PYTHONPATH=str(lab.place), SLOW_WHILE=str(slowness))["estimates"]
