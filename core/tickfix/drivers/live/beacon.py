"""Signs of life of an engine, in memory shared with its supervisor: when it last went round, and in which stage.

Writing one costs some hundred nanoseconds, so every call of a stage leaves its mark.
"""

from __future__ import annotations

import json
import mmap
import struct
import time
from collections.abc import Iterable
from typing import Any, Final

from tickfix.kernel import Pipeline, Stage

_HEAD: Final = struct.Struct("<qi")  # time of the last sign, place of the stage in the list
_SERVES: Final = 16
_SIZE: Final = 1 << 16
_NAMES: Final = 64


class Beacon:
    """Shared by two processes, the second of which was forked from the first."""

    def __init__(self) -> None:
        """Begin with a sign of life and no stage."""
        self._memory = mmap.mmap(-1, _SIZE)
        self._places: dict[str, int] = {}
        self.alive()

    def begin(self) -> None:
        """Prepare for another engine, which does not serve yet."""
        self._memory[_SERVES] = 0
        self.alive()

    def alive(self) -> None:
        """Leave a sign of life; no stage is being called."""
        _HEAD.pack_into(self._memory, 0, time.monotonic_ns(), -1)

    def serving(self) -> None:
        """Leave a sign that the engine has begun to serve."""
        self._memory[_SERVES] = 1
        self.alive()

    def introduce(self, pipelines: Iterable[Pipeline]) -> None:
        """Write down the stages that may be called."""
        stages: dict[str, str] = {}
        needed: dict[str, list[str]] = {}
        for pipeline in pipelines:
            found = [s for s in (pipeline.pdr, pipeline.fingerprint, pipeline.filter) if s is not None]
            stages |= {stage.key: stage.label for stage in found}
            needed[pipeline.name] = [stage.key for stage in found]
        self._places = {key: place for place, key in enumerate(stages)}
        text = json.dumps({"stages": list(stages.items()), "needed": needed}).encode()
        if _NAMES + len(text) >= _SIZE:  # absurdly many: hangs are still found, culprits are not
            self._places, text = {}, b"{}"
        self._memory[_NAMES : _NAMES + len(text) + 1] = text + b"\0"

    def calling(self, stage: Stage | None) -> None:
        """Leave a sign that ``stage`` is called now; None means that it has come back."""
        place = -1 if stage is None else self._places.get(stage.key, -1)
        _HEAD.pack_into(self._memory, 0, time.monotonic_ns(), place)

    @property
    def silence_s(self) -> float:
        """How long there was no sign."""
        last_ns: int = _HEAD.unpack_from(self._memory, 0)[0]
        return (time.monotonic_ns() - last_ns) * 1e-9

    @property
    def stage(self) -> tuple[str, str] | None:
        """Key and label of the stage that was called last, None if it came back."""
        place = _HEAD.unpack_from(self._memory, 0)[1]
        if place < 0:
            return None
        key, label = self._introduced()["stages"][place]
        return key, label

    @property
    def serves(self) -> bool:
        """Whether the engine has begun to serve."""
        return self._memory[_SERVES] != 0

    def without(self, key: str) -> list[str]:
        """Return the pipelines that do not need the stage of this key."""
        return [name for name, keys in self._introduced().get("needed", {}).items() if key not in keys]

    def _introduced(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self._memory[_NAMES:].split(b"\0", 1)[0])
        return found
