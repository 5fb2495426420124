"""A worker: a process with a replica of its own, which does what its crew tells it."""

from __future__ import annotations

import threading
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any, Final

from tickfix.api.packing import pack
from tickfix.drivers.live.crew.messages import (
    REQUESTS,
    Apply,
    Count,
    Enter,
    Entry,
    Forget,
    Leave,
    Load,
    Loaded,
    Locate,
    Save,
    Saved,
    Tally,
    encode,
)
from tickfix.drivers.live.folding import Done, Feed, Step
from tickfix.drivers.live.locating import Locator
from tickfix.drivers.live.replica import Replica
from tickfix.drivers.live.watchdog.beacon import Beacon
from tickfix.wire import decode_event
from tickfix.wire.decisions import decode_decision

_LOOK_S: Final = 0.25


class Worker:
    """Serves until it is told to leave, or nobody holds the other end of its line.

    Args:
        replica: its own.
        line: requests come in by it, and answers go out.
        notices: tells of scans that are located.
        beacon: gets signs of life, while there is something to do.
        threads, timeout_s: of the locator.
    """

    def __init__(
        self, replica: Replica, line: Connection, notices: Connection, beacon: Beacon, *, threads: int, timeout_s: float
    ) -> None:
        """Begin to locate; :meth:`serve` does the rest."""
        self._replica = replica
        self._line = line
        self._notices = notices
        self._beacon = beacon
        self._telling = threading.Lock()
        self._locator = Locator(replica.kernel.questions, self._tell, threads=threads, timeout_s=timeout_s)

    def serve(self) -> None:
        """Answer one request after the other."""
        # The other end closes when the engine ends, in order or not.
        with suppress(EOFError, ConnectionError):
            while True:
                self._beacon.rest()
                ready = self._line.poll(_LOOK_S)
                self._tell()
                if ready and not self._do(self._line.recv_bytes()):
                    break
        self._locator.stop()

    def _do(self, data: bytes) -> bool:
        """Do what is asked; return whether to go on."""
        self._beacon.alive()
        request = REQUESTS.decode(data)
        if isinstance(request, Leave):
            return False
        if isinstance(request, Locate):
            self._locator.ask(request.number, self._replica.waiting[request.number])
        else:
            self._line.send_bytes(encode(self._answer(request)))
        return True

    def _answer(self, request: Apply | Count | Save | Load) -> list[Done] | Tally | Saved | Loaded:
        if isinstance(request, Apply):
            return self._applied(request.entries)
        if isinstance(request, Load):
            return self._loaded(request.snapshot)
        if isinstance(request, Count):
            books = self._replica.books()
            return Tally(dict(books.measurements), books.missing, dict(books.failures))
        return self._saved()

    def _applied(self, entries: list[Entry]) -> list[Done]:
        done: list[Done] = []
        steps: list[Step] = []
        for entry in entries:
            if isinstance(entry, Enter):
                steps.append(Feed(entry.number, decode_event(entry.body)))
            elif isinstance(entry, Forget):
                done += self._replica.apply(steps)
                steps = []
                self._replica.kernel.forget(entry.device)
            else:
                steps.append(decode_decision(entry.body))
        return done + self._replica.apply(steps)

    def _saved(self) -> Saved:
        try:
            kept = self._replica.kernel.snapshot()
            devices = [(device.device, pack(device)) for device in kept.devices]
            return Saved(devices, replace(kept, devices=()).packed())
        except Exception as error:  # noqa: BLE001 - it is raised where the snapshot was asked for
            return Saved([], b"", f"{type(error).__name__}: {error}")

    def _loaded(self, snapshot: bytes) -> Loaded:
        try:
            self._replica.restore(snapshot)
        except ValueError as error:
            return Loaded({}, str(error))
        return Loaded(self._replica.standings())

    def _tell(self) -> None:
        """Tell what is located by now; called by the threads that locate, too."""
        with self._telling:
            located: list[Any] = self._locator.done()
            if located:
                with suppress(ConnectionError):
                    self._notices.send_bytes(encode(located))
