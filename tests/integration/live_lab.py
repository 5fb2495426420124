"""Engines, senders and listeners as processes, and what their journals say afterwards."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from stored_floor import Command

from tickfix.api import Estimate
from tickfix.client import Control, Listener
from tickfix.evaluation.tracks import Track, digest
from tickfix.journal import JournalReader, RecordKind
from tickfix.wire import decode_estimate

PATIENCE_S = 90.0
"""How long a test waits for what must come; nothing here waits for time to pass."""
PORTS = ("sensors", "positions", "control", "follow")
LIGHT = """
[pipelines.wifi]
fingerprint = "wknn"
filter = "fixes"
[pipelines.kalman]
pdr = "steps"
fingerprint = "wknn"
filter = "kalman"
"""
WAITING = "[live]\ncoast_s = 0.0\n"
"""No tick beyond the data, however slow the sender is."""
CALM = LIGHT + WAITING
"""For undisturbed runs."""


_OURS = 200
_turns = itertools.count(os.getpid())


def lasting_addresses() -> dict[str, str]:
    """Return addresses that an engine finds free again after a crash.

    The system gives their ports to nobody who asks for any, and other workers of pytest have others.
    """
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    given = Path("/proc/sys/net/ipv4/ip_local_port_range")
    lowest_given = int(given.read_text().split()[0]) if given.exists() else 32_768
    return {name: f"tcp://127.0.0.1:{_free_port(lowest_given - _OURS * (worker + 1))}" for name in PORTS}


def _free_port(first: int) -> int:
    for turn in itertools.islice(_turns, _OURS):
        port = first + turn % _OURS
        with contextlib.suppress(OSError), socket.socket() as probe:
            probe.bind(("127.0.0.1", port))
            return port
    raise AssertionError(f"no port from {first} to {first + _OURS - 1} is free")


@dataclass
class Process:
    """A process whose JSON lines are read as they come."""

    popen: subprocess.Popen[str]
    lines: list[dict[str, Any]] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    changed: threading.Condition = field(default_factory=threading.Condition)

    def __post_init__(self) -> None:
        streams = ((self.popen.stdout, self._json), (self.popen.stderr, self.errors.append))
        self._readers = [threading.Thread(target=self._read, args=each, daemon=True) for each in streams]
        for reader in self._readers:
            reader.start()

    def wait_until_read(self) -> None:
        """Wait until all that an ended process has said is here."""
        for reader in self._readers:
            reader.join(PATIENCE_S)

    def wait_for(self, wanted: Callable[[dict[str, Any]], bool], what: str) -> dict[str, Any]:
        """Return the first line that is wanted, waiting for it."""
        with self.changed:
            found = self.changed.wait_for(lambda: next(filter(wanted, self.lines), None) or self._ended(), PATIENCE_S)
        if self._ended():
            self.wait_until_read()
        line = next(filter(wanted, self.lines), None)
        assert found, f"no {what}: {self.lines} {''.join(self.errors)}"
        assert line is not None, f"ended without {what}: {self.lines} {''.join(self.errors)}"
        return line

    def kill(self) -> None:
        """End it as nobody can prevent."""
        self.popen.kill()
        self.popen.wait(PATIENCE_S)

    def stop(self) -> dict[str, Any]:
        """End it in order, and return its last words."""
        self.popen.send_signal(signal.SIGTERM)
        assert self.popen.wait(PATIENCE_S) == 0, "".join(self.errors)
        ended: dict[str, Any] = self.wait_for(lambda line: "ended" in line, "last words")["ended"]
        return ended

    def _ended(self) -> bool:
        return self.popen.poll() is not None

    def _json(self, line: str) -> None:
        with contextlib.suppress(json.JSONDecodeError), self.changed:
            self.lines.append(json.loads(line))
            self.changed.notify_all()

    def _read(self, stream: Any, take: Callable[[str], None]) -> None:
        for line in stream:
            take(line)
        with self.changed:
            self.changed.notify_all()


@dataclass
class Engine(Process):
    """``tickfix serve``."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.at = self.wait_for(lambda line: "serving" in line, "engine")

    def control(self) -> Control:
        """Return a client of its control port."""
        return Control(self.at["control"], timeout_s=PATIENCE_S)

    def notice(self, part: str) -> str:
        """Wait until it tells something, and return that."""
        return str(self.wait_for(lambda line: part in line.get("notice", ""), f"notice of {part!r}")["notice"])


