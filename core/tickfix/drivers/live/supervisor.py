"""The watchdog: an engine in a process of its own, restarted when it hangs or dies.

Python cannot stop a call that hangs, but another process can end the one that called. The new engine goes on from the
journal, without the stage in which the old one hung.
"""

from __future__ import annotations

import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from tickfix.drivers.live.beacon import Beacon
from tickfix.drivers.live.errors import EngineError
from tickfix.drivers.live.lifeline import die_with
from tickfix.drivers.live.serving import Order

_LOOK_S: Final = 0.05
CRASHED: Final = 70
"""Exit code of an engine that failed in a way nobody foresaw (EX_SOFTWARE)."""
_RESTARTS: Final = 5
_SPAN_S: Final = 60.0


@dataclass(slots=True)
class _Child:
    pid: int
    lifeline: int
    hung: bool = False


def supervise(
    order: Order, engine: Callable[[Order, Beacon], int], *, silence_s: float, tell: Callable[[str], None]
) -> int:
    """Run an engine in a child, and another one whenever it hangs or is killed; return its exit code.

    Args:
        order: what to serve.
        engine: runs in the child until it is told to stop, by SIGTERM for one; returns the exit code.
        silence_s: no sign of life for so long is a hang.
        tell: told, in a sentence, what an operator must know.

    Raises:
        EngineError: when one engine after the other dies.
    """
    beacon = Beacon()
    deaths: list[float] = []
    child = _start(order, engine, beacon)

    def pass_on(number: int, _: object) -> None:
        os.kill(child.pid, number)

    before = {number: signal.signal(number, pass_on) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        while True:
            code = _wait(child, beacon, silence_s)
            if code >= 0 and code != CRASHED and not child.hung:
                return code
            deaths = [t for t in deaths if time.monotonic() - t < _SPAN_S] + [time.monotonic()]
            if len(deaths) > _RESTARTS:
                raise EngineError(f"the engine died {len(deaths)} times within {_SPAN_S:g} s; giving up")
            order = _after(order, child, beacon, silence_s, code, tell)
            beacon.alive()
            child = _start(order, engine, beacon)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _after(
    order: Order, child: _Child, beacon: Beacon, silence_s: float, code: int, tell: Callable[[str], None]
) -> Order:
    """Say what happened and return what to serve next."""
    resumes = "resuming from the journal" if order.journal is not None else "starting anew: there is no journal"
    if not child.hung:
        how = "crashed, see above" if code == CRASHED else f"was ended by signal {-code}"
        tell(f"the engine {how}; {resumes}")
        return replace(order, resume=order.journal is not None)
    culprit = beacon.stage
    if culprit is None:
        tell(f"the engine gave no sign of life for {silence_s:g} s, outside any stage; killed it, {resumes}")
        return replace(order, resume=order.journal is not None)
    key, label = culprit
    tell(f"the engine hung in {label} for {silence_s:g} s; killed it, {resumes}, without pipelines that need {label}")
    disabled = {**order.disabled, key: f"hung for {silence_s:g} s"}
    return replace(order, resume=order.journal is not None, disabled=disabled)


def _start(order: Order, engine: Callable[[Order, Beacon], int], beacon: Beacon) -> _Child:
    sys.stdout.flush()
    sys.stderr.flush()
    ours, theirs = os.pipe()
    pid = os.fork()
    if pid:
        os.close(ours)
        return _Child(pid, theirs)
    os.close(theirs)
    code = CRASHED
    try:
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, signal.SIG_DFL)
        die_with(ours)
        code = engine(order, beacon)
    except Exception:  # noqa: BLE001 - this process ends here, and the supervisor starts another
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _wait(child: _Child, beacon: Beacon, silence_s: float) -> int:
    """Wait for the child's end; kill it when it hangs. Return the exit code, or minus the signal."""
    while True:
        pid, status = os.waitpid(child.pid, os.WNOHANG)
        if pid:
            os.close(child.lifeline)
            return os.waitstatus_to_exitcode(status)
        if not child.hung and beacon.silence_s > silence_s:
            child.hung = True
            os.kill(child.pid, signal.SIGKILL)
        time.sleep(_LOOK_S)
