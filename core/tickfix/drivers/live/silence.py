"""Telling an engine that hangs from one that is not let run: by the time that its threads wait for a processor.

Linux tells, for every thread, how long it stood ready and got none (``/proc/PID/task/TID/schedstat``, the second
number). Elsewhere all silence counts.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

_SHORT_S: Final = 1.0
_ASLEEP_S: Final = 1.0


@dataclass(slots=True)
class Silence:
    """How long a process has been silent though it could have spoken.

    While nobody looked for over a second, whoever looks was stopped, and so was everything else: that does not count.
    Nor does the time for which the thread that waited longest got no processor.

    Attributes:
        pid: of the process; its children count as its own.
        counted_s: the silence that counts.
    """

    pid: int
    counted_s: float = 0.0
    _looked_s: float | None = None
    _waited_ns: dict[int, int] = field(default_factory=dict)

    def look(self, now_s: float, silent_s: float) -> float:
        """Return the silence that counts.

        Args:
            now_s: monotonic.
            silent_s: how long ago the last sign of life was; to be looked at several times a second.
        """
        passed_s = 0.0 if self._looked_s is None else now_s - self._looked_s
        self._looked_s = now_s
        if passed_s > _ASLEEP_S:
            passed_s = 0.0
        if silent_s <= _SHORT_S:
            self._waited_ns.clear()
        else:
            passed_s = max(0.0, passed_s - self._starved_s())
        self.counted_s = min(self.counted_s + passed_s, silent_s)
        return self.counted_s

    def _starved_s(self) -> float:
        """Return for how long a thread waited for a processor since the last look, of all threads the longest."""
        before, self._waited_ns = self._waited_ns, _waited_ns(self.pid)
        return max((ns - before.get(thread, ns) for thread, ns in self._waited_ns.items()), default=0) * 1e-9


def _waited_ns(pid: int) -> dict[int, int]:
    """Return how long each thread of a process and of its children has waited for a processor so far."""
    found: dict[int, int] = {}
    for process in (pid, *_children(pid)):
        with suppress(OSError, ValueError, IndexError):
            for thread in Path(f"/proc/{process}/task").iterdir():
                found[int(thread.name)] = int((thread / "schedstat").read_text().split()[1])
    return found


def _children(pid: int) -> list[int]:
    with suppress(OSError):
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return []
