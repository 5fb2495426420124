"""Signs of life of an engine, in memory shared with its supervisor: when it last went round, and in which stage.

Writing one costs some hundred nanoseconds, so every call of a stage leaves its mark. Each worker of an engine has a
place of its own; while it rests it owes no sign. Signs are whole numbers of 64 bits, each written at once: a reader
never sees half of one (``struct.pack_into`` would clear the place first, and a time of 0 looks like a long silence).
"""

from __future__ import annotations

import json
import mmap
import time
from collections.abc import Iterable, Mapping
from typing import Any, Final

from tickfix.kernel import Pipeline, Stage

_SIGN: Final = 2  # numbers: time of the last sign, 0 for a worker at rest; place of the stage in the list
_SIZE: Final = 1 << 16
WORKERS: Final = 64
_SERVES: Final = 8 * _SIGN * (1 + WORKERS)
_NAMES: Final = _SERVES + 1


class Beacon:
    """Shared by processes that were forked from the one that made it.

    Args:
        memory: another beacon's; None makes a new one.
        places: the other's, of stages in their list.
        at: the number in the memory where the signs are left.
    """

    def __init__(self, memory: mmap.mmap | None = None, places: Mapping[str, int] | None = None, at: int = 0) -> None:
        """Begin with a sign of life and no stage."""
        self._memory = mmap.mmap(-1, _SIZE) if memory is None else memory
        self._signs = memoryview(self._memory)[:_SERVES].cast("q")
        self._places = {} if places is None else places
        self._at = at
        if memory is None:
            self.begin()

    def begin(self) -> None:
        """Prepare for another engine, which does not serve yet."""
        self._memory[_SERVES] = 0
        self._memory[_NAMES : _NAMES + 3] = b"{}\0"
        for n in range(WORKERS):
            self.of_worker(n).rest()
        self.alive()

    def of_worker(self, n: int) -> Beacon:
        """Return the beacon of the worker with this number, counted from 0, in the same memory."""
        if not 0 <= n < WORKERS:
            raise ValueError(f"worker: found {n}, expected 0 to {WORKERS - 1}")
        return Beacon(self._memory, self._places, _SIGN * (1 + n))

    def alive(self) -> None:
        """Leave a sign of life; no stage is being called."""
        self._sign(time.monotonic_ns(), -1)

    def rest(self) -> None:
        """Nothing is to be done: no sign is owed until the next one."""
        self._sign(0, -1)

    def serving(self) -> None:
        """Leave a sign that the engine has begun to serve."""
        self._memory[_SERVES] = 1
        self.alive()

    def introduce(self, pipelines: Iterable[Pipeline]) -> None:
        """Write down the stages that may be called, before there is any worker."""
        stages: dict[str, str] = {}
        needed: dict[str, list[str]] = {}
        for pipeline in pipelines:
            stages |= {stage.key: stage.label for stage in pipeline.stages}
            needed[pipeline.name] = [stage.key for stage in pipeline.stages]
        self._places = {key: place for place, key in enumerate(stages)}
        text = json.dumps({"stages": list(stages.items()), "needed": needed}).encode()
        if _NAMES + len(text) >= _SIZE:  # absurdly many: hangs are still found, culprits are not
            self._places, text = {}, b"{}"
        self._memory[_NAMES : _NAMES + len(text) + 1] = text + b"\0"

    def calling(self, stage: Stage | None) -> None:
        """Leave a sign that ``stage`` is called now; None means that it has come back."""
        place = -1 if stage is None else self._places.get(stage.key, -1)
        self._sign(time.monotonic_ns(), place)

    @property
    def silence_s(self) -> float:
        """How long there was no sign; while the loop waits for its workers, of the one that is silent for longest."""
        last_ns, *worker_ns = self._signs.tolist()[::_SIGN]
        busy_ns = min((signed_ns for signed_ns in worker_ns if signed_ns), default=0)
        return (time.monotonic_ns() - max(last_ns, busy_ns)) * 1e-9

    @property
    def stage(self) -> tuple[str, str] | None:
        """Key and label of the stage that was called last by whom nothing was heard since; None if it came back."""
        signs = self._signs.tolist()
        called = min((sign for sign in zip(signs[::_SIGN], signs[1::_SIGN], strict=True) if sign[1] >= 0), default=None)
        if called is None:
            return None
        stages = self._introduced().get("stages", [])
        if called[1] >= len(stages):
            return None
        key, label = stages[called[1]]
        return key, label

    @property
    def serves(self) -> bool:
        """Whether the engine has begun to serve."""
        return self._memory[_SERVES] != 0

    def without(self, key: str) -> list[str]:
        """Return the pipelines that do not need the stage of this key."""
        return [name for name, keys in self._introduced().get("needed", {}).items() if key not in keys]

    def _introduced(self) -> dict[str, Any]:
        try:
            found: dict[str, Any] = json.loads(self._memory[_NAMES:].split(b"\0", 1)[0])
        except ValueError:  # it is being written, or an engine gone mad has written there
            return {}
        return found

    def _sign(self, signed_ns: int, place: int) -> None:
        self._signs[self._at + 1] = place
        self._signs[self._at] = signed_ns
