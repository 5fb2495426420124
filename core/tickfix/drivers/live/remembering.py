"""Fingerprints that remember what they answered, so that a scan may be located before the kernel asks for it.

A fingerprint's step is a pure function, so it may be computed anywhere and beforehand. :class:`Remembering` stands in
its place in the pipelines and hands out what a thread has computed; what it does not know it computes itself, so a
wrong guess about state or window costs time and never changes a result.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import replace
from hashlib import blake2b
from typing import Any, Final

from tickfix.api import Readings, Window
from tickfix.api.packing import pack
from tickfix.kernel import Pipeline, Stage

_REMEMBERED: Final = 4096


class Remembering:
    """A fingerprint that remembers its last answers; it may be asked from several threads."""

    def __init__(self, algorithm: Any) -> None:
        """Stand in for ``algorithm``."""
        self._algorithm = algorithm
        self._answers: OrderedDict[bytes, tuple[Any, BaseException | None]] = OrderedDict()
        self._lock = threading.Lock()
        self.State = algorithm.State

    @property
    def window(self) -> Window:
        """The algorithm's."""
        window: Window = self._algorithm.window
        return window

    def start(self) -> Any:
        """Return the algorithm's first state."""
        return self._algorithm.start()

    def step(self, state: Any, window: Readings) -> Any:
        """Return what the algorithm returns, or raise what it raises, from memory where it was asked before."""
        key = question_key(state, window)
        with self._lock:
            known = self._answers.get(key)
        if known is None:
            try:
                known = self._algorithm.step(state, window), None
            except Exception as raised:  # noqa: BLE001 - it is raised again, here and whenever it is asked again
                known = None, raised
            with self._lock:
                self._answers[key] = known
                while len(self._answers) > _REMEMBERED:
                    self._answers.popitem(last=False)
        answer, error = known
        if error is not None:
            raise error
        return answer


def question_key(state: Any, window: Readings) -> bytes:
    """Return a digest of what a fingerprint is asked."""
    parts = (window.t_ns, window.transmitters, window.scan_t_ns, window.source)
    digest = blake2b(pack(state), digest_size=16)
    digest.update(repr(parts).encode("utf-8", "surrogatepass"))
    for array in (window.rssi_dbm, window.heard_ns, window.scan):
        digest.update(array.tobytes())
    return digest.digest()


def remembering(pipelines: Sequence[Pipeline]) -> tuple[Pipeline, ...]:
    """Return the pipelines with their fingerprints remembering; those that are shared stay shared."""
    made: dict[str, Stage] = {}

    def stage(found: Stage) -> Stage:
        if found.key not in made:
            made[found.key] = replace(found, algorithm=Remembering(found.algorithm))
        return made[found.key]

    return tuple(p if p.fingerprint is None else replace(p, fingerprint=stage(p.fingerprint)) for p in pipelines)
