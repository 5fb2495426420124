"""How processes watch each other.

Heartbeats in shared memory with the stage that runs, a stall detector that tells a hang from a process that gets no
processor, and the parent-death watch.
"""

from __future__ import annotations

import json
import mmap
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from tickfix.kernel import Pipeline, Stage


def die_with_parent(parent_pipe: int) -> None:
    """End this process as soon as nobody holds the other end of a pipe any more.

    Args:
        parent_pipe: the end to read from; nothing is ever written to the other one, and only the other process has it.
    """
    if sys.platform == "linux":
        import fcntl  # noqa: PLC0415 - Windows has none, and imports this module too

        # The kernel sends the signal: no thread is needed, which would wait for a stage that never lets others run.
        fcntl.fcntl(parent_pipe, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(parent_pipe, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(parent_pipe, fcntl.F_SETFL, fcntl.fcntl(parent_pipe, fcntl.F_GETFL) | os.O_ASYNC)
        if select.select([parent_pipe], [], [], 0)[0]:
            os.kill(os.getpid(), signal.SIGKILL)
    else:
        threading.Thread(
            target=_wait_for_parent_death, args=(parent_pipe,), name="tickfix-parent-watch", daemon=True
        ).start()


def _wait_for_parent_death(parent_pipe: int) -> None:
    os.read(parent_pipe, 1)
    os.kill(os.getpid(), signal.SIGKILL)


_SLOT_NUMBERS: Final = 2  # numbers: time of the last sign, 0 for a worker at rest; place of the stage in the list
_MEMORY_BYTES: Final = 1 << 16
MAX_WORKERS: Final = 64
_SERVING_AT: Final = 8 * _SLOT_NUMBERS * (1 + MAX_WORKERS)
_STAGES_AT: Final = _SERVING_AT + 1


class WatchdogHeartbeat:
    """Shared by processes that were forked from the one that made it.

    Args:
        memory: that of another heartbeat; None makes a new one.
        stage_index: the other's, of stages in their list.
        offset: the number in the memory where the signs are left.
    """

    def __init__(
        self, memory: mmap.mmap | None = None, stage_index: Mapping[str, int] | None = None, offset: int = 0
    ) -> None:
        """Begin with a sign of life and no stage."""
        self._memory = mmap.mmap(-1, _MEMORY_BYTES) if memory is None else memory
        self._slots = memoryview(self._memory)[:_SERVING_AT].cast("q")
        self._stage_index = {} if stage_index is None else stage_index
        self._offset = offset
        if memory is None:
            self.reset()

    def reset(self) -> None:
        """Prepare for another engine, which does not serve yet."""
        self._memory[_SERVING_AT] = 0
        self._memory[_STAGES_AT : _STAGES_AT + 3] = b"{}\0"
        for n in range(MAX_WORKERS):
            self.for_worker(n).mark_idle()
        self.beat()

    def for_worker(self, n: int) -> WatchdogHeartbeat:
        """Return the heartbeat of the worker with this number, counted from 0, in the same memory."""
        if not 0 <= n < MAX_WORKERS:
            raise ValueError(f"worker: found {n}, expected 0 to {MAX_WORKERS - 1}")
        return WatchdogHeartbeat(self._memory, self._stage_index, _SLOT_NUMBERS * (1 + n))

    def beat(self) -> None:
        """Leave a sign of life; no stage is being called."""
        self._write(time.monotonic_ns(), -1)

    def mark_idle(self) -> None:
        """Nothing is to be done: no sign is owed until the next one."""
        self._write(0, -1)

    def mark_serving(self) -> None:
        """Leave a sign that the engine has begun to serve."""
        self._memory[_SERVING_AT] = 1
        self.beat()

    def register_stages(self, pipelines: Iterable[Pipeline]) -> None:
        """Write down the stages that may be called, before there is any worker."""
        stages: dict[str, str] = {}
        needed: dict[str, list[str]] = {}
        for pipeline in pipelines:
            stages |= {stage.key: stage.label for stage in pipeline.stages}
            needed[pipeline.name] = [stage.key for stage in pipeline.stages]
        self._stage_index = {key: place for place, key in enumerate(stages)}
        text = json.dumps({"stages": list(stages.items()), "needed": needed}).encode()
        if _STAGES_AT + len(text) >= _MEMORY_BYTES:  # absurdly many: hangs are still found, culprits are not
            self._stage_index, text = {}, b"{}"
        self._memory[_STAGES_AT : _STAGES_AT + len(text) + 1] = text + b"\0"

    def enter_stage(self, stage: Stage | None) -> None:
        """Leave a sign that ``stage`` is called now; None means that it has come back."""
        place = -1 if stage is None else self._stage_index.get(stage.key, -1)
        self._write(time.monotonic_ns(), place)

    @property
    def stall_s(self) -> float:
        """How long there was no sign; while the loop waits for its workers, of the one that is silent for longest."""
        last_ns, *worker_ns = self._slots.tolist()[::_SLOT_NUMBERS]
        busy_ns = min((beat_ns for beat_ns in worker_ns if beat_ns), default=0)
        return (time.monotonic_ns() - max(last_ns, busy_ns)) * 1e-9

    @property
    def stage(self) -> tuple[str, str] | None:
        """Key and label of the stage that was called last by whom nothing was heard since; None if it came back."""
        slots = self._slots.tolist()
        called = min(
            (slot for slot in zip(slots[::_SLOT_NUMBERS], slots[1::_SLOT_NUMBERS], strict=True) if slot[1] >= 0),
            default=None,
        )
        if called is None:
            return None
        stages = self._registered().get("stages", [])
        if called[1] >= len(stages):
            return None
        key, label = stages[called[1]]
        return key, label

    @property
    def is_serving(self) -> bool:
        """Whether the engine has begun to serve."""
        return self._memory[_SERVING_AT] != 0

    def pipelines_without(self, key: str) -> list[str]:
        """Return the pipelines that do not need the stage of this key."""
        return [name for name, keys in self._registered().get("needed", {}).items() if key not in keys]

    def _registered(self) -> dict[str, Any]:
        try:
            found: dict[str, Any] = json.loads(self._memory[_STAGES_AT:].split(b"\0", 1)[0])
        except ValueError:  # it is being written, or an engine gone mad has written there
            return {}
        return found

    def _write(self, beat_ns: int, place: int) -> None:
        self._slots[self._offset + 1] = place
        self._slots[self._offset] = beat_ns


_CHECK_AFTER_S: Final = 1.0
_WATCHER_ASLEEP_S: Final = 1.0


@dataclass(slots=True)
class StallDetector:
    """How long a process has been silent though it could have spoken.

    While nobody looked for over a second, whoever looks was stopped, and so was everything else: that does not count.
    Nor does the time between two looks for which a thread stood ready and did not run.

    Attributes:
        pid: of the process; its children count as its own.
        stalled_s: the silence that counts.
    """

    pid: int
    stalled_s: float = 0.0
    _updated_s: float | None = None
    _runnable_threads: dict[int, int] = field(default_factory=dict)

    def update(self, now_s: float, silent_s: float) -> float:
        """Return the silence that counts.

        Args:
            now_s: monotonic.
            silent_s: how long ago the last sign of life was; to be looked at several times a second.
        """
        passed_s = 0.0 if self._updated_s is None else now_s - self._updated_s
        self._updated_s = now_s
        before, self._runnable_threads = (
            self._runnable_threads,
            {} if silent_s <= _CHECK_AFTER_S else _runnable_threads(self.pid),
        )
        starved = any(before.get(thread) == ran_ns for thread, ran_ns in self._runnable_threads.items())
        if starved or passed_s > _WATCHER_ASLEEP_S:
            passed_s = 0.0
        self.stalled_s = min(self.stalled_s + passed_s, silent_s)
        return self.stalled_s


def _runnable_threads(pid: int) -> dict[int, int]:
    """Return the threads of a process and its children that are ready to run, and how long each ran so far, in ns."""
    found: dict[int, int] = {}
    for process in (pid, *_child_pids(pid)):
        with suppress(OSError, ValueError, IndexError):
            for thread in Path(f"/proc/{process}/task").iterdir():
                if (thread / "stat").read_text().rpartition(")")[2].split()[0] == "R":
                    found[int(thread.name)] = int((thread / "schedstat").read_text().split()[0])
    return found


def _child_pids(pid: int) -> list[int]:
    with suppress(OSError):
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return []
