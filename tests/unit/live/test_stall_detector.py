"""Which silence counts, on real processes: one that sleeps, one that is stopped, one that is not let run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from tickfix.live.heartbeat import StallDetector

LINUX = Path("/proc/self/schedstat").exists()
SPIN = """
import os, sys
os.nice(int(sys.argv[1]))
os.sched_setaffinity(0, {int(sys.argv[2])})
print(flush=True)
while True: pass
"""
SLEEP = "import time; print(flush=True); time.sleep(60)"


@pytest.fixture
def started() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def run(stack: ExitStack, code: str, *arguments: object) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", code, *map(str, arguments)]
    process = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE))  # noqa: S603 - our own command
    stack.callback(process.kill)
    assert process.stdout is not None
    process.stdout.readline()
    return process


def counted(pid: int, seconds: float, *, silent_since_s: float = 5.0) -> tuple[float, float]:
    """Look at a silent process for a while; return the silence that counts, and for how long it was looked at."""
    stall_detector, begun_s = StallDetector(pid), time.monotonic()
    looked_s = [begun_s]
    while looked_s[-1] - begun_s < seconds:
        stall_detector.update(looked_s[-1], silent_since_s + looked_s[-1] - begun_s)
        time.sleep(0.02)
        looked_s.append(time.monotonic())
    *looked_s, _ = looked_s
    return stall_detector.stalled_s, sum(passed for passed in np.diff(looked_s) if passed <= 1.0)  # else nobody saw it


@pytest.mark.parametrize("stopped", [False, True])
def test_one_that_sleeps_or_is_stopped_is_silent_for_as_long_as_it_lasts(started: ExitStack, stopped: bool) -> None:
    process = run(started, SLEEP)
    if stopped:
        process.send_signal(signal.SIGSTOP)
    seen_s, passed_s = counted(process.pid, 0.8)
    assert seen_s > 0.7 * passed_s


@pytest.mark.skipif(not LINUX, reason="only Linux tells who waits for a processor")
def test_one_that_is_not_let_run_is_hardly_silent(started: ExitStack) -> None:
    processor = min(os.sched_getaffinity(0))
    for _ in range(8):
        run(started, SPIN, 0, processor)
    starved = run(started, SPIN, 19, processor)
    seen_s, passed_s = counted(starved.pid, 1.5)
    assert seen_s < 0.5 * passed_s


def test_the_count_begins_anew_with_every_sign_and_leaves_out_what_nobody_saw() -> None:
    stall_detector = StallDetector(0)  # nobody: time alone counts
    stall_detector.update(100.0, 0.0)
    assert stall_detector.update(100.5, 0.5) == 0.5
    assert stall_detector.update(100.9, 0.1) == 0.1
    assert stall_detector.update(200.0, 99.2) == 0.1  # nobody looked for a minute and a half
    assert stall_detector.update(200.4, 99.6) == pytest.approx(0.5)
