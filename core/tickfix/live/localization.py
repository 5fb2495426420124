"""Scans are located beside the loop, by threads that fill a cache of fingerprint results, so that no tick waits for a
slow fingerprint; a tick that closes first is published without them.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from hashlib import blake2b
from typing import Any, Final, Protocol

from tickfix.api import Event, Readings, Scan, Window
from tickfix.api.packing import pack
from tickfix.kernel import FingerprintRequest, Pipeline, Stage
from tickfix.ports import InboundMessage
from tickfix.wire.engine_messages import AdmitScan, DropScan


@dataclass(frozen=True, slots=True)
class LocalizationResult:
    """A scan whose questions are answered, or given up; ``reason`` is empty unless it was given up."""

    number: int
    device: str
    reason: str = ""


@dataclass(slots=True, eq=False)
class _LocateJob:
    number: int
    device: str
    fingerprint_requests: Sequence[FingerprintRequest]
    submitted_ns: int
    started_ns: int | None = None
    timed_out: bool = False
    replaced: bool = False


class LocatorThreads:
    """Answers questions in threads of its own.

    A thread that hangs in one is left behind, and another takes its place, a few times; after that scans are given up
    until one comes back.

    Args:
        fingerprint_requests: returns what the fingerprints will be asked once a scan is fed; called where
            :meth:`submit` is.
        wake: called, from any thread, when something is done.
        threads: that work at once.
        timeout_s: for one scan; after that it is given up.
        clock_ns: monotonic.
    """

    def __init__(
        self,
        fingerprint_requests: Callable[[Scan], Sequence[FingerprintRequest]],
        wake: Callable[[], None],
        *,
        threads: int = 1,
        timeout_s: float = 5.0,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Start the threads."""
        self._questions = fingerprint_requests
        self._wake = wake
        self._timeout_ns = round(timeout_s * 1e9)
        self._clock_ns = clock_ns
        self._max_threads = threads * 4
        self._condition = threading.Condition()
        self._queue: deque[_LocateJob] = deque()
        self._working: list[_LocateJob] = []
        self._results: list[LocalizationResult] = []
        self._stopped = False
        self._alive = 0
        self.hung = 0
        for _ in range(threads):
            self._spawn()

    def submit(self, number: int, scan: Scan) -> None:
        """Answer the questions that the scan of record ``number`` raises."""
        fingerprint_requests = self._questions(scan)
        with self._condition:
            self._queue.append(_LocateJob(number, scan.device, fingerprint_requests, self._clock_ns()))
            self._condition.notify()

    def results(self) -> list[LocalizationResult]:
        """Return what was answered or given up since the last call."""
        with self._condition:
            self._time_out()
            results, self._results = self._results, []
        return results

    @property
    def waiting(self) -> int:
        """How many scans are neither answered nor given up."""
        with self._condition:
            return len(self._queue) + sum(not job.timed_out for job in self._working)

    def stop(self) -> None:
        """Let the threads end; those that hang are daemons and die with the process."""
        with self._condition:
            self._stopped = True
            self._condition.notify_all()

    def _time_out(self) -> None:
        now_ns = self._clock_ns()
        for job in self._working:
            if job.started_ns is not None and not job.timed_out and now_ns - job.started_ns > self._timeout_ns:
                job.timed_out = True
                self.hung += 1
                self._results.append(LocalizationResult(job.number, job.device, "not located in time"))
                job.replaced = self._alive < self._max_threads
                if job.replaced:
                    self._spawn()
        # Nobody is left to work: what has waited for as long is given up too.
        while self._queue and now_ns - self._queue[0].submitted_ns > 2 * self._timeout_ns:
            job = self._queue.popleft()
            self._results.append(LocalizationResult(job.number, job.device, "not located in time"))

    def _spawn(self) -> None:
        self._alive += 1
        threading.Thread(target=self._work, name="tickfix-locator", daemon=True).start()

    def _work(self) -> None:
        while True:
            with self._condition:
                while not self._queue and not self._stopped:
                    self._condition.wait()
                if self._stopped:
                    return
                job = self._queue.popleft()
                job.started_ns = self._clock_ns()
                self._working.append(job)
            for fingerprint_request in job.fingerprint_requests:
                _fill_cache(fingerprint_request)
            with self._condition:
                self._working.remove(job)
                if job.replaced:
                    self._alive -= 1
                    return
                if job.timed_out:
                    continue
                self._results.append(LocalizationResult(job.number, job.device))
            self._wake()


def _fill_cache(fingerprint_request: FingerprintRequest) -> None:
    """Compute the answers; they are remembered, and what is raised is raised again where the kernel asks."""
    state = fingerprint_request.state
    for window in fingerprint_request.windows:
        with suppress(Exception):
            state, _ = fingerprint_request.stage.algorithm.step(state, window)


_CACHE_SIZE: Final = 4096


class CachedFingerprint:
    """A fingerprint that remembers its last answers; it may be asked from several threads."""

    def __init__(self, algorithm: Any) -> None:
        """Stand in for ``algorithm``."""
        self._algorithm = algorithm
        self._cache: OrderedDict[bytes, tuple[Any, BaseException | None]] = OrderedDict()
        self._lock = threading.Lock()
        self.State = algorithm.State

    @property
    def window(self) -> Window:
        """The algorithm's."""
        window: Window = self._algorithm.window
        return window

    def start(self) -> Any:
        """Return the algorithm's first state."""
        return self._algorithm.start()

    def step(self, state: Any, window: Readings) -> Any:
        """Return what the algorithm returns, or raise what it raises, from memory where it was asked before."""
        key = cache_key(state, window)
        with self._lock:
            cached = self._cache.get(key)
        if cached is None:
            try:
                cached = self._algorithm.step(state, window), None
            except Exception as raised:  # noqa: BLE001 - it is raised again, here and whenever it is asked again
                cached = None, raised
            with self._lock:
                self._cache[key] = cached
                while len(self._cache) > _CACHE_SIZE:
                    self._cache.popitem(last=False)
        answer, error = cached
        if error is not None:
            raise error
        return answer