class Lab:
    """Starts processes and ends them all.

    Args:
        site: folder of the site.
        place: for journals and configurations.
    """

    def __init__(self, site: Path, place: Path) -> None:
        self.site, self.place = site, place
        self.env: dict[str, str] = {**os.environ, "PYTHONUTF8": "1", "OPENBLAS_NUM_THREADS": "1"}
        self._processes: list[subprocess.Popen[str]] = []

    def start(self, *arguments: object, before: Callable[[], None] | None = None) -> subprocess.Popen[str]:
        """Start ``tickfix`` with arguments."""
        popen = subprocess.Popen(  # noqa: S603 - our own command
            [sys.executable, "-m", "tickfix.cli.main", *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=self.env,
            preexec_fn=before,  # noqa: PLW1509 - nothing here has threads that hold locks the child needs
        )
        self._processes.append(popen)
        return popen

    def serve(
        self,
        config: str,
        *options: object,
        at: Mapping[str, str] | None = None,
        before: Callable[[], None] | None = None,
    ) -> Engine:
        """Start an engine, on free ports or on those of another one."""
        file = self.place / "live.toml"
        file.write_text(config, encoding="utf-8")
        where = dict.fromkeys(PORTS, "tcp://127.0.0.1:*") if at is None else {name: at[name] for name in PORTS}
        names = {"follow": "follow-bind"}
        addresses = [part for name, value in where.items() for part in (f"--{names.get(name, name)}", value)]
        command = ("serve", self.site, "--config", file, "--json", *addresses, *options)
        return Engine(self.start(*command, before=before))

    def send(self, engine: Engine, *options: object) -> subprocess.Popen[str]:
        """Play recordings, or a crowd, to an engine."""
        return self.start("send", "--to", engine.at["sensors"], "--json", *options)

    def end(self) -> None:
        """Kill what is left."""
        for popen in self._processes:
            with contextlib.suppress(OSError):
                popen.kill()
            popen.communicate()


def outcome(sender: subprocess.Popen[str]) -> dict[str, Any]:
    """Wait for a sender and return what it says."""
    said, errors = sender.communicate(timeout=2 * PATIENCE_S)
    assert sender.returncode == 0, said + errors
    sent: dict[str, Any] = json.loads(said)
    return sent


def estimates(journal: Path) -> Iterator[Estimate]:
    """Yield what a journal says was said."""
    for record in JournalReader(journal).records(on_damage=lambda _: None):
        if record.kind in (RecordKind.ESTIMATE, RecordKind.REVISION):
            yield decode_estimate(record.payload)


def last_word(journal: Path) -> dict[tuple[str, str, int], dict[int, Estimate]]:
    """Return the last revision of every tick, by device, pipeline and epoch."""
    tracks: dict[tuple[str, str, int], dict[int, Estimate]] = {}
    for estimate in estimates(journal):
        tracks.setdefault((estimate.device, estimate.pipeline, estimate.epoch), {})[estimate.tick] = estimate
    return tracks


def track_digest(track: Mapping[int, Estimate]) -> str:
    """Return the digest of a settled track."""
    said = tuple(replace(track[tick], revision=0) for tick in sorted(track))
    return digest(Track(pipeline="", device="", estimates=said, closed_ns=np.zeros(len(said), np.int64)))


def same_in_the_end(calm: Path, other: Path, *, beyond: bool = True, but: Collection[str] = ()) -> None:
    """Check that the tracks of two journals settled the same, to the bit.

    Args:
        calm: journal of the undisturbed run.
        other: journal of the other one.
        beyond: the other one may say ticks beyond the calm one's last: an engine that waits for a slow sender goes on.
        but: devices that are left out.
    """
    a, b = ({key: track for key, track in last_word(one).items() if key[0] not in but} for one in (calm, other))
    assert a.keys() == b.keys()
    assert a
    for key, track in a.items():
        assert track.keys() <= b[key].keys(), f"{key} lacks ticks"
        more = b[key].keys() - track.keys()
        assert all(beyond and tick > max(track) for tick in more), f"{key} has ticks that it should not have: {more}"
        assert track_digest(track) == track_digest({tick: b[key][tick] for tick in track}), f"{key} settled differently"


def repeats(tickfix: Command, journal: Path, **environment: str) -> dict[str, Any]:
    """Check that a journal repeats to the byte; return what ``tickfix replay --journal`` says."""
    said: dict[str, Any] = json.loads(tickfix("replay", "--journal", journal, "--json", env=environment).stdout)
    assert said["identical"], said
    return said


def adds_up(control: Control, *, at_least: int = 0) -> dict[str, int]:
    """Wait until every message in has its outcome, and return how many had which."""
    intake: dict[str, Any] = {}

    def settled() -> bool:
        intake.update(control.counters()["ports"]["intake"])
        return bool(intake["pending"] == 0 and intake["received"] >= at_least)

    until(settled)
    outcomes: dict[str, int] = intake["outcomes"]
    assert sum(outcomes.values()) == intake["received"]
    return outcomes


def hear(listener: Listener, count: int) -> list[dict[str, Any]]:
    """Return what an engine said that has ended: so many estimates, and no more."""
    heard: list[dict[str, Any]] = []
    while len(heard) < count:
        estimate = listener.receive(PATIENCE_S)
        assert estimate is not None, f"{len(heard)} of {count} were heard"
        heard.append(estimate)
    assert listener.receive(1.0) is None, f"more than {count} were heard"
    return heard


def until(happened: Callable[[], bool]) -> None:
    """Ask until it happened, at most for a long time."""
    ended = threading.Event()
    timer = threading.Timer(PATIENCE_S, ended.set)
    timer.daemon = True
    timer.start()
    while not happened():
        assert not ended.wait(0.02), "it never happened"
    timer.cancel()
