"""Devices sharded over worker processes.

For the loop the same as one replica, and a journal does not show how many workers wrote it.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache, partial
from hashlib import blake2b
from multiprocessing.connection import Connection, wait
from typing import Any, Final, cast

from tickfix.api import Event, Scan, Truth
from tickfix.api.packing import PrepackedValue, pack, unpack
from tickfix.kernel import DeviceProgress, KernelSnapshot, SessionRegistry
from tickfix.live.localization import LocalizationResult
from tickfix.live.protocol import (
    COMPLETIONS_DECODER,
    COUNTERS_DECODER,
    RESTORE_DECODER,
    RESULTS_DECODER,
    SNAPSHOT_DECODER,
    ApplySteps,
    EngineError,
    FeedEvent,
    ForgetDevice,
    GetCounters,
    LocateScan,
    ReplicaCounters,
    ReplicaStep,
    ReplicaStepResult,
    RestoreSnapshot,
    Shutdown,
    TakeSnapshot,
    WorkerCounters,
    WorkerError,
    WorkerSnapshot,
    WorkerStep,
    encode_message,
    encode_step,
)
from tickfix.live.replica import ReplicaSnapshot
from tickfix.live.worker import WorkerHandle
from tickfix.wire import decode_event, encode_event
from tickfix.wire.engine_messages import AdmitScan, DropScan, FinishDevice, SelectPrimary


class WorkerCompletions:
    """Has scans located by the workers, and hears of it in a thread of its own.

    Args:
        handles: the workers.
        owner: the number of the worker that a device belongs to.
        wake: called, from that thread, when there is something to hear.
    """

    def __init__(self, handles: Sequence[WorkerHandle], owner: Callable[[str], int], wake: Callable[[], None]) -> None:
        """Start the thread."""
        self._handles = handles
        self._owner = owner
        self._wake = wake
        self._lock = threading.Lock()
        self._submitted: set[int] = set()
        self._results: list[LocalizationResult] = []
        self._exited: WorkerHandle | None = None
        self._thread = threading.Thread(target=self._listen, name="tickfix-completions", daemon=True)
        self._thread.start()

    def submit(self, number: int, scan: Scan) -> None:
        """Have the worker locate the scan of record ``number``, which waits there.

        Raises:
            WorkerError: when the worker is gone.
        """
        self._submitted.add(number)
        self._handles[self._owner(scan.device)].submit(encode_message(LocateScan(number)))

    def results(self) -> list[LocalizationResult]:
        """Return what was located or given up since the last call."""
        with self._lock:
            results, self._results = self._results, []
        self._submitted.difference_update(located.number for located in results)
        return results

    @property
    def waiting(self) -> int:
        """How many scans are neither."""
        return len(self._submitted)

    def stop(self) -> None:
        """Let go of what is not done; the workers' threads end with them."""

    def check(self) -> None:
        """Look after the workers.

        Raises:
            WorkerError: when one is gone.
        """
        if self._exited is not None:
            raise self._exited.exit_error()

    def join(self) -> None:
        """Wait for the thread, which ends with the last worker."""
        self._thread.join()

    def _listen(self) -> None:
        handles = {handle.completions: handle for handle in self._handles}
        while handles:
            for found in wait(list(handles)):
                handle = next(handle for connection, handle in handles.items() if connection is found)
                try:
                    located = COMPLETIONS_DECODER.decode(handle.completions.recv_bytes())
                except (EOFError, OSError):
                    del handles[handle.completions]
                    self._exited = self._exited or handle
                else:
                    with self._lock:
                        self._results += located
                self._wake()