def cache_key(state: Any, window: Readings) -> bytes:
    """Return a digest of what a fingerprint is asked."""
    parts = (window.t_ns, window.transmitters, window.scan_t_ns, window.source)
    digest = blake2b(pack(state), digest_size=16)
    digest.update(repr(parts).encode("utf-8", "surrogatepass"))
    for array in (window.rssi_dbm, window.heard_ns, window.scan):
        digest.update(array.tobytes())
    for name, column in window.values.items():
        digest.update(name.encode("utf-8", "surrogatepass"))
        digest.update(column.tobytes())
    return digest.digest()


def with_fingerprint_cache(pipelines: Sequence[Pipeline]) -> tuple[Pipeline, ...]:
    """Return the pipelines with their fingerprints remembering; those that are shared stay shared."""
    made: dict[str, Stage] = {}

    def stage(found: Stage) -> Stage:
        if found.key not in made:
            made[found.key] = replace(found, algorithm=CachedFingerprint(found.algorithm))
        return made[found.key]

    return tuple(p if p.fingerprint is None else replace(p, fingerprint=stage(p.fingerprint)) for p in pipelines)


_MAX_SCANS_OF_DEVICE: Final = 256
_MAX_PENDING_SCANS: Final = 4_096


class ScanLocator(Protocol):
    """Whoever locates scans beside the loop."""

    def submit(self, number: int, scan: Scan) -> None:
        """Begin to locate the scan of record ``number``."""

    def results(self) -> Sequence[LocalizationResult]:
        """Return what was located or given up since the last call."""

    @property
    def waiting(self) -> int:
        """How many scans are neither."""

    def stop(self) -> None:
        """Let go of what is not done."""


@dataclass(frozen=True, slots=True)
class ScanDecision:
    """What is to become of a scan; ``item`` is the message that brought it, None where nobody waits for an answer."""

    decision: AdmitScan | DropScan
    scan: Scan
    item: InboundMessage | None


class PendingScans:
    """Remembers the scans that wait for a decision, and asks for those whose turn it is to be located.

    Attributes:
        timed_out: scans that could not be located in time.
    """

    def __init__(self, scan_locator: ScanLocator) -> None:
        """Begin with none."""
        self._scan_locator = scan_locator
        self._waiting: dict[int, tuple[Scan, InboundMessage | None]] = {}
        self._queues: dict[str, deque[int]] = {}
        self._in_flight: set[tuple[str, str, int]] = set()
        self.timed_out = 0

    def recover(self, waiting: Mapping[int, Scan]) -> None:
        """Take over scans that wait since before this process began, by the numbers of their records."""
        for number, scan in waiting.items():
            self.add(number, scan, None)

    def add(self, number: int, scan: Scan, item: InboundMessage | None) -> None:
        """Have the scan of record ``number`` located."""
        self._waiting[number] = scan, item
        self._in_flight.add((scan.device, scan.session, scan.seq))
        queue = self._queues.setdefault(scan.device, deque())
        queue.append(number)
        if len(queue) == 1:
            self._scan_locator.submit(number, scan)

    def deferral_reason(self, device: str) -> str:
        """Return why no more scans of a device can wait now; empty if they can."""
        waiting = len(self._queues.get(device, ()))
        if waiting >= _MAX_SCANS_OF_DEVICE or len(self._waiting) >= _MAX_PENDING_SCANS:
            return f"{waiting} scans of this device, {len(self._waiting)} in all wait to be located"
        return ""

    def is_in_flight(self, event: Event) -> bool:
        """Tell whether a scan with this number waits."""
        return event.seq > 0 and (event.device, event.session, event.seq) in self._in_flight

    def decisions(self) -> list[ScanDecision]:
        """Return those that are located by now, and those that will not be; the next ones get their turns."""
        found = []
        for located in self._scan_locator.results():
            if located.number not in self._waiting:
                continue  # its device is gone
            number, why = located.number, located.reason
            self.timed_out += bool(why)
            found.append(self._decide(number, DropScan(number=number, reason=why) if why else AdmitScan(number=number)))
            self._start_next(located.device)
        return found

    def drop(self, device: str, reason: str) -> list[ScanDecision]:
        """Give up all scans of a device that is gone."""
        return [
            self._decide(number, DropScan(number=number, reason=reason)) for number in self._queues.pop(device, deque())
        ]

    @property
    def in_flight(self) -> int:
        """How many are being located."""
        return self._scan_locator.waiting

    def stop(self) -> None:
        """Ask no more."""
        self._scan_locator.stop()

    def _decide(self, number: int, decision: AdmitScan | DropScan) -> ScanDecision:
        scan, item = self._waiting.pop(number)
        self._in_flight.discard((scan.device, scan.session, scan.seq))
        return ScanDecision(decision, scan, item)

    def _start_next(self, device: str) -> None:
        queue = self._queues[device]
        queue.popleft()
        if queue:
            self._scan_locator.submit(queue[0], self._waiting[queue[0]][0])
        else:
            del self._queues[device]
