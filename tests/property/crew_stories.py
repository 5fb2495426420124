"""Tells random stories to one replica and to crews of several sizes, and compares all that they say, byte by byte.

    python crew_stories.py STORIES

A program of its own: a crew forks, which belongs into a process with one thread.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any

import msgspec
import numpy as np
from toys import sabotaged, toy_pipeline

from tickfix.api import Event, Fix, MotionSamples, Pressure, Samples, Scan, Truth
from tickfix.drivers.live.crew.crew import Crew
from tickfix.drivers.live.crew.worker import Worker
from tickfix.drivers.live.folding import Feed, Folding, Step
from tickfix.drivers.live.replica import Replica
from tickfix.drivers.live.watchdog.beacon import Beacon
from tickfix.kernel import KernelSettings, Pipeline, sessions
from tickfix.kernel.timeline import Timeline
from tickfix.wire import encode_event
from tickfix.wire.decisions import Drop, Finish, Fold, Primary, Run

MS = 1_000_000
T0 = 5_000_000_000_000
DEVICES = tuple("abcdefg")
SETTINGS = KernelSettings(horizon_s=2.0)
ROUNDS = 40
MARKED_HPA = 13.0


def pipelines() -> tuple[Pipeline, ...]:
    """Return hashes of all that was seen, two of which fail now and then."""
    toy, other = toy_pipeline("toy"), toy_pipeline("other", redated=True)
    failing = sabotaged(toy.filter, lambda _, t_ns: ("", "", "raise", "", "nan")[t_ns // (200 * MS) % 5])
    return toy, other, Pipeline("failing", failing, toy.pdr, toy.fingerprint)


PIPELINES = pipelines()


def crew(workers: int) -> Crew:
    """Return a crew that has just begun."""
    beacon = Beacon()
    beacon.introduce(PIPELINES)

    def work(n: int, line: Connection, notices: Connection) -> None:
        own = beacon.of_worker(n)
        replica = Replica(PIPELINES, SETTINGS, on_call=own.calling)
        Worker(replica, line, notices, own, threads=1, timeout_s=60.0).serve()

    return Crew(workers, work)


def begun(workers: int) -> Folding:
    """Return a replica, or a crew of some workers."""
    return crew(workers) if workers else Replica(PIPELINES, SETTINGS)


@dataclass
class Author:
    """Makes up what devices send and what an engine decides.

    Attributes:
        rng: makes it up.
        sent: what may be sent again.
        waiting: numbers of scans that no decision spoke of.
        unrun: devices that were fed and not run since.
        made: how many steps of each kind.
    """

    rng: np.random.Generator
    number: int = 0
    at_ms: dict[str, int] = field(default_factory=dict)
    seq: Counter[tuple[str, str]] = field(default_factory=Counter)
    sent: list[Event] = field(default_factory=list)
    waiting: dict[int, str] = field(default_factory=dict)
    unrun: dict[str, None] = field(default_factory=dict)
    made: Counter[str] = field(default_factory=Counter)

    def steps(self) -> Iterator[Step]:
        """Yield the steps of a round."""
        for _ in range(int(self.rng.integers(1, 30))):
            step = self._step()
            self.made[type(step.event if isinstance(step, Feed) else step).__name__] += 1
            yield step

    def runs(self) -> list[Step]:
        """Return what a snapshot needs: whatever was fed is run."""
        runs: list[Step] = [Run(device=device) for device in self.unrun]
        self.unrun.clear()
        return runs

    def event(self) -> Event:
        """Return what a device sends: mostly something new, in order."""
        rng = self.rng
        if self.sent and rng.random() < 0.1:
            return self.sent[int(rng.integers(len(self.sent)))]
        device = DEVICES[int(rng.integers(len(DEVICES)))]
        session = f"s{int(rng.integers(20)) if rng.random() < 0.05 else 0}"
        seq = 0 if rng.random() < 0.1 else self.seq[device, session] + (2 if rng.random() < 0.1 else 1)
        self.seq[device, session] = max(seq, self.seq[device, session])
        now_ms = self.at_ms.get(device, 100_000) + int(rng.integers(20, 260))
        if rng.random() < 0.02:
            now_ms -= 50_000  # its clock begins anew
        self.at_ms[device] = now_ms
        if rng.random() < 0.1:
            now_ms -= 600
        event = self._measured(T0 + MS * now_ms, {"device": device, "session": session, "seq": seq})
        self.sent = [*self.sent[-30:], event]
        return event

    def _measured(self, t_ns: int, who: dict[str, Any]) -> Event:
        kind, rng = self.rng.random(), self.rng
        if kind < 0.6:
            t = t_ns + 20 * MS * np.arange(5)
            values = rng.standard_normal((5, 3))
            values[0, 0] = np.nan if rng.random() < 0.05 else 1.0
            return MotionSamples(sensors={"gyroscope": Samples(t, values)}, **who)
        if kind < 0.85:
            heard = np.array([t_ns - 300 * MS, t_ns])
            return Scan(
                transmitters=("x", "y"), rssi_dbm=-60.0 - rng.random(2), heard_ns=heard, t_ns=t_ns, source="wifi", **who
            )
        if kind < 0.9:
            return Pressure(t_ns=t_ns, pressure_hpa=1000.0 + rng.random(), **who)
        if kind < 0.95:
            return Truth(t_ns=t_ns, floor="F", xy=rng.random(2), **who)
        return Fix(t_ns=t_ns, floor="F", xy=rng.random(2), covariance=np.eye(2), **who)

    def _step(self) -> Step:
        kind, rng = self.rng.random(), self.rng
        device = DEVICES[int(rng.integers(len(DEVICES)))]
        if kind < 0.55:
            event = self.event()
            self.number += 1
            if isinstance(event, Scan):
                self.waiting[self.number] = event.device
            else:
                self.unrun[event.device] = None
            return Feed(self.number, event)
        if kind < 0.7:
            number = next(iter(self.waiting), 0) if rng.random() < 0.9 else 10**6
            self.unrun[self.waiting.pop(number, device)] = None
            return Drop(number=number, reason="so") if rng.random() < 0.2 else Fold(number=number)
        if kind < 0.95:
            tick = None if rng.random() < 0.7 else (T0 + MS * self.at_ms.get(device, 100_000)) // (200 * MS)
            self.unrun.pop(device, None)
            most = None if rng.random() < 0.8 else 3
            self.unrun |= {} if most is None else {device: None}
            return Run(device=device, tick=tick, most=most)
        self.unrun.pop(device, None)
        return Finish(device=device, reason="bye") if rng.random() < 0.8 else Primary(pipeline="other")


def same(what: str, *values: Any) -> None:
    """Check that all folders say the same bytes."""
    first, *others = map(msgspec.msgpack.encode, values)
    if any(other != first for other in others):
        raise SystemExit(f"{what} differ: {values}")


def tell(seed: int) -> Counter[str]:
    """Tell one story to a replica and two crews, each of which is replaced by others now and then."""
    author = Author(np.random.default_rng(seed))
    folders = [begun(workers) for workers in (0, 2, 3)]
    said: Counter[str] = Counter()
    for _ in range(ROUNDS):
        steps = list(author.steps())
        done = [folder.apply(steps) for folder in folders]
        same("what came of the steps", *done)
        said["estimates"] += sum(len(came.said) for came in done[0])
        said["epochs"] = max([said["epochs"], *(came.standing.epoch for came in done[0] if came.standing)])
        said["duplicates"] += sum(came.outcome == "duplicate" for came in done[0])
        asked = [author.event() for _ in range(5)]
        same("what repeats", *([folder.repeats(event) for event in asked] for folder in folders))
        same("standings", *(list(folder.standings().items()) for folder in folders))
        same("scans that wait", *(list(folder.waiting) for folder in folders))
        same("primaries", *(folder.primary for folder in folders))
        if author.rng.random() < 0.3:
            same("counters", *(books(folder) for folder in folders))
        if author.rng.random() < 0.15:
            runs = author.runs()
            same("what the runs say", *(folder.apply(runs) for folder in folders))
            kept = [folder.snapshot() for folder in folders]
            same("snapshots", *kept)
            said["snapshots"] += 1
            said["snapshot bytes"] += len(kept[0])
            others = [begun(int(workers)) for workers in author.rng.integers(0, 5, 3)]
            for folder, data in zip(others, kept, strict=True):
                folder.restore(data)
            end(folders)
            folders = others
    end(folders)
    return author.made + said


def books(folder: Folding) -> Any:
    """Return the counters in an order that does not depend on what came first."""
    found = folder.books()
    return [found.devices, sorted(found.measurements.items()), found.missing, sorted(found.failures.items())]


def end(folders: list[Folding]) -> None:
    """End the workers of those that are crews."""
    for folder in folders:
        if isinstance(folder, Crew):
            folder.close()


def bounds() -> Counter[str]:
    """Have more devices come and go than are remembered, and the first of them come back."""
    sessions._RETIRED = remembered = 200  # the bound itself takes long to reach
    folders = [begun(workers) for workers in (0, 2)]
    number, count = 0, remembered + 60
    seen: Counter[str] = Counter()

    def fed(names: range, seq: int) -> list[Step]:
        nonlocal number
        number += 1
        return [
            Feed(number, Pressure(t_ns=T0, pressure_hpa=1000.0, device=f"d{n}", session="s", seq=seq)) for n in names
        ]

    for begin in range(0, count, 26):
        names = range(begin, begin + 26)
        gone: list[Step] = [Finish(device=f"d{n}", reason="bye") for n in names]
        same("what came of the steps", *(folder.apply(fed(names, 1) + gone) for folder in folders))
    back = fed(range(120), 1)
    repeated = [[folder.repeats(step.event) for step in back if isinstance(step, Feed)] for folder in folders]
    same("what repeats", *repeated)
    seen["forgotten"], seen["remembered"] = repeated[0].count(False), repeated[0].count(True)
    same("what came of their return", *(folder.apply([*back, *fed(range(120), 2)]) for folder in folders))
    same("what the runs say", *(folder.apply([Run(device=f"d{n}") for n in range(120)]) for folder in folders))
    same("standings", *(list(folder.standings().items()) for folder in folders))
    same("snapshots", *(folder.snapshot() for folder in folders))
    end(folders)
    return seen


def large() -> Counter[str]:
    """Send more at once, both ways, than any buffer between two processes holds."""
    folders = [begun(workers) for workers in (0, 2)]
    t = T0 + MS * np.arange(4_000)
    sensors = {"gyroscope": Samples(t, np.ones((len(t), 3)))}
    feeds = [
        Feed(n, MotionSamples(sensors=sensors, device=device, session="s", seq=n))
        for n, device in enumerate(DEVICES * 6, 1)
    ]
    leap: list[Step] = [Run(device=device, tick=T0 // (200 * MS) + 300) for device in DEVICES]
    done = [folder.apply(feeds + leap) for folder in folders]
    same("what came of the steps", *done)
    end(folders)
    sent = sum(len(encode_event(feed.event)) for feed in feeds)
    return Counter({"bytes sent at once": sent, "bytes answered": len(msgspec.msgpack.encode(done[0]))})


def defects() -> Counter[str]:
    """Have a kernel with a defect break on one device after the other; each is lost alone, and comes back."""
    honest = Timeline.insert

    def broken(self: Timeline, event: Event, **more: Any) -> Any:
        if isinstance(event, Pressure) and event.pressure_hpa == MARKED_HPA:
            raise ZeroDivisionError("a defect")
        return honest(self, event, **more)

    Timeline.insert = broken  # type: ignore[method-assign]
    sessions._RETIRED = 3
    folders = [begun(workers) for workers in (0, 2, 3)]
    seen: Counter[str] = Counter()
    for n in range(1, 30):
        devices = DEVICES * 2 if n % 3 else [DEVICES[n % len(DEVICES)]]
        hpa = 1000.0 if n % 3 else MARKED_HPA
        told = [
            Pressure(t_ns=T0 + 200 * MS * n + at, pressure_hpa=hpa, device=device, session=f"s{n % 5}", seq=n + at)
            for at, device in enumerate(devices)
        ]
        steps = [step for event in told for step in (Feed(n, event), Run(device=event.device))]
        done = [folder.apply(steps) for folder in folders]
        same("what came of the steps", *done)
        seen["lost"] += sum(came.outcome == "malformed" for came in done[0])
        same("what repeats", *([folder.repeats(event) for event in told] for folder in folders))
        same("standings", *(list(folder.standings().items()) for folder in folders))
        same("snapshots", *(folder.snapshot() for folder in folders))
    end(folders)
    return seen


def main() -> None:
    """Tell stories and print what was in them."""
    whole: Counter[str] = Counter()
    stories: list[Callable[[], Counter[str]]] = [lambda seed=seed: tell(seed) for seed in range(int(sys.argv[1]))]  # type: ignore[misc]
    for story in [*stories, bounds, large, defects]:
        whole += story()
    sys.stdout.write(msgspec.json.encode(whole).decode() + "\n")


if __name__ == "__main__":
    main()