class DeviceRegistry:
    """Keeps up with the steps of a run without folding anything.

    Attributes:
        sessions: the message numbers seen, and who is gone; numbers of epochs are the workers' affair.
        followed: devices, in the order of their first event.
        waiting: scans that no decision has spoken of yet, by the number of their record.
        primary: the pipeline that is published; empty means that none was chosen.
    """

    def __init__(self) -> None:
        """Begin with nothing."""
        self.sessions = SessionRegistry()
        self.followed: dict[str, None] = {}
        self.waiting: dict[int, Scan] = {}
        self.primary = ""

    def enter(self, step: ReplicaStep) -> tuple[str | None, list[str]]:
        """Record a step.

        Returns:
            The device that it concerns, None for a step that concerns none; and devices that are forgotten for it.
        """
        if isinstance(step, FeedEvent):
            if isinstance(step.event, Scan):
                self.waiting[step.number] = step.event
            else:
                self._feed(step.event)
            return step.event.device, []
        if isinstance(step, AdmitScan | DropScan):
            scan = self.waiting.pop(step.number, None)
            if scan is None:
                return None, []
            if isinstance(step, AdmitScan):
                self._feed(scan)
            return scan.device, []
        if isinstance(step, SelectPrimary):
            self.primary = step.pipeline
            return None, []
        if isinstance(step, FinishDevice) and step.device in self.followed:
            del self.followed[step.device]
            return step.device, self.sessions.close(step.device, 0)
        return step.device, []

    def quarantine(self, devices: Iterable[str]) -> list[str]:
        """Take note that devices are followed no more, though nobody said so; return who is forgotten for them."""
        forgotten = []
        for device in devices:
            del self.followed[device]
            forgotten += self.sessions.close(device, 0)
        return forgotten

    def restore(self, kernel: KernelSnapshot, waiting: Iterable[tuple[int, Scan]], primary: str) -> None:
        """Restore a snapshot."""
        self.sessions.restore(kernel.sessions, kernel.closed_devices)
        self.followed.update(dict.fromkeys(device.device for device in kernel.devices))
        self.waiting.update(waiting)
        self.primary = primary

    def _feed(self, event: Event) -> None:
        if isinstance(event, Truth):
            return
        is_new, _ = self.sessions.enter(event)
        if is_new and event.device not in self.followed:
            self.sessions.begin(event.device)
            self.followed[event.device] = None


@lru_cache(maxsize=65_536)
def worker_index(device: str, workers: int) -> int:
    """Return the number of the worker that a device belongs to."""
    digest = blake2b(device.encode("utf-8", "surrogatepass"), digest_size=8).digest()
    return int.from_bytes(digest, "little") % workers


def merge_snapshots(parts: Sequence[WorkerSnapshot], device_registry: DeviceRegistry) -> bytes:
    """Return the bytes that one replica would give, from the workers' parts and the order in which all devices came.

    Raises:
        EngineError: when a worker could not make its part.
    """
    for part in parts:
        if part.error:
            raise EngineError(f"a worker could not make its part of a snapshot: {part.error}")
    kernels = [KernelSnapshot.unpacked(part.kernel) for part in parts]
    devices = {device: PrepackedValue(body) for part in parts for device, body in part.devices}
    sessions = {(seen.device, seen.session): seen for kernel in kernels for seen in kernel.sessions}
    order = [(seen.device, seen.session) for seen in device_registry.sessions.snapshot()]
    closed_devices = {device: number for kernel in kernels for device, number in kernel.closed_devices}
    kernel = KernelSnapshot(
        seed=kernels[0].seed,
        horizon_s=kernels[0].horizon_s,
        # The bytes of a device are not taken apart to be put together again.
        devices=cast("Any", tuple(devices[device] for device in device_registry.followed)),
        # A device that was lost and came back within a batch of steps has left more in the roll than with its worker.
        sessions=tuple(sessions[key] for key in order if key in sessions),
        closed_devices=tuple(
            (device, closed_devices[device])
            for device in device_registry.sessions.closed_devices
            if device in closed_devices
        ),
        intake=tuple(sorted(sum_counters(dict(kernel.intake) for kernel in kernels).items())),
        measurements=tuple(sorted(sum_counters(dict(kernel.measurements) for kernel in kernels).items())),
        failures=tuple(sorted(sum_counters(dict(kernel.failures) for kernel in kernels).items())),
    )
    waiting = tuple((number, encode_event(scan)) for number, scan in device_registry.waiting.items())
    return pack(ReplicaSnapshot(kernel.packed(), waiting, device_registry.primary))


