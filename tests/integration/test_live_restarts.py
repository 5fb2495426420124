"""Engines that hang or die, with real processes: positions come again, whatever it takes."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from live_lab import Engine, Lab, adds_up, lasting_addresses, outcome, until

from tickfix.journal import JournalReader

HANGING = '''
import os
import signal
import time
from pathlib import Path

from tickfix.api import Belief, BaseFilter, Prior, Report, hookimpl
from dataclasses import dataclass
import numpy as np

HANGS = Path(__file__).with_name("hangs")
DIES = Path(__file__).with_name("dies")


@dataclass(frozen=True)
class Steps:
    count: int = 0


class Hanging(BaseFilter):
    """Hangs, or dies, while there is a file that says so."""

    name = "hanging"
    State = Steps

    def start(self, prior, rng):
        return Steps()

    def step(self, state, motion, observations, rng):
        while state.count > 5 and HANGS.exists():
            time.sleep(0.01)
        if state.count > 5 and DIES.exists():
            os.kill(os.getpid(), signal.SIGABRT)
        return Steps(state.count + 1), Report()

    def estimate(self, state):
        return Belief(floor="F1", xy=np.zeros(2), covariance=np.eye(2))


@hookimpl
def tickfix_register():
    return [Hanging]
'''
ONLY = '[pipelines.hanging]\npdr = "steps"\nfingerprint = "wknn"\nfilter = "hanging"\n'
BESIDE = ONLY + '[pipelines.kalman]\npdr = "steps"\nfingerprint = "wknn"\nfilter = "kalman"\n'
LIVE = "[live]\nwatchdog_s = 1.5\n"


@pytest.fixture
def walks(floor_folder: Path) -> list[Path]:
    return sorted((floor_folder / "path_data_files").glob("*.txt"))[:2]


@pytest.fixture
def serve(lab: Lab, package: Callable[..., Mapping[str, str]]) -> Callable[[str], Engine]:
    """Start an engine at ports that it has again after a restart."""

    def started(pipelines: str) -> Engine:
        lab.env |= package("hanging_filter", HANGING)
        return lab.serve(pipelines + LIVE, "--journal", lab.place / "journal", at=lasting_addresses())

    return started


def serves_again(engine: Engine, lab: Lab, walk: Path) -> None:
    """Check that a walk is taken in, and comes out as positions."""
    assert outcome(lab.send(engine, walk, "--speed", "0"))["unknown"] == 0
    with engine.control() as control:
        adds_up(control, at_least=1)
        until(lambda: control.status()["ticks"] > 10)


def test_the_only_pipeline_is_kept_though_it_hung(lab: Lab, serve: Callable[[str], Engine], walks: list[Path]) -> None:
    engine = serve(ONLY)
    hangs = lab.place / "hangs"
    hangs.touch()
    sender = lab.send(engine, walks[0], "--speed", "6")
    told = engine.notice("hung in filter 'hanging'")
    assert "no pipeline would be left without it" in told
    hangs.unlink()
    outcome(sender)
    serves_again(engine, lab, walks[1])
    with engine.control() as control:
        assert [p["state"] for p in control.status()["pipelines"]] == ["running"]
    engine.stop()


def test_an_engine_that_hangs_whenever_it_goes_on_from_the_journal_begins_a_new_run(
    lab: Lab, serve: Callable[[str], Engine], walks: list[Path]
) -> None:
    engine = serve(ONLY)
    (lab.place / "hangs").touch()
    sender = lab.send(engine, walks[0], "--speed", "6")
    assert "3 in a row broke soon" in engine.notice("a new run begins")
    (lab.place / "hangs").unlink()
    outcome(sender)
    serves_again(engine, lab, walks[1])
    engine.stop()
    runs = [segment.manifest.run for segment in JournalReader(lab.place / "journal").segments() if segment.manifest]
    assert len(set(runs)) == 2


def test_a_stage_in_which_the_engine_dies_twice_is_left_out(
    lab: Lab, serve: Callable[[str], Engine], walks: list[Path]
) -> None:
    engine = serve(BESIDE)
    (lab.place / "dies").touch()
    sender = lab.send(engine, walks[0], "--speed", "6")
    assert "without pipelines that need filter 'hanging'" in engine.notice("without pipelines")
    outcome(sender)
    serves_again(engine, lab, walks[1])
    with engine.control() as control:
        states = {p["name"]: p["state"].partition(":")[0] for p in control.status()["pipelines"]}
    assert states == {"hanging": "left out", "kalman": "running"}
    engine.stop()


def test_killed_again_and_again_it_comes_back_each_time_and_stops_when_it_is_told_to(
    lab: Lab, serve: Callable[[str], Engine], walks: list[Path]
) -> None:
    engine = serve(ONLY)
    for n in range(7):
        until(lambda n=n: sum("serving" in line for line in engine.lines) > n)  # type: ignore[misc]
        for child in children(engine.popen.pid):
            os.kill(child, signal.SIGKILL)
    assert any("in 1 s" in line.get("notice", "") for line in engine.lines)
    until(lambda: sum("serving" in line for line in engine.lines) > 7)
    serves_again(engine, lab, walks[0])
    engine.stop()


def children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()]
