"""The watchdog: an engine in a process of its own, restarted when it hangs or dies.

Python cannot stop a call that hangs, but another process can end the one that called. The new engine goes on from the
journal, without the stage in which the old one hung, as long as some pipeline is left without it. An engine that has
served once is never given up: it is started again after pauses that grow, until somebody stops it.
"""

from __future__ import annotations

import os
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Final

from tickfix.drivers.live.errors import EngineError
from tickfix.drivers.live.order import Order
from tickfix.drivers.live.watchdog.beacon import Beacon
from tickfix.drivers.live.watchdog.lifeline import die_with
from tickfix.drivers.live.watchdog.silence import Silence

_LOOK_S: Final = 0.05
ENDED: Final = 3
"""Exit code of an engine that ended as it was told to for such a case: nobody starts it again."""
CRASHED: Final = 70
"""Exit code of an engine that failed in a way nobody foresaw (EX_SOFTWARE)."""
_SPAN_S: Final = 60.0
_AT_ONCE: Final = 3
_PAUSE_S: Final = 60.0
_GIVEN_UP: Final = 5
_STARTING_S: Final = 60.0
"""An engine that does not serve yet, and calls no stage, may be silent for so long: it loads a site."""
_TRIES: Final = 3
"""Engines that break soon after they went on from the journal, one after the other, before one begins a run anew."""
_SOON_S: Final = 60.0
OWN: Final = frozenset({signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL})
"""Signals that a process brings upon itself."""


@dataclass(slots=True)
class _Child:
    pid: int
    lifeline: int
    begun_s: float
    hung: bool = False


@dataclass(slots=True)
class _Past:
    """What became of the engines so far.

    Attributes:
        served: one of them has served.
        deaths: when they died, within the last minute.
        fruitless: so many in a row broke soon after they went on from the journal.
        died_in: how often one died of a signal of its own in a stage, by the stage's key.
    """

    served: bool = False
    deaths: list[float] = field(default_factory=list)
    fruitless: int = 0
    died_in: Counter[str] = field(default_factory=Counter)

    def died(self, now_s: float, code: int, child: _Child, beacon: Beacon) -> None:
        """Take note of an engine's end."""
        self.served |= beacon.serves
        self.deaths = [t for t in self.deaths if now_s - t < _SPAN_S + _PAUSE_S] + [now_s]
        # One that says why it cannot go on may be able to later: the disk is full, say. One that is killed from outside
        # says nothing about the journal.
        broke = child.hung or -code in OWN or (code == CRASHED and not beacon.serves)
        self.fruitless = self.fruitless + 1 if broke and now_s - child.begun_s < _SOON_S else 0

    @property
    def pause_s(self) -> float:
        """How long to wait before the next one."""
        further = len(self.deaths) - _AT_ONCE
        return min(_PAUSE_S, 2.0 ** (further - 1)) if further > 0 else 0.0


def supervise(
    order: Order, engine: Callable[[Order, Beacon], int], *, silence_s: float, tell: Callable[[str], None]
) -> int:
    """Run an engine in a child, and another one whenever it hangs or breaks; return its exit code.

    It ends when an engine ends in order, when it is told to by SIGTERM or SIGINT, and when an engine says that it
    cannot begin and none has served: that is for people to mend.

    Args:
        order: what to serve.
        engine: runs in the child until it is told to stop, by SIGTERM for one; returns the exit code.
        silence_s: no sign of life for so long is a hang.
        tell: told, in a sentence, what an operator must know.

    Raises:
        EngineError: when one engine after the other dies and none has ever served.
    """
    beacon, past, stopping = Beacon(), _Past(), False
    child = _start(order, engine, beacon)

    def pass_on(number: int, _: object) -> None:
        nonlocal stopping
        stopping = True
        with suppress(ProcessLookupError):
            os.kill(child.pid, number)

    before = {number: signal.signal(number, pass_on) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        while True:
            code = _wait(child, beacon, silence_s)
            past.died(time.monotonic(), code, child, beacon)
            if stopping:
                return max(code, 0)
            if code in (0, ENDED) or (code > 0 and code != CRASHED and not past.served):
                return code
            if not past.served and len(past.deaths) > _GIVEN_UP:
                raise EngineError(f"the engine died {len(past.deaths)} times before it ever served; giving up")
            order = _after(order, child, beacon, past, silence_s, code, tell)
            until_s = time.monotonic() + past.pause_s
            while time.monotonic() < until_s:
                if stopping:
                    return 0
                time.sleep(_LOOK_S)
            beacon.begin()
            child = _start(order, engine, beacon)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _after(
    order: Order,
    child: _Child,
    beacon: Beacon,
    past: _Past,
    silence_s: float,
    code: int,
    tell: Callable[[str], None],
) -> Order:
    """Say what happened and return what to serve next."""
    stage = beacon.stage
    key, label = ("", "outside any stage") if stage is None else (stage[0], f"in {stage[1]}")
    if child.hung:
        how = f"hung {label} for {silence_s:g} s; killed it"
        if stage is None:
            how = f"gave no sign of life for {silence_s:g} s, {label}; killed it"
    elif code == CRASHED:
        how = "crashed, see above"
    elif code < 0:
        past.died_in[key] += -code in OWN
        how = f"was ended by signal {-code}" if stage is None else f"was ended by signal {-code} {label}"
    else:
        how = f"could not go on, see above (exit code {code})"
    resumes = order.journal is not None and past.fruitless < _TRIES
    disabled = order.disabled
    found = [f"the engine {how}"]
    if not resumes and order.journal is not None:
        past.fruitless = 0
        found.append(
            f"{_TRIES} in a row broke soon after they went on from the journal: a new run begins, the old one is kept"
        )
    else:
        found.append("resuming from the journal" if resumes else "starting anew: there is no journal")
    # Signals come from outside, too; twice in one stage is no chance.
    if stage is not None and (child.hung or (-code in OWN and past.died_in[key] > 1)):
        if beacon.without(key):
            disabled = {**disabled, key: f"hung for {silence_s:g} s" if child.hung else f"died by signal {-code}"}
            found.append(f"without pipelines that need {stage[1]}")
        else:
            found.append(f"with {stage[1]} all the same: no pipeline would be left without it")
    if past.pause_s:
        found.append(f"in {past.pause_s:g} s")
    tell(f"{found[0]}; {', '.join(found[1:])}")
    return replace(order, resume=resumes, disabled=disabled)


def _start(order: Order, engine: Callable[[Order, Beacon], int], beacon: Beacon) -> _Child:
    sys.stdout.flush()
    sys.stderr.flush()
    ours, theirs = os.pipe()
    pid = os.fork()
    if pid:
        os.close(ours)
        return _Child(pid, theirs, time.monotonic())
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
    silence = Silence(child.pid)
    while True:
        pid, status = os.waitpid(child.pid, os.WNOHANG)
        if pid:
            os.close(child.lifeline)
            return os.waitstatus_to_exitcode(status)
        silent_s = silence.look(time.monotonic(), beacon.silence_s)
        starting = not beacon.serves and beacon.stage is None
        patience_s = max(silence_s, _STARTING_S) if starting else silence_s
        if not child.hung and silent_s > patience_s:
            child.hung = True
            os.kill(child.pid, signal.SIGKILL)
        time.sleep(_LOOK_S)
