"""The watchdog: an engine in a process of its own, restarted when it hangs or dies.

Python cannot stop a call that hangs, but another process can end the one that called. The new engine goes on from the
journal, without the stage in which the old one hung, as long as some pipeline is left without it. An engine that has
served once is never given up: it is started again after pauses that grow, until somebody stops it.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Final

from tickfix.live.heartbeat import StallDetector, WatchdogHeartbeat, die_with_parent
from tickfix.live.protocol import EngineError
from tickfix.live.serve_options import ServeOptions

_LOGGER = logging.getLogger(__name__)

_POLL_S: Final = 0.05
EXIT_FINAL: Final = 3
"""Exit code of an engine that ended because its overrun policy is ``fail``: it is not started again."""
EXIT_CRASHED: Final = 70
"""Exit code of an engine that failed in an unforeseen way (EX_SOFTWARE)."""
_WINDOW_S: Final = 60.0
_IMMEDIATE_RESTARTS: Final = 3
_MAX_BACKOFF_S: Final = 60.0
_MAX_FAILED_STARTS: Final = 5
_START_TIMEOUT_S: Final = 60.0
"""An engine that does not serve yet, and calls no stage, may be silent for so long: it loads a site."""
_MAX_QUICK_FAILURES: Final = 3
"""Engines that break soon after they went on from the journal, one after the other, before one starts a new run."""
_QUICK_FAILURE_S: Final = 60.0
CRASH_SIGNALS: Final = frozenset(
    getattr(signal, name) for name in ("SIGSEGV", "SIGABRT", "SIGBUS", "SIGFPE", "SIGILL") if hasattr(signal, name)
)
"""Signals that a process raises by a fault of its own; Windows has no SIGBUS."""


@dataclass(slots=True)
class _EngineProcess:
    pid: int
    parent_pipe: int
    started_s: float
    hung: bool = False


@dataclass(slots=True)
class _EngineHistory:
    """What became of the engines so far.

    Attributes:
        served: one of them has served.
        deaths: when they died, within the last minute.
        quick_failures: so many in a row broke soon after they went on from the journal.
        crashes_by_stage: how often one died of a signal of its own in a stage, by the stage's key.
    """

    served: bool = False
    deaths: list[float] = field(default_factory=list)
    quick_failures: int = 0
    crashes_by_stage: Counter[str] = field(default_factory=Counter)

    def record_exit(self, now_s: float, code: int, child: _EngineProcess, heartbeat: WatchdogHeartbeat) -> None:
        """Record that an engine ended."""
        self.served |= heartbeat.is_serving
        self.deaths = [t for t in self.deaths if now_s - t < _WINDOW_S + _MAX_BACKOFF_S] + [now_s]
        # One that says why it cannot go on may be able to later: the disk is full, say. One that is killed from outside
        # says nothing about the journal.
        broke = child.hung or -code in CRASH_SIGNALS or (code == EXIT_CRASHED and not heartbeat.is_serving)
        self.quick_failures = self.quick_failures + 1 if broke and now_s - child.started_s < _QUICK_FAILURE_S else 0

    @property
    def backoff_s(self) -> float:
        """How long to wait before the next one."""
        further = len(self.deaths) - _IMMEDIATE_RESTARTS
        return min(_MAX_BACKOFF_S, 2.0 ** (further - 1)) if further > 0 else 0.0


def supervise(
    options: ServeOptions,
    engine: Callable[[ServeOptions, WatchdogHeartbeat], int],
    *,
    stall_s: float,
) -> int:
    """Run an engine in a child, and another one whenever it hangs or breaks; return its exit code.

    It ends when an engine ends in order, when it is told to by SIGTERM or SIGINT, and when an engine says that it
    cannot begin and none has served: that is for people to mend.

    Args:
        options: what to serve.
        engine: runs in the child until it is stopped, by SIGTERM for example; returns the exit code.
        stall_s: no sign of life for so long is a hang.

    Raises:
        EngineError: when one engine after the other dies and none has ever served.
    """
    heartbeat, history, stopping = WatchdogHeartbeat(), _EngineHistory(), False
    child = _start_engine(options, engine, heartbeat)

    def forward_signal(number: int, _: object) -> None:
        nonlocal stopping
        stopping = True
        with suppress(ProcessLookupError):
            os.kill(child.pid, number)

    before = {number: signal.signal(number, forward_signal) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        while True:
            code = _wait_for_exit(child, heartbeat, stall_s)
            history.record_exit(time.monotonic(), code, child, heartbeat)
            if stopping:
                return max(code, 0)
            if code in (0, EXIT_FINAL) or (code > 0 and code != EXIT_CRASHED and not history.served):
                return code
            if not history.served and len(history.deaths) > _MAX_FAILED_STARTS:
                raise EngineError(f"the engine died {len(history.deaths)} times before it ever served; giving up")
            options = _next_options(options, child, heartbeat, history, stall_s, code)
            until_s = time.monotonic() + history.backoff_s
            while time.monotonic() < until_s:
                if stopping:
                    return 0
                time.sleep(_POLL_S)
            heartbeat.reset()
            child = _start_engine(options, engine, heartbeat)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _next_options(
    options: ServeOptions,
    child: _EngineProcess,
    heartbeat: WatchdogHeartbeat,
    history: _EngineHistory,
    stall_s: float,
    code: int,
) -> ServeOptions:
    """Log what happened and return what to serve next."""
    stage = heartbeat.stage
    key, label = ("", "outside any stage") if stage is None else (stage[0], f"in {stage[1]}")
    if child.hung:
        how = f"hung {label} for {stall_s:g} s; killed it"
        if stage is None:
            how = f"gave no sign of life for {stall_s:g} s, {label}; killed it"
    elif code == EXIT_CRASHED:
        how = "crashed, see above"
    elif code < 0:
        history.crashes_by_stage[key] += -code in CRASH_SIGNALS
        how = f"was ended by signal {-code}" if stage is None else f"was ended by signal {-code} {label}"
    else:
        how = f"could not go on, see above (exit code {code})"
    resumes = options.journal is not None and history.quick_failures < _MAX_QUICK_FAILURES
    disabled = options.disabled
    found = [f"the engine {how}"]
    if not resumes and options.journal is not None:
        history.quick_failures = 0
        found.append(
            f"{_MAX_QUICK_FAILURES} in a row broke soon after they went on from the journal: a new run "
            "begins, the old one is kept"
        )
    else:
        found.append("resuming from the journal" if resumes else "starting a new run: there is no journal")
    # Signals come from outside, too; twice in one stage is no chance.
    if stage is not None and (child.hung or (-code in CRASH_SIGNALS and history.crashes_by_stage[key] > 1)):
        if heartbeat.pipelines_without(key):
            disabled = {**disabled, key: f"hung for {stall_s:g} s" if child.hung else f"died by signal {-code}"}
            found.append(f"without pipelines that need {stage[1]}")
        else:
            found.append(f"with {stage[1]} all the same: no pipeline would be left without it")
    if history.backoff_s:
        found.append(f"in {history.backoff_s:g} s")
    _LOGGER.error("%s; %s", found[0], ", ".join(found[1:]), extra={"code": "engine_restarted"})
    return replace(options, resume=resumes, disabled=disabled)


def _start_engine(
    options: ServeOptions, engine: Callable[[ServeOptions, WatchdogHeartbeat], int], heartbeat: WatchdogHeartbeat
) -> _EngineProcess:
    sys.stdout.flush()
    sys.stderr.flush()
    ours, theirs = os.pipe()
    pid = os.fork()
    if pid:
        os.close(ours)
        return _EngineProcess(pid, theirs, time.monotonic())
    os.close(theirs)
    code = EXIT_CRASHED
    try:
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, signal.SIG_DFL)
        die_with_parent(ours)
        code = engine(options, heartbeat)
    except Exception:
        _LOGGER.critical("the engine crashed", exc_info=True, extra={"code": "engine_crashed"})
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _wait_for_exit(child: _EngineProcess, heartbeat: WatchdogHeartbeat, stall_s: float) -> int:
    """Wait for the child's end; kill it when it hangs. Return the exit code, or minus the signal."""
    stall_detector = StallDetector(child.pid)
    while True:
        pid, status = os.waitpid(child.pid, os.WNOHANG)
        if pid:
            os.close(child.parent_pipe)
            return os.waitstatus_to_exitcode(status)
        silent_s = stall_detector.update(time.monotonic(), heartbeat.stall_s)
        starting = not heartbeat.is_serving and heartbeat.stage is None
        timeout_s = max(stall_s, _START_TIMEOUT_S) if starting else stall_s
        if not child.hung and silent_s > timeout_s:
            child.hung = True
            os.kill(child.pid, signal.SIGKILL)
        time.sleep(_POLL_S)
