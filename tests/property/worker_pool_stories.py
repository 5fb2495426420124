"""Tells random stories to one replica and to crews of several sizes, and compares all that they say, byte by byte.

    python worker_pool_stories.py STORIES

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
from tickfix.kernel import KernelSettings, Pipeline, deduplication
from tickfix.kernel.timeline import Timeline
from tickfix.live.heartbeat import WatchdogHeartbeat
from tickfix.live.protocol import Executor, FeedEvent, ReplicaStep
from tickfix.live.replica import Replica
from tickfix.live.worker import Worker
from tickfix.live.worker_pool import WorkerPool
from tickfix.wire import encode_event
from tickfix.wire.engine_messages import AdmitScan, DropScan, FinishDevice, RunDevice, SelectPrimary

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


def crew(workers: int) -> WorkerPool:
    """Return a crew that has just begun."""
    heartbeat = WatchdogHeartbeat()
    heartbeat.register_stages(PIPELINES)

    def work(n: int, channel: Connection, completions: Connection) -> None:
        own = heartbeat.for_worker(n)
        replica = Replica(PIPELINES, SETTINGS, on_call=own.enter_stage)
        Worker(replica, channel, completions, own, threads=1, timeout_s=60.0).serve()

    return WorkerPool(workers, work)


def begun(workers: int) -> Executor:
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

    def steps(self) -> Iterator[ReplicaStep]:
        """Yield the steps of a round."""
        for _ in range(int(self.rng.integers(1, 30))):
            step = self._step()
            self.made[type(step.event if isinstance(step, FeedEvent) else step).__name__] += 1
            yield step

    def runs(self) -> list[ReplicaStep]:
        """Return what a snapshot needs: whatever was fed is run."""
        runs: list[ReplicaStep] = [RunDevice(device=device) for device in self.unrun]
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

    def _step(self) -> ReplicaStep:
        kind, rng = self.rng.random(), self.rng
        device = DEVICES[int(rng.integers(len(DEVICES)))]
        if kind < 0.55:
            event = self.event()
            self.number += 1
            if isinstance(event, Scan):
                self.waiting[self.number] = event.device
            else:
                self.unrun[event.device] = None
            return FeedEvent(self.number, event)
        if kind < 0.7:
            number = next(iter(self.waiting), 0) if rng.random() < 0.9 else 10**6
            self.unrun[self.waiting.pop(number, device)] = None
            return DropScan(number=number, reason="so") if rng.random() < 0.2 else AdmitScan(number=number)
        if kind < 0.95:
            tick = None if rng.random() < 0.7 else (T0 + MS * self.at_ms.get(device, 100_000)) // (200 * MS)
            self.unrun.pop(device, None)
            most = None if rng.random() < 0.8 else 3
            self.unrun |= {} if most is None else {device: None}
            return RunDevice(device=device, tick=tick, most=most)
        self.unrun.pop(device, None)
        return FinishDevice(device=device, reason="bye") if rng.random() < 0.8 else SelectPrimary(pipeline="other")


def same(what: str, *values: Any) -> None:
    """Check that all folders say the same bytes."""
    first, *others = map(msgspec.msgpack.encode, values)
    if any(other != first for other in others):
        raise SystemExit(f"{what} differ: {values}")


def tell(seed: int) -> Counter[str]:
    """Tell one story to a replica and two crews, each of which is replaced by others now and then."""
    author = Author(np.random.default_rng(seed))
    folders = [begun(workers) for workers in (0, 2, 3)]
    estimates: Counter[str] = Counter()
    for _ in range(ROUNDS):
        steps = list(author.steps())
        results = [folder.apply(steps) for folder in folders]
        same("what came of the steps", *results)
        estimates["estimates"] += sum(len(result.estimates) for result in results[0])
        estimates["epochs"] = max(
            [estimates["epochs"], *(result.progress.epoch for result in results[0] if result.progress)]
        )
        estimates["duplicates"] += sum(result.outcome == "duplicate" for result in results[0])
        asked = [author.event() for _ in range(5)]
        same("what repeats", *([folder.is_duplicate(event) for event in asked] for folder in folders))
        same("standings", *(list(folder.progress_by_device().items()) for folder in folders))
        same("scans that wait", *(list(folder.waiting) for folder in folders))
        same("primaries", *(folder.primary for folder in folders))
        if author.rng.random() < 0.3:
            same("counters", *(counters(folder) for folder in folders))
        if author.rng.random() < 0.15:
            runs = author.runs()
            same("what the runs say", *(folder.apply(runs) for folder in folders))
            kept = [folder.snapshot() for folder in folders]
            same("snapshots", *kept)
            estimates["snapshots"] += 1
            estimates["snapshot bytes"] += len(kept[0])
            others = [begun(int(workers)) for workers in author.rng.integers(0, 5, 3)]
            for folder, data in zip(others, kept, strict=True):
                folder.restore(data)
            end(folders)
            folders = others
    end(folders)
    return author.made + estimates


def counters(folder: Executor) -> Any:
    """Return the counters in an order that does not depend on what came first."""
    found = folder.counters()
    return [found.devices, sorted(found.measurements.items()), found.missing, sorted(found.failures.items())]


def end(folders: list[Executor]) -> None:
    """End the workers of those that are crews."""
    for folder in folders:
        if isinstance(folder, WorkerPool):
            folder.close()


def bounds() -> Counter[str]:
    """Have more devices come and go than are remembered, and the first of them come back."""
    deduplication._MAX_CLOSED_DEVICES = remembered = 200  # the bound itself takes long to reach
    folders = [begun(workers) for workers in (0, 2)]
    number, count = 0, remembered + 60
    seen: Counter[str] = Counter()

    def fed(names: range, seq: int) -> list[ReplicaStep]:
        nonlocal number
        number += 1
        return [
            FeedEvent(number, Pressure(t_ns=T0, pressure_hpa=1000.0, device=f"d{n}", session="s", seq=seq))
            for n in names
        ]

    for begin in range(0, count, 26):
        names = range(begin, begin + 26)
        gone: list[ReplicaStep] = [FinishDevice(device=f"d{n}", reason="bye") for n in names]
        same("what came of the steps", *(folder.apply(fed(names, 1) + gone) for folder in folders))
    back = fed(range(120), 1)
    repeated = [[folder.is_duplicate(step.event) for step in back if isinstance(step, FeedEvent)] for folder in folders]
    same("what repeats", *repeated)
    seen["forgotten"], seen["remembered"] = repeated[0].count(False), repeated[0].count(True)
    same("what came of their return", *(folder.apply([*back, *fed(range(120), 2)]) for folder in folders))
    same("what the runs say", *(folder.apply([RunDevice(device=f"d{n}") for n in range(120)]) for folder in folders))
    same("standings", *(list(folder.progress_by_device().items()) for folder in folders))
    same("snapshots", *(folder.snapshot() for folder in folders))
    end(folders)
    return seen


def large() -> Counter[str]:
    """Send more at once, both ways, than any buffer between two processes holds."""
    folders = [begun(workers) for workers in (0, 2)]
    t = T0 + MS * np.arange(4_000)
    sensors = {"gyroscope": Samples(t, np.ones((len(t), 3)))}
    feeds = [
        FeedEvent(n, MotionSamples(sensors=sensors, device=device, session="s", seq=n))
        for n, device in enumerate(DEVICES * 6, 1)
    ]
    leap: list[ReplicaStep] = [RunDevice(device=device, tick=T0 // (200 * MS) + 300) for device in DEVICES]
    results = [folder.apply(feeds + leap) for folder in folders]
    same("what came of the steps", *results)
    end(folders)
    sent = sum(len(encode_event(feed.event)) for feed in feeds)
    return Counter({"bytes sent at once": sent, "bytes answered": len(msgspec.msgpack.encode(results[0]))})


def defects() -> Counter[str]:
    """Have a kernel with a defect break on one device after the other; each is lost alone, and comes back."""
    honest = Timeline.insert

    def broken(self: Timeline, event: Event, **more: Any) -> Any:
        if isinstance(event, Pressure) and event.pressure_hpa == MARKED_HPA:
            raise ZeroDivisionError("a defect")
        return honest(self, event, **more)

    Timeline.insert = broken  # type: ignore[method-assign]
    deduplication._MAX_CLOSED_DEVICES = 3
    folders = [begun(workers) for workers in (0, 2, 3)]
    seen: Counter[str] = Counter()
    for n in range(1, 30):
        devices = DEVICES * 2 if n % 3 else [DEVICES[n % len(DEVICES)]]
        hpa = 1000.0 if n % 3 else MARKED_HPA
        told = [
            Pressure(t_ns=T0 + 200 * MS * n + at, pressure_hpa=hpa, device=device, session=f"s{n % 5}", seq=n + at)
            for at, device in enumerate(devices)
        ]
        steps = [step for event in told for step in (FeedEvent(n, event), RunDevice(device=event.device))]
        results = [folder.apply(steps) for folder in folders]
        same("what came of the steps", *results)
        seen["lost"] += sum(result.outcome == "malformed" for result in results[0])
        same("what repeats", *([folder.is_duplicate(event) for event in told] for folder in folders))
        same("standings", *(list(folder.progress_by_device().items()) for folder in folders))
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