def split_snapshot(
    data: bytes, device_registry: DeviceRegistry, workers: int, owner: Callable[[str], int]
) -> list[bytes]:
    """Return what each worker is to restore, and restore the roll.

    Args:
        data: a replica's snapshot.
        device_registry: begun.
        workers: how many.
        owner: of a device.

    Raises:
        ValueError: when it is no snapshot.
    """
    kept = unpack(data, ReplicaSnapshot)
    kernel = KernelSnapshot.unpacked(kept.kernel)
    events = ((number, decode_event(body)) for number, body in kept.waiting)
    waiting = [(number, event) for number, event in events if isinstance(event, Scan)]
    parts = []
    for n in range(workers):
        part = replace(
            kernel,
            devices=tuple(device for device in kernel.devices if owner(device.device) == n),
            sessions=tuple(seen for seen in kernel.sessions if owner(seen.device) == n),
            closed_devices=tuple((device, number) for device, number in kernel.closed_devices if owner(device) == n),
        )
        if n:  # what was counted before belongs to nobody in particular
            part = replace(part, intake=(), measurements=(), failures=())
        scans = tuple((number, encode_event(scan)) for number, scan in waiting if owner(scan.device) == n)
        parts.append(pack(ReplicaSnapshot(part.packed(), scans, kept.primary)))
    device_registry.restore(kernel, waiting, kept.primary)
    return parts


