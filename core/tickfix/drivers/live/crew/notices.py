"""What workers tell unasked: which scans are located, and that one of them is gone."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from multiprocessing.connection import wait

from tickfix.api import Scan
from tickfix.drivers.live.crew.member import Member
from tickfix.drivers.live.crew.messages import NOTICES, Locate, encode
from tickfix.drivers.live.locating import Located


class Notices:
    """Has scans located by the workers, and hears of it in a thread of its own.

    Args:
        members: the workers.
        owner: the number of the worker that a device belongs to.
        wake: called, from that thread, when there is something to hear.
    """

    def __init__(self, members: Sequence[Member], owner: Callable[[str], int], wake: Callable[[], None]) -> None:
        """Start the thread."""
        self._members = members
        self._owner = owner
        self._wake = wake
        self._lock = threading.Lock()
        self._asked: set[int] = set()
        self._done: list[Located] = []
        self._gone: Member | None = None
        self._thread = threading.Thread(target=self._listen, name="tickfix-notices", daemon=True)
        self._thread.start()

    def ask(self, number: int, scan: Scan) -> None:
        """Have the worker locate the scan of record ``number``, which waits there.

        Raises:
            WorkerError: when the worker is gone.
        """
        self._asked.add(number)
        self._members[self._owner(scan.device)].ask(encode(Locate(number)))

    def done(self) -> list[Located]:
        """Return what was located or given up since the last call."""
        with self._lock:
            done, self._done = self._done, []
        self._asked.difference_update(located.number for located in done)
        return done

    @property
    def waiting(self) -> int:
        """How many scans are neither."""
        return len(self._asked)

    def stop(self) -> None:
        """Let go of what is not done; the workers' threads end with them."""

    def check(self) -> None:
        """Look after the workers.

        Raises:
            WorkerError: when one is gone.
        """
        if self._gone is not None:
            raise self._gone.gone()

    def join(self) -> None:
        """Wait for the thread, which ends with the last worker."""
        self._thread.join()

    def _listen(self) -> None:
        members = {member.notices: member for member in self._members}
        while members:
            for found in wait(list(members)):
                member = next(m for connection, m in members.items() if connection is found)
                try:
                    located = NOTICES.decode(member.notices.recv_bytes())
                except (EOFError, OSError):
                    del members[member.notices]
                    self._gone = self._gone or member
                else:
                    with self._lock:
                        self._done += located
                self._wake()
