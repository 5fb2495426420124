"""A worker process: the handle by which the engine holds it (fork, pipe, exit), and the loop inside that answers
requests with a replica of its own. Where a worker dies, the handle says how.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection, Pipe
from typing import Any, Final

from tickfix.api.packing import pack
from tickfix.live.heartbeat import WatchdogHeartbeat, die_with_parent
from tickfix.live.localization import LocatorThreads
from tickfix.live.protocol import (
    REQUEST_DECODER,
    ApplySteps,
    EncodedEvent,
    FeedEvent,
    ForgetDevice,
    GetCounters,
    LocateScan,
    ReplicaStep,
    ReplicaStepResult,
    RestoreResult,
    RestoreSnapshot,
    Shutdown,
    TakeSnapshot,
    WorkerCounters,
    WorkerError,
    WorkerSnapshot,
    WorkerStep,
    encode_message,
)
from tickfix.live.replica import Replica
from tickfix.wire import decode_event
from tickfix.wire.engine_messages import decode_decision

_EXIT_TIMEOUT_S: Final = 2.0


class WorkerHandle:
    """Forks a worker that lives no longer than this process.

    Args:
        number: of the worker, counted from 0.
        work: done in the worker, with its ends of its line and of its notices, until the line is closed.
        siblings: begun before; the worker lets go of their ends.

    Attributes:
        completions: where the worker's notices come out.
    """

    def __init__(
        self, number: int, work: Callable[[Connection, Connection], None], siblings: Sequence[WorkerHandle] = ()
    ) -> None:
        """Start it."""
        sys.stdout.flush()
        sys.stderr.flush()
        self.number = number
        self._channel, channel = Pipe()
        self.completions, completions = Pipe(duplex=False)
        parent_pipe, self._parent_pipe = os.pipe()
        self._exit_code: int | None = None
        self._pid = os.fork()
        if not self._pid:
            for handle in (*siblings, self):
                handle.close()
            _run_worker(parent_pipe, lambda: work(channel, completions))
        channel.close()
        completions.close()
        os.close(parent_pipe)

    def submit(self, request: bytes) -> None:
        """Send a request.

        Raises:
            WorkerError: when the worker is gone.
        """
        try:
            self._channel.send_bytes(request)
        except OSError:
            raise self.exit_error() from None

    def response(self) -> bytes:
        """Return the answer to the oldest request that has one.

        Raises:
            WorkerError: when the worker is gone.
        """
        try:
            return self._channel.recv_bytes()
        except (EOFError, OSError):
            raise self.exit_error() from None

    def exit_error(self) -> WorkerError:
        """Return the error that says how the worker ended."""
        code = self._wait(time.monotonic() + _EXIT_TIMEOUT_S)
        how = "let go of its line" if code is None else f"ended with code {code}, see above"
        if code is not None and code < 0:
            how = f"was ended by signal {-code}"
        return WorkerError(f"worker {self.number + 1} (process {self._pid}) {how}", -min(0, code or 0))

    def join(self) -> None:
        """Wait until the worker, which was told to leave, has ended; after two seconds it is killed."""
        if self._wait(time.monotonic() + _EXIT_TIMEOUT_S) is None:
            os.kill(self._pid, signal.SIGKILL)
            self._wait(None)

    def close(self) -> None:
        """Close this process's ends: of a worker that has ended, or, in another worker, of those begun before."""
        self._channel.close()
        self.completions.close()
        os.close(self._parent_pipe)

    def _wait(self, until_s: float | None) -> int | None:
        """Return the exit code, or minus the signal; None when it is still there by then."""
        while self._exit_code is None:
            pid, status = os.waitpid(self._pid, 0 if until_s is None else os.WNOHANG)
            if pid:
                self._exit_code = os.waitstatus_to_exitcode(status)
            elif until_s is not None and time.monotonic() > until_s:
                return None
            else:
                time.sleep(0.005)
        return self._exit_code


