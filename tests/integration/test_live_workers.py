"""An engine whose devices are folded by worker processes: the same as one without, and what happens when they fail."""

from __future__ import annotations

import json
import os
import signal
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

import pytest
from live_lab import (
    CALM,
    Lab,
    estimates,
    hear,
    last_word,
    lasting_addresses,
    outcome,
    repeats,
    same_in_the_end,
    until,
)
from stored_floor import Command

from tickfix.client import Listener

WORKERS = "workers = 2\n"


@pytest.fixture(scope="session")
def walks(floor_folder: Path) -> list[Path]:
    return sorted((floor_folder / "path_data_files").glob("*.txt"))[:1]


@pytest.fixture(scope="session")
def calm(site: Path, walks: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The journal of an undisturbed run without workers."""
    lab = Lab(site, tmp_path_factory.mktemp("calm"))
    engine = lab.serve(CALM, "--journal", lab.place / "journal")
    assert outcome(lab.send(engine, *walks, "--copies", "3", "--speed", "0"))["unknown"] == 0
    engine.stop()
    lab.end()
    return lab.place / "journal"


def test_with_workers_an_engine_says_what_it_says_without_and_its_journal_repeats(
    lab: Lab, walks: list[Path], calm: Path, tickfix: Command
) -> None:
    journal = lab.place / "journal"
    engine = lab.serve(CALM + WORKERS, "--journal", journal)
    workers = children(children(engine.popen.pid)[0])
    assert len(workers) == 2
    with Listener(engine.at["positions"], ["device/"]) as listener:
        until(lambda: listener.receive(0.05) is None and listener.heartbeat is not None)
        sent = outcome(lab.send(engine, *walks, "--copies", "3", "--speed", "0"))
        assert sent["unknown"] == 0
        with engine.control() as control:
            status = control.status()
            assert status["failures"] == {}
            assert sum(status["measurements"].values()) > 1000
        assert all(shares(pid) for pid in workers), "one of the workers had nothing to do"
        ended = engine.stop()
        heard = hear(listener, ended["ticks"])
    assert not any(map(lives, workers)), "a worker is left behind"
    published = [e for e in estimates(journal) if e.revision == 0 and e.pipeline == "kalman"]
    assert ended["ticks"] == len(published) == len(heard) > 100
    said = Counter((e["device"], e["tick"]) for e in heard)
    assert said == Counter((e.device, e.tick) for e in published)
    same_in_the_end(calm, journal, beyond=False)
    assert repeats(tickfix, journal)["estimates"] == 2 * len(published)


def test_killed_workers_and_engines_lose_nothing_whoever_goes_on(
    lab: Lab, walks: list[Path], calm: Path, tickfix: Command
) -> None:
    journal = lab.place / "journal"
    engine = lab.serve(CALM + WORKERS, "--journal", journal, at=lasting_addresses())
    sender = lab.send(engine, *walks, "--copies", "3", "--speed", "6")
    until(lambda: grown(journal) > 50_000)
    (running,) = children(engine.popen.pid)
    os.kill(children(running)[1], signal.SIGKILL)
    assert "resuming from the journal" in engine.notice("crashed")
    until(lambda: "was ended by signal 9" in "".join(engine.errors))  # said before, and heard by another thread
    assert "worker 2" in "".join(engine.errors)
    until(lambda: lives_as_engine(engine.popen.pid, but=running))
    before = grown(journal)
    until(lambda: grown(journal) > before + 50_000)
    (running,) = children(engine.popen.pid)
    workers = children(running)
    engine.kill()  # the supervisor; engine and workers go with it
    until(lambda: not any(map(lives, (running, *workers))))
    engine = lab.serve(CALM + "workers = 3\n", "--journal", journal, "--resume", at=engine.at)
    assert outcome(sender)["unknown"] == 0
    engine.stop()
    same_in_the_end(calm, journal)
    repeated = repeats(tickfix, journal)
    assert repeated["segments"] >= 3
    published = Counter((e.device, e.pipeline, e.epoch, e.tick) for e in estimates(journal) if e.revision == 0)
    assert published.total() == len(published), "a tick was published twice"


HANGING = '''
from itertools import repeat
from tickfix.api import hookimpl
from tickfix_filters.kalman import Kalman

class Hanging(Kalman):
    """Hangs when it has seen some fixes, and lets no other thread run meanwhile."""
    name = "hanging"
    seen = 0
    def update(self, state, fix, rng):
        type(self).seen += 1
        if type(self).seen > 3:
            sum(repeat(0))
        return super().update(state, fix, rng)

class Raising(Kalman):
    """Raises at every fix."""
    name = "raising"
    def update(self, state, fix, rng):
        raise RuntimeError("on purpose")

@hookimpl
def tickfix_register():
    return [Hanging, Raising]
'''


def test_what_hangs_in_a_worker_is_named_and_left_out_and_what_raises_harms_only_itself(
    lab: Lab, walks: list[Path], package: Callable[..., Mapping[str, str]], tickfix: Command
) -> None:
    lab.env |= package("hanging_and_raising_filters", HANGING)
    journal = lab.place / "journal"
    names = ("hanging", "raising", "kalman")
    config = "".join(f'[pipelines.{name}]\npdr = "steps"\nfingerprint = "wknn"\nfilter = "{name}"\n' for name in names)
    engine = lab.serve(f"{config}[live]\nwatchdog_s = 2.0\n{WORKERS}", "--journal", journal, at=lasting_addresses())
    (running,) = children(engine.popen.pid)
    workers = children(running)
    sender = lab.send(engine, walks[0], "--speed", "6")
    assert "hung in filter 'hanging'" in engine.notice("hung")
    until(lambda: not any(map(lives, (running, *workers))))
    assert outcome(sender)["unknown"] == 0
    with engine.control() as control:
        status = control.status()
    assert [p["state"].split(":")[0] for p in status["pipelines"]] == ["left out", "running", "running"]
    assert status["failures"]["filter 'raising': RuntimeError"] > 0
    engine.stop()
    repeats(tickfix, journal, PYTHONPATH=str(lab.place))
    assert {pipeline for _, pipeline, _ in last_word(journal)} == set(names)
    kalman = [e.tick for e in estimates(journal) if e.pipeline == "kalman" and e.revision == 0]
    assert sorted(set(kalman)) == list(range(min(kalman), max(kalman) + 1)), "ticks are missing"


def children(pid: int) -> list[int]:
    """Return the processes that a process has forked, oldest first (Linux)."""
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def lives(pid: int) -> bool:
    """Tell whether a process is there and no zombie."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def lives_as_engine(supervisor: int, but: int) -> bool:
    """Tell whether a supervisor has another engine by now, with its workers."""
    with suppress(OSError):  # one that ends between two looks
        found = [pid for pid in children(supervisor) if pid != but]
        return bool(found) and len(children(found[0])) == 2
    return False


def shares(pid: int) -> bool:
    """Tell whether a process has used a tenth of a second of a processor."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return int(fields[11]) + int(fields[12]) > 0.1 * os.sysconf("SC_CLK_TCK")


def grown(journal: Path) -> int:
    """Return how many bytes there are."""
    return sum(file.stat().st_size for file in journal.glob("*.mcap"))


def test_an_observer_sees_all_that_a_live_engine_with_workers_says(
    lab: Lab, walks: list[Path], package: Callable[..., Mapping[str, str]], tickfix: Command
) -> None:
    source = Path(__file__).parents[1] / "third_party" / "observer" / "tickfix_walk_log" / "__init__.py"
    log = lab.place / "log.jsonl"
    lab.env |= package("tickfix_walk_log", source.read_text("utf-8")) | {"WALK_LOG": str(log)}
    journal = lab.place / "journal"
    engine = lab.serve(CALM + WORKERS, "--journal", journal)
    assert outcome(lab.send(engine, *walks, "--speed", "0"))["unknown"] == 0
    engine.stop()
    seen = [json.loads(line) for line in log.read_text("utf-8").splitlines()]
    assert (seen[0]["what"], seen[0]["mode"], seen[-1]["what"]) == ("started", "live", "ended")
    assert seen[-1]["reason"] == ""
    ticks = [tuple(tick[:4]) for line in seen if line["what"] == "estimates" for tick in line["ticks"]]
    assert Counter(ticks) == Counter((e.pipeline, e.epoch, e.tick, e.revision) for e in estimates(journal))
    assert len(ticks) > 100
    devices = [device for line in seen if line["what"] == "epochs" for device in line["devices"]]
    assert len(devices) == len(set(devices)) == len(walks)
    assert any(line["what"] == "fixes" for line in seen)
