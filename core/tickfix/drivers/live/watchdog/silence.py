"""Telling an engine that hangs from one that is not let run: whether a thread of it stands ready and gets no processor.

Linux tells of every thread whether it is ready (``/proc/PID/task/TID/stat``) and how long it has run (``schedstat``).
Elsewhere all silence counts.
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
    Nor does the time between two looks for which a thread stood ready and did not run.

    Attributes:
        pid: of the process; its children count as its own.
        counted_s: the silence that counts.
    """

    pid: int
    counted_s: float = 0.0
    _looked_s: float | None = None
    _ready: dict[int, int] = field(default_factory=dict)

    def look(self, now_s: float, silent_s: float) -> float:
        """Return the silence that counts.

        Args:
            now_s: monotonic.
            silent_s: how long ago the last sign of life was; to be looked at several times a second.
        """
        passed_s = 0.0 if self._looked_s is None else now_s - self._looked_s
        self._looked_s = now_s
        before, self._ready = self._ready, {} if silent_s <= _SHORT_S else _ready(self.pid)
        starved = any(before.get(thread) == ran_ns for thread, ran_ns in self._ready.items())
        if starved or passed_s > _ASLEEP_S:
            passed_s = 0.0
        self.counted_s = min(self.counted_s + passed_s, silent_s)
        return self.counted_s


def _ready(pid: int) -> dict[int, int]:
    """Return the threads of a process and its children that are ready to run, and how long each ran so far, in ns."""
    found: dict[int, int] = {}
    for process in (pid, *_children(pid)):
        with suppress(OSError, ValueError, IndexError):
            for thread in Path(f"/proc/{process}/task").iterdir():
                if (thread / "stat").read_text().rpartition(")")[2].split()[0] == "R":
                    found[int(thread.name)] = int((thread / "schedstat").read_text().split()[0])
    return found


def _children(pid: int) -> list[int]:
    with suppress(OSError):
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return []