def _run_worker(parent_pipe: int, work: Callable[[], None]) -> None:
    """Be a worker; this process ends here."""
    code = os.EX_SOFTWARE
    try:
        # Who stops the engine stops its workers: the line closes.
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, signal.SIG_IGN)
        die_with_parent(parent_pipe)
        work()
        code = 0
    except BaseException:  # noqa: BLE001 - the engine notices, and the supervisor starts another
        traceback.print_exc()
    finally:
        with suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


_POLL_S: Final = 0.25


class Worker:
    """Serves until it is told to leave, or nobody holds the other end of its line.

    Args:
        replica: its own.
        channel: requests come in by it, and answers go out.
        completions: tells of scans that are located.
        heartbeat: gets signs of life, while there is something to do.
        threads, timeout_s: of the locator.
    """

    def __init__(
        self,
        replica: Replica,
        channel: Connection,
        completions: Connection,
        heartbeat: WatchdogHeartbeat,
        *,
        threads: int,
        timeout_s: float,
    ) -> None:
        """Begin to locate; :meth:`serve` does the rest."""
        self._replica = replica
        self._channel = channel
        self._completions = completions
        self._heartbeat = heartbeat
        self._send_lock = threading.Lock()
        self._locator = LocatorThreads(
            replica.kernel.fingerprint_requests, self._send_completions, threads=threads, timeout_s=timeout_s
        )

    def serve(self) -> None:
        """Answer one request after the other."""
        # The other end closes when the engine ends, in order or not.
        with suppress(EOFError, ConnectionError):
            while True:
                self._heartbeat.mark_idle()
                ready = self._channel.poll(_POLL_S)
                self._send_completions()
                if ready and not self._handle(self._channel.recv_bytes()):
                    break
        self._locator.stop()

    def _handle(self, data: bytes) -> bool:
        """Do what is asked; return whether to go on."""
        self._heartbeat.beat()
        request = REQUEST_DECODER.decode(data)
        if isinstance(request, Shutdown):
            return False
        if isinstance(request, LocateScan):
            self._locator.submit(request.number, self._replica.waiting[request.number])
        else:
            self._channel.send_bytes(encode_message(self._respond(request)))
        return True

    def _respond(
        self, request: ApplySteps | GetCounters | TakeSnapshot | RestoreSnapshot
    ) -> list[ReplicaStepResult] | WorkerCounters | WorkerSnapshot | RestoreResult:
        if isinstance(request, ApplySteps):
            return self._apply(request.entries)
        if isinstance(request, RestoreSnapshot):
            return self._restore(request.snapshot)
        if isinstance(request, GetCounters):
            counters = self._replica.counters()
            return WorkerCounters(dict(counters.measurements), counters.missing, dict(counters.failures))
        return self._take_snapshot()

    def _apply(self, entries: list[WorkerStep]) -> list[ReplicaStepResult]:
        results: list[ReplicaStepResult] = []
        steps: list[ReplicaStep] = []
        for entry in entries:
            if isinstance(entry, EncodedEvent):
                steps.append(FeedEvent(entry.number, decode_event(entry.body)))
            elif isinstance(entry, ForgetDevice):
                results += self._replica.apply(steps)
                steps = []
                self._replica.kernel.forget(entry.device)
            else:
                steps.append(decode_decision(entry.body))
        return results + self._replica.apply(steps)

    def _take_snapshot(self) -> WorkerSnapshot:
        try:
            kept = self._replica.kernel.snapshot()
            devices = [(device.device, pack(device)) for device in kept.devices]
            return WorkerSnapshot(devices, replace(kept, devices=()).packed())
        except Exception as error:  # noqa: BLE001 - it is raised where the snapshot was asked for
            return WorkerSnapshot([], b"", f"{type(error).__name__}: {error}")

    def _restore(self, snapshot: bytes) -> RestoreResult:
        try:
            self._replica.restore(snapshot)
        except ValueError as error:
            return RestoreResult({}, str(error))
        return RestoreResult(self._replica.progress_by_device())

    def _send_completions(self) -> None:
        """Tell what is located by now; called by the threads that locate, too."""
        with self._send_lock:
            located: list[Any] = self._locator.results()
            if located:
                with suppress(ConnectionError):
                    self._completions.send_bytes(encode_message(located))