def sum_counters(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """Return the sums of counters."""
    total: Counter[str] = Counter()
    for one in counts:
        total.update(one)
    return dict(total)


_GET_COUNTERS: Final = encode_message(GetCounters())
_TAKE_SNAPSHOT: Final = encode_message(TakeSnapshot())


class WorkerPool:
    """Worker processes, each with the devices that are its own.

    What is asked of several workers is sent to all of them before the first answer is awaited: it takes as long as the
    slowest of them.

    Args:
        workers: how many.
        work: is worker number n, in a process of its own: see :class:`WorkerHandle`. Processes are forked, so there
            should be
            no other thread yet.
    """

    def __init__(self, workers: int, work: Callable[[int, Connection, Connection], None]) -> None:
        """Start the workers."""
        self._handles: list[WorkerHandle] = []
        for n in range(workers):
            self._handles.append(WorkerHandle(n, partial(work, n), self._handles))
        self._device_registry = DeviceRegistry()
        self._progress: dict[str, DeviceProgress] = {}
        self._forgotten: list[str] = []
        self._worker_counters = [WorkerCounters({}, 0, {})] * workers
        self._stale_counters: set[int] = set()
        self._completions: WorkerCompletions | None = None

    @property
    def primary(self) -> str:
        """The pipeline that is published; empty means that none was chosen."""
        return self._device_registry.primary

    @property
    def waiting(self) -> Mapping[int, Scan]:
        """Scans that no decision has spoken of yet, by the number of their record."""
        return self._device_registry.waiting

    def apply(self, steps: Sequence[ReplicaStep]) -> list[ReplicaStepResult]:
        """Apply the steps in order and return the result of each.

        Raises:
            WorkerError: when a worker is gone.
        """
        if self._completions is not None:
            self._completions.check()
        entries: list[list[WorkerStep]] = [[] for _ in self._handles]
        places: list[list[int]] = [[] for _ in self._handles]
        devices: list[str | None] = []
        for gone in self._forgotten:
            entries[self._owner(gone)].append(ForgetDevice(gone))
        for place, step in enumerate(steps):
            device, forgotten = self._device_registry.enter(step)
            devices.append(device)
            if device is not None:
                n = self._owner(device)
                entries[n].append(encode_step(step))
                places[n].append(place)
            for gone in forgotten:
                entries[self._owner(gone)].append(ForgetDevice(gone))
        requests = {n: encode_message(ApplySteps(part)) for n, part in enumerate(entries) if part}
        results = [ReplicaStepResult()] * len(steps)
        for n, response in self._request_all(requests).items():
            for place, result in zip(places[n], RESULTS_DECODER.decode(response), strict=True):
                results[place] = result
        self._stale_counters |= requests.keys()
        self._forgotten = self._device_registry.quarantine(self._record_progress(steps, devices, results))
        return results

    def is_duplicate(self, event: Event) -> bool:
        """Tell whether the event would be a duplicate by its number; changes nothing."""
        return self._device_registry.sessions.is_duplicate(event)

    def progress_by_device(self) -> Mapping[str, DeviceProgress]:
        """Return how far each device has come."""
        return self._progress

    def counters(self) -> ReplicaCounters:
        """Return the counters as they are now; only workers that did something since the last time are asked."""
        for n, response in self._request_all(dict.fromkeys(sorted(self._stale_counters), _GET_COUNTERS)).items():
            self._worker_counters[n] = COUNTERS_DECODER.decode(response)
        self._stale_counters.clear()
        return ReplicaCounters(
            devices=len(self._device_registry.followed),
            measurements=sum_counters(worker_counters.measurements for worker_counters in self._worker_counters),
            missing=sum(worker_counters.missing for worker_counters in self._worker_counters),
            failures=sum_counters(worker_counters.failures for worker_counters in self._worker_counters),
        )

    def snapshot(self) -> bytes:
        """Return all of it as the bytes that one replica would give; every device must have been run since it was fed.

        Raises:
            WorkerError: when a worker is gone.
        """
        responses = self._request_all(dict.fromkeys(range(len(self._handles)), _TAKE_SNAPSHOT))
        return merge_snapshots(
            [SNAPSHOT_DECODER.decode(response) for response in responses.values()], self._device_registry
        )

    def restore(self, data: bytes) -> None:
        """Become what the bytes say, whoever they are from.

        Raises:
            ValueError: when they are no snapshot, or one of a run with other settings.
            WorkerError: when a worker is gone.
        """
        parts = split_snapshot(data, self._device_registry, len(self._handles), self._owner)
        responses = self._request_all({n: encode_message(RestoreSnapshot(part)) for n, part in enumerate(parts)})
        found: dict[str, DeviceProgress] = {}
        for loaded in map(RESTORE_DECODER.decode, responses.values()):
            if loaded.error:
                raise ValueError(loaded.error)
            found |= loaded.progress_by_device
        self._progress = {device: found[device] for device in self._device_registry.followed}
        self._stale_counters = set(responses)

    def scan_locator(self, wake: Callable[[], None]) -> WorkerCompletions:
        """Return whoever locates scans: each worker those of its devices, beside its folding.

        Args:
            wake: called, from another thread, when one is done, or a worker is gone.
        """
        self._completions = WorkerCompletions(self._handles, self._owner, wake)
        return self._completions

    def close(self) -> None:
        """End the workers and wait for them."""
        for handle in self._handles:
            with suppress(WorkerError):
                handle.submit(encode_message(Shutdown()))
        for handle in self._handles:
            handle.join()
        if self._completions is not None:
            self._completions.join()
        for handle in self._handles:
            handle.close()

    def _record_progress(
        self, steps: Sequence[ReplicaStep], devices: Sequence[str | None], results: Sequence[ReplicaStepResult]
    ) -> list[str]:
        """Take note of how far devices have come; return those on which a kernel broke: it goes on without them."""
        without: dict[str, None] = {}
        for step, device, result in zip(steps, devices, results, strict=True):
            if device is None or isinstance(step, DropScan):
                continue
            if result.progress is None:
                self._progress.pop(device, None)
                without[device] = None
            else:
                self._progress[device] = result.progress
        return [
            device for device in without if device in self._device_registry.followed and device not in self._progress
        ]

    def _owner(self, device: str) -> int:
        return worker_index(device, len(self._handles))

    def _request_all(self, requests: Mapping[int, bytes]) -> dict[int, bytes]:
        # Nobody waits for the other for ever: a worker reads all of a request before it writes, and has one at a time.
        for n, request in requests.items():
            self._handles[n].submit(request)
        return {n: self._handles[n].response() for n in requests}
