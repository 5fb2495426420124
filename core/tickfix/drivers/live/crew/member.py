"""A worker's process, as the engine holds it."""

from __future__ import annotations

import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from typing import Final

from tickfix.drivers.live.errors import WorkerError
from tickfix.drivers.live.watchdog.lifeline import die_with

_PATIENCE_S: Final = 2.0


class Member:
    """Forks a worker that lives no longer than this process.

    Args:
        number: of the worker, counted from 0.
        work: done in the worker, with its ends of its line and of its notices, until the line is closed.
        others: begun before; the worker lets go of their ends.

    Attributes:
        notices: where the worker's notices come out.
    """

    def __init__(
        self, number: int, work: Callable[[Connection, Connection], None], others: Sequence[Member] = ()
    ) -> None:
        """Start it."""
        sys.stdout.flush()
        sys.stderr.flush()
        self.number = number
        self._line, line = Pipe()
        self.notices, notices = Pipe(duplex=False)
        lifeline, self._lifeline = os.pipe()
        self._ended: int | None = None
        self._pid = os.fork()
        if not self._pid:
            for member in (*others, self):
                member.let_go()
            _live(lifeline, lambda: work(line, notices))
        line.close()
        notices.close()
        os.close(lifeline)

    def ask(self, request: bytes) -> None:
        """Send a request.

        Raises:
            WorkerError: when the worker is gone.
        """
        try:
            self._line.send_bytes(request)
        except OSError:
            raise self.gone() from None

    def answer(self) -> bytes:
        """Return the answer to the oldest request that has one.

        Raises:
            WorkerError: when the worker is gone.
        """
        try:
            return self._line.recv_bytes()
        except (EOFError, OSError):
            raise self.gone() from None

    def gone(self) -> WorkerError:
        """Return the error that says how the worker ended."""
        code = self._wait(time.monotonic() + _PATIENCE_S)
        how = "let go of its line" if code is None else f"ended with code {code}, see above"
        if code is not None and code < 0:
            how = f"was ended by signal {-code}"
        return WorkerError(f"worker {self.number + 1} (process {self._pid}) {how}", -min(0, code or 0))

    def join(self) -> None:
        """Wait until the worker, which was told to leave, has ended; after two seconds it is killed."""
        if self._wait(time.monotonic() + _PATIENCE_S) is None:
            os.kill(self._pid, signal.SIGKILL)
            self._wait(None)

    def let_go(self) -> None:
        """Close this process's ends: of a worker that has ended, or, in another worker, of those begun before."""
        self._line.close()
        self.notices.close()
        os.close(self._lifeline)

    def _wait(self, until_s: float | None) -> int | None:
        """Return the exit code, or minus the signal; None when it is still there by then."""
        while self._ended is None:
            pid, status = os.waitpid(self._pid, 0 if until_s is None else os.WNOHANG)
            if pid:
                self._ended = os.waitstatus_to_exitcode(status)
            elif until_s is not None and time.monotonic() > until_s:
                return None
            else:
                time.sleep(0.005)
        return self._ended


def _live(lifeline: int, work: Callable[[], None]) -> None:
    """Be a worker; this process ends here."""
    code = os.EX_SOFTWARE
    try:
        # Who stops the engine stops its workers: the line closes.
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, signal.SIG_IGN)
        die_with(lifeline)
        work()
        code = 0
    except BaseException:  # noqa: BLE001 - the engine notices, and the supervisor starts another
        traceback.print_exc()
    finally:
        with suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)
